"""Candidates and nominal parameters, from the catalogue alone: nothing is simulated."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from evergym.config import ParameterInfo
from evergym.discrepancy.candidates import find_candidates, is_off, make_candidate
from evergym.discrepancy.hook import PassiveHook, UserEffect
from evergym.discrepancy.nominals import BOUND, find_nominals, find_tolerance
from evergym.discrepancy.parameters import find_info, get_value, set_values
from evergym.discrepancy.setting import Setting
from evergym.discrepancy.space import Axis, Space
from evergym.effects.catalogue import EFFECTS
from evergym.errors import ConfigError
from evergym.model import load_model, save_model

MODEL = load_model("mammobot_2023")


@pytest.mark.parametrize("name", list(EFFECTS))
def test_every_effect_can_be_a_candidate_that_is_off_at_zero_and_on_at_its_starts(name: str, tmp_path: Path) -> None:
    off = {f"effects.{name}.{key}": value for key, value in EFFECTS[name].info.off.items()}
    model = set_values(MODEL, off)
    assert is_off(model, name)
    assert name in {candidate.name for candidate in find_candidates(model)}
    candidate = make_candidate(name)
    space = Space(Setting(model), candidate.axes, candidate.fixed)
    assert candidate.starts
    low, high = space.limits
    for start in candidate.starts:
        z = np.array(start)
        assert np.all((low <= z) & (z <= high))
        changed = space.setting(z).model
        assert not is_off(changed, name)
        save_model(changed, tmp_path / "model.toml")  # within the limits of a model file
    if candidate.amplitudes:
        assert is_off(space.setting(np.zeros(candidate.size)).model, name)


def test_effects_that_the_model_has_are_no_candidates() -> None:
    names = {candidate.name for candidate in find_candidates(MODEL)}
    assert names == {name for name in EFFECTS if is_off(MODEL, name)}
    assert "tendon_stretch" not in names


def test_effects_of_the_users_own_are_candidates_too() -> None:
    delay = ParameterInfo(unit="s", low=0.0, high=2.0)
    mine = UserEffect("mine", PassiveHook, {"delay_s": delay}, {"delay_s": 0.0}, {"delay_s": 0.5})
    candidate = find_candidates(MODEL, {"mine": mine})[-1]
    setting = Space(Setting(MODEL), candidate.axes, candidate.fixed).setting([2.0])
    assert setting.user == (("mine", (("delay_s", 1.0),)),)


def test_nominal_parameters_are_those_of_the_robot_and_of_effects_that_are_on() -> None:
    axes = {axis.path: axis for axis in find_nominals(MODEL)}
    assert "robot.catheter_bending_stiffness_n_m2" in axes
    assert not any(path.startswith("effects.root_kink") for path in axes)  # off in this model
    assert "robot.pressure_max_kpa" not in axes  # a limit of the bench
    for axis in axes.values():
        assert axis.low <= axis.origin <= axis.high
        assert axis.high - axis.origin <= BOUND * axis.scale * (1.0 + 1e-12)
        assert find_info(axis.path).allows(axis.low) and find_info(axis.path).allows(axis.high)


def test_tolerance_is_the_stated_uncertainty_of_the_source() -> None:
    # "0.41 +- 0.16" in the source of the mobility: 39 %.
    assert find_tolerance("effects.viscous_eversion.resistance_kpa_s_mm", 2.0) == pytest.approx(2.0 * 0.16 / 0.41)
    assert find_tolerance("robot.fluid_density_kg_m3", 1000.0) == pytest.approx(10.0)


def test_values_are_replaced_by_path_and_nothing_else() -> None:
    path = "effects.tendon_stretch.compliance_mm_per_n"
    changed = set_values(MODEL, {path: 0.5})
    assert get_value(changed, path) == 0.5
    assert set_values(changed, {path: get_value(MODEL, path)}) == MODEL
    with pytest.raises(ConfigError, match=r"no parameter 'robot\.no_such_key'"):
        set_values(MODEL, {"robot.no_such_key": 1.0})


def test_directions_go_round() -> None:
    axis = Axis("x", 0.0, 45.0, -720.0, 720.0, math.inf, turns=True)
    assert axis.value(5.0) == pytest.approx(-135.0)
    assert axis.value(-2.0) == pytest.approx(-90.0)
