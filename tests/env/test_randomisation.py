"""Drawn models: within bounds, off stays off, as wide as the uncertainty says."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from evergym.config import check, iterate_parameters, to_mapping
from evergym.effects.tail_capstan_friction import TailCapstanFriction
from evergym.envs.pegs import MammobotPegsEnv
from evergym.envs.randomisation import SPREAD, draw_model
from evergym.model import Model, load_model

MODEL = load_model("mammobot_2023")


def value_of(model: Model, path: str) -> float:
    value = to_mapping(model)
    for key in path.split("."):
        value = value[key]
    return float(value)  # type: ignore[arg-type]


def test_every_spread_names_a_parameter() -> None:
    """A renamed parameter must not silently stop being drawn."""
    known = {path for path, _, _ in iterate_parameters(Model)}
    assert set(SPREAD) <= known
    assert all(spread > 0.0 for spread in SPREAD.values())


def test_scale_zero_is_the_model_itself() -> None:
    """Equal to the last bit."""
    assert draw_model(MODEL, np.random.default_rng(0), 0.0) == MODEL


@pytest.mark.parametrize("name", ["mammobot_2023", "mammobot_2021"])
@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_drawn_models_are_valid(name: str, scale: float) -> None:
    """Also at three times the uncertainty every value keeps to its bounds, and what is known stays."""
    model = load_model(name)
    rng = np.random.default_rng(1)
    for _ in range(20):
        drawn = draw_model(model, rng, scale)
        check(drawn, "test")
        for path, _, _ in iterate_parameters(Model):
            if path not in SPREAD and path not in ("name", "schema"):
                assert to_mapping_value(drawn, path) == to_mapping_value(model, path), path
        assert drawn != model


def to_mapping_value(model: Model, path: str) -> object:
    value: object = to_mapping(model)
    for key in path.split("."):
        value = value.get(key)  # type: ignore[attr-defined]
    return value


def test_spread_is_as_stated() -> None:
    """The logarithm's standard deviation over 400 draws is the spread, within four standard errors (3.5 % each)."""
    rng = np.random.default_rng(2)
    models = [draw_model(MODEL, rng, 1.0) for _ in range(400)]
    for path in ("effects.eversion_yield.kinetic_kpa", "effects.viscous_eversion.resistance_kpa_s_mm"):
        logs = [math.log(value_of(model, path) / value_of(MODEL, path)) for model in models]
        assert np.std(logs) == pytest.approx(SPREAD[path], rel=0.15)
        assert abs(np.mean(logs)) < 4.0 * SPREAD[path] / math.sqrt(len(logs))


def test_an_effect_that_is_off_stays_off() -> None:
    """Randomisation varies strengths; it does not switch effects on."""
    off = dataclasses.replace(
        MODEL, effects=dataclasses.replace(MODEL.effects, tail_capstan_friction=TailCapstanFriction(0.0))
    )
    assert draw_model(off, np.random.default_rng(3), 1.0).effects.tail_capstan_friction.mu == 0.0


def test_episodes_differ_in_their_model() -> None:
    """With randomisation the same start and actions grow differently; without it they do not."""
    action = np.array([1.0, 0.0, -1.0, 1.0])
    grown = {}
    for scale in (0.0, 1.0):
        env = MammobotPegsEnv(model_randomisation=scale)
        lengths = set()
        for episode in range(3):
            env.reset(seed=0 if episode == 0 else None, options={"index": 0})
            for _ in range(20):
                *_, info = env.step(action)
            lengths.add(info["everted_length_mm"])
        grown[scale] = len(lengths)
    assert grown == {0.0: 1, 1.0: 3}
