"""Models: the shipped files, what they compile to, and how mistakes are told."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import pytest

from evergym.effects.catalogue import Effects
from evergym.errors import ConfigError
from evergym.model import MODEL_NAMES, Model, Numerics, compile_numerics, compile_robot, load_model, save_model
from evergym.robot import RobotConfig


@pytest.mark.parametrize("name", MODEL_NAMES)
def test_shipped_model_survives_a_round_trip(name: str, tmp_path: Path) -> None:
    model = load_model(name)
    assert model.name == name
    save_model(model, tmp_path / "copy.toml")
    assert load_model(tmp_path / "copy.toml") == model


def test_the_2023_robot_is_the_default() -> None:
    assert load_model("mammobot_2023") == Model()


def test_weights_per_length_are_the_papers() -> None:
    full = compile_robot(Model(), Numerics(), "full")
    # Row 18: sheath 0.072 N/m, full system 0.074 N/m, to their digits.
    assert 9.81 * full.sheath_mass == pytest.approx(0.072, abs=5e-4)
    assert 9.81 * (full.sheath_mass + full.inner_mass) == pytest.approx(0.074, abs=5e-4)


def test_robot_is_compiled_to_si() -> None:
    robot = compile_robot(Model(), Numerics(sheath_fibres=16), "full")
    assert robot.sheath_bundle.shape == (16, 6)
    assert robot.sheath_radius == pytest.approx(1.5e-3)
    assert robot.catheter_radius == pytest.approx(0.925e-3)
    assert robot.everted_length_max == 0.140
    assert robot.damping_time == pytest.approx(5e-3)
    assert compile_numerics(Numerics(section_length_mm=2.0)).section_length == pytest.approx(2e-3)


@pytest.mark.parametrize(("setup", "sheath", "catheter"), [("full", 1, 1), ("catheter", 0, 1), ("sheath", 1, 0)])
def test_setups_leave_out_the_other_body(setup: str, sheath: bool, catheter: bool) -> None:
    robot = compile_robot(Model(), Numerics(), setup)
    assert (robot.has_sheath, robot.has_catheter) == (sheath, catheter)


def test_protrusion_is_a_switch() -> None:
    effects = Effects()
    off = dataclasses.replace(
        effects, catheter_protrusion=dataclasses.replace(effects.catheter_protrusion, enabled=False)
    )
    assert compile_robot(Model(), Numerics(), "full").may_protrude
    assert not compile_robot(Model(effects=off), Numerics(), "full").may_protrude


def test_misspelt_model_name_gets_a_suggestion() -> None:
    with pytest.raises(ConfigError, match="Did you mean 'mammobot_2023'"):
        load_model("mammobot_2032")


def test_misspelt_key_gets_its_file_and_a_suggestion(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[effects.feed_limit]\nslipp = 0.1\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"mine\.toml.*slipp.*slip"):
        load_model(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[robot]\ncatheter_outer_diameter_mm = 2.95\n", "does not fit into the sheath"),
        ("[robot]\ncatheter_inner_diameter_mm = 1.85\n", "Give the catheter a wall"),
        ("[robot]\nsheath_wall_um = -1.0\n", "sheath_wall_um"),
        ("[effects.tail_capstan_friction]\nmu = nan\n", "mu"),
        ("[effects.pressure_lag]\ntime_s = 1e9\n", "time_s"),
        ("schema = 2\n", "schema"),
    ],
)
def test_impossible_models_are_refused_by_name(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=words) as caught:
        load_model(path)
    assert "mine.toml" in str(caught.value)


def test_missing_file_is_told() -> None:
    with pytest.raises(ConfigError, match="does not exist"):
        load_model("no/such/model.toml")


def test_model_is_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        RobotConfig().sheath_wall_um = 20.0  # type: ignore[misc]
    assert math.isclose(RobotConfig().sheath_wall_um, 35.0)
