"""Robots of other sizes: what counts as visible, as an event, and as feasible goes with the rig."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from evergym.discrepancy.candidates import find_candidates
from evergym.discrepancy.data.columns import CHANNELS, COMMANDS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.nominals import find_nominals
from evergym.discrepancy.parameters import set_values
from evergym.discrepancy.playback import find_pressure_settling
from evergym.discrepancy.profiles import list_profiles
from evergym.discrepancy.schedule import find_events, plan_steps
from evergym.discrepancy.setting import Setting
from evergym.discrepancy.space import Space
from evergym.discrepancy.typical import RigScale, find_factor, find_faint, measure_rig, scale_candidates
from evergym.model import Model, load_model
from evergym.robot import RobotConfig

MODEL = load_model("mammobot_2023")
TUBE = RobotConfig(
    sheath_outer_diameter_mm=24.0,
    sheath_wall_um=60.0,
    sheath_modulus_mpa=150.0,
    sheath_material_length_mm=3000.0,
    feed_max_mm_s=200.0,
    pressure_max_kpa=40.0,
)
CATHETER = RobotConfig(
    catheter_length_mm=55.0,
    catheter_flexible_length_mm=55.0,
    catheter_bending_stiffness_n_m2=1.1e-4,
    tendon_arm_mm=0.5,
    tendon_max_pull_mm=2.5,
)


def make_run(setup: str, **commands: object) -> Run:
    count = max(np.size(values) for values in commands.values())  # type: ignore[call-overload]
    table = np.zeros((count, len(COMMANDS)))
    table[:, COMMANDS.index("tail_feed_mm_s")] = np.nan
    for name, values in commands.items():
        table[:, COMMANDS.index(name)] = values
    time = 0.1 * np.arange(count)
    measured = np.full((count, len(CHANNELS)), np.nan)
    return Run("r", setup, (0.0, -9.81, 0.0), "e", "free", 10.0, time, table, measured)


def make_dataset(*runs: Run) -> Dataset:
    return Dataset("d", "", {}, {}, (), runs, (), Path("d"))


def test_on_the_2023_robot_everything_is_as_the_catalogue_says() -> None:
    run = make_run("full", insertion_mm_s=[2.0, 2.9], pressure_kpa=40.0, tendon_pull_mm=4.5)
    candidates = find_candidates(Model())
    scale = measure_rig(MODEL.robot, [run])
    assert scale_candidates(candidates, scale) == candidates


def test_a_fast_wide_tube_droops_visibly_at_far_less() -> None:
    run = make_run("sheath", tail_feed_mm_s=[120.0, 180.0], pressure_kpa=20.0)
    scale = measure_rig(TUBE, [run])
    assert scale.speed == pytest.approx(180.0 / 5.8)
    assert scale.pressure == pytest.approx(0.4)
    candidates = {candidate.name: candidate for candidate in scale_candidates(find_candidates(MODEL), scale)}
    droop = candidates["pressure_droop"].axes[0]
    growth = 90.0  # mm/s, at most
    assert 0.05 * 20.0 < droop.scale * growth < 20.0  # takes part of the pressure, not all of it
    assert candidates["pressure_bias"].axes[0].scale < 0.1 * 20.0
    moments = {axis.path.rpartition(".")[2]: axis for axis in candidates["wall_pretension"].axes}
    assert moments["eccentricity_mm"].scale == pytest.approx(0.7 * 16.0)
    assert moments["direction_deg"].scale == 45.0


def test_a_soft_short_catheter_has_less_play_and_bends_more() -> None:
    scale = measure_rig(CATHETER, [make_run("catheter", tendon_pull_mm=[0.0, 1.2])])
    assert find_factor("effects.tendon_backlash.backlash_mm", scale) == 0.25
    assert find_factor("effects.notch_closure.stiffness_n_m2", scale) == 0.25
    assert find_factor("effects.tendon_friction.mu", scale) == 1.0
    assert find_factor("robot.pressure_max_kpa", scale) == 1.0


def test_shapes_move_their_typical_value_and_switches_stay() -> None:
    scale = RigScale(length=0.1, pressure=10.0)
    candidates = {candidate.name: candidate for candidate in scale_candidates(find_candidates(Model()), scale)}
    closure = {axis.path.rpartition(".")[2]: axis for axis in candidates["notch_closure"].axes}
    assert closure["curvature_1_per_m"].origin == pytest.approx(9.0 * 16.0)
    assert candidates["wall_pretension"].fixed["effects.wall_pretension.step_pressure_kpa"] == pytest.approx(
        13.7 * 16.0
    )
    assert candidates["wall_shear"].fixed == {"effects.wall_shear.enabled": True}


def test_what_no_run_commands_is_taken_from_the_drives() -> None:
    scale = measure_rig(dataclasses.replace(TUBE, tendon_max_pull_mm=0.0), [make_run("sheath", roll_deg=[0.0, 1.0])])
    assert scale.pressure == pytest.approx(40.0 / 50.0)
    assert scale.speed == pytest.approx(200.0 / 5.8)
    assert scale.pull == 1.0


@pytest.mark.parametrize("size", [0.1, 1.0, 20.0])
def test_a_ramp_is_joined_and_a_jump_is_not_at_any_size(size: float) -> None:
    """A logged ramp, rounded to a thousandth of its height, then a jump by a twentieth."""
    height = 5.0 * size
    ramp = np.round(np.linspace(0.0, height, 40) / (1e-3 * height)) * 1e-3 * height
    commands = make_run("catheter", tendon_pull_mm=np.concatenate((ramp, np.full(20, 0.95 * height)))).commands
    event = find_events(commands)
    assert not event[2:39].any()
    assert event[40]


def test_low_pressures_are_followed_as_closely_as_high_ones() -> None:
    for top in (4.0, 40.0):
        run = make_run("sheath", tail_feed_mm_s=5.0, pressure_kpa=np.repeat([0.5 * top, 0.7 * top], 10))
        settled = find_pressure_settling(0.1, run)
        assert np.isfinite(settled[10:]).all()
        assert not np.isfinite(settled[:10]).any()
        assert plan_steps(run, 0.125)


def test_the_next_experiment_asks_no_more_of_a_rig_than_it_was_seen_to_do() -> None:
    data = make_dataset(make_run("full", insertion_mm_s=[0.5, 1.0], tendon_pull_mm=[0.0, 2.0], pressure_kpa=12.0))
    commands = np.concatenate([profile.run.commands for profile in list_profiles(data, MODEL.robot)])
    assert commands[:, COMMANDS.index("tendon_pull_mm")].max() == pytest.approx(2.0)
    assert commands[:, COMMANDS.index("insertion_mm_s")].max() == pytest.approx(1.0)
    assert commands[:, COMMANDS.index("pressure_kpa")].max() == pytest.approx(12.0)
    idle = make_dataset(make_run("full", pressure_kpa=[10.0, 12.0]))
    commands = np.concatenate([profile.run.commands for profile in list_profiles(idle, MODEL.robot)])
    # Never more tail than the drive can feed: twice the insertion.
    assert commands[:, COMMANDS.index("insertion_mm_s")].max() == pytest.approx(0.5 * MODEL.robot.feed_max_mm_s)


def test_an_effect_as_good_as_off_is_a_candidate_from_what_it_is_and_no_nominal_parameter() -> None:
    path = "effects.tendon_stretch.compliance_mm_per_n"
    assert find_faint(MODEL, RigScale()) == []
    model = set_values(MODEL, {path: 0.02})
    faint = find_faint(model, RigScale())
    assert faint == ["tendon_stretch"]
    assert path in {axis.path for axis in find_nominals(MODEL)}
    assert path not in {axis.path for axis in find_nominals(model)}
    candidate = next(one for one in find_candidates(model, faint=faint) if one.name == "tendon_stretch")
    space = Space(Setting(model), candidate.axes, candidate.fixed)
    assert space.setting(np.zeros(candidate.size)).model == model
    assert space.values((1.0,))[path] == pytest.approx(0.26)


def test_what_is_faint_follows_the_rig() -> None:
    """A droop that no one would notice on the 2023 robot stops a tube that grows thirty times as fast."""
    model = dataclasses.replace(set_values(MODEL, {"effects.pressure_droop.resistance_kpa_s_mm": 0.05}), robot=TUBE)
    assert "pressure_droop" in find_faint(model, RigScale())
    scale = RigScale(pressure=0.4, speed=34.0)
    assert "pressure_droop" not in find_faint(model, scale)
