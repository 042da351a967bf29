"""Data of other labs: other robots, other habits; `[robot]` in the dataset must be all that a diagnosis is told."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from evergym.discrepancy import run_stages
from evergym.discrepancy.alignment import Alignment, realign
from evergym.discrepancy.data.columns import CHANNELS, COMMANDS
from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.data.export import add_noise, write_dataset
from evergym.discrepancy.data.reading import load_dataset
from evergym.discrepancy.data.rig import override_robot
from evergym.discrepancy.parameters import set_values
from evergym.discrepancy.simulate import simulate_run
from evergym.discrepancy.verdict import Verdict
from evergym.model import Model, Numerics, load_model

pytestmark = pytest.mark.slow

CATHETER = {
    "catheter_length_mm": 55.0,
    "catheter_flexible_length_mm": 55.0,
    "catheter_outer_diameter_mm": 1.2,
    "catheter_inner_diameter_mm": 0.9,
    "catheter_bending_stiffness_n_m2": 1.1e-4,
    "catheter_mass_g": 0.09,
    "tendon_arm_mm": 0.5,
    "tendon_max_pull_mm": 2.5,
}
TUBE = {
    "sheath_outer_diameter_mm": 24.0,
    "sheath_wall_um": 60.0,
    "sheath_modulus_mpa": 150.0,
    "sheath_material_length_mm": 3000.0,
    "sheath_mass_g": 7.0,
    "fluid_density_kg_m3": 1.2,
    "feed_max_mm_s": 200.0,
}


def make_run(name: str, setup: str, time: np.ndarray, start_mm: float = 10.0, **commands: object) -> Run:
    table = np.zeros((len(time), len(COMMANDS)))
    table[:, COMMANDS.index("tail_feed_mm_s")] = np.nan
    for column, values in commands.items():
        table[:, COMMANDS.index(column)] = values
    measured = np.full((len(time), len(CHANNELS)), np.nan)
    return Run(name, setup, (0.0, -9.81, 0.0), name, "free", start_mm, time, table, measured)


def make_rig(model: Model, robot: dict[str, float], setup: str) -> Model:
    return dataclasses.replace(model, robot=override_robot(model.robot, robot, "rig", {setup}))


def test_tables_of_a_short_catheter_are_read_as_they_were_meant(tmp_path: Path) -> None:
    """A play in the tendon's drive, one angle for each pull in the pull's own row, nothing else, no repeats."""
    off = {"effects.tendon_backlash.backlash_mm": 0.0, "effects.tendon_backlash.lost_motion_mm": 0.0}
    lab = set_values(load_model("mammobot_2023"), {**off, "effects.pre_curvature.curvature_1_per_m": 0.0})
    changes = {"effects.tendon_backlash.backlash_mm": 0.3, "robot.catheter_bending_stiffness_n_m2": 1.16e-4}
    truth = set_values(make_rig(lab, CATHETER, "catheter"), changes)
    noise = {"bending_angle_deg": 0.4}
    rng = np.random.default_rng(4)
    tables = {
        "a": (0.4, 0.8, 1.2, 1.6, 2.0, 1.4, 0.7, 0.2),
        "b": (0.3, 1.0, 0.5, 1.5, 0.9, 2.2, 1.1, 0.2),
        "c": (2.0, 1.0, 2.4, 0.6, 1.3, 0.4, 1.9),
    }
    runs = []
    for name, pulls in tables.items():
        run = make_run(name, "catheter", 1000.0 + 1.0 * np.arange(len(pulls)), tendon_pull_mm=pulls)
        meant = simulate_run(truth, realign(run, Alignment.SAME_ROW), Numerics(section_length_mm=1.1, step_s=0.05))[1:]
        runs.append(add_noise(dataclasses.replace(run, measured=meant), noise, rng))
    dataset = load_dataset(write_dataset(tmp_path / "tables", runs, noise, robot=CATHETER), lab.robot)
    diagnosis = run_stages(dataset, lab).diagnosis
    assert len(diagnosis.remarks) == 3
    assert diagnosis.verdict is Verdict.EFFECT
    assert [effect.name for effect in diagnosis.effects] == ["tendon_backlash"]
    backlash = next(i for i in diagnosis.parameters["tendon_backlash"] if i.path.endswith("backlash_mm"))
    assert backlash.estimate == pytest.approx(0.3, abs=0.05)
    assert diagnosis.to_mapping()["remarks"] == list(diagnosis.remarks)


def test_bursts_of_a_wide_tube_with_wrong_nominals_are_no_effect(tmp_path: Path) -> None:
    """A tube of 12 mm radius that grows by metres a minute in pulses of pressure; a tenth of the readings is lost."""
    growth = {
        "effects.eversion_yield.static_kpa": 4.0,
        "effects.eversion_yield.kinetic_kpa": 3.0,
        "effects.viscous_eversion.resistance_kpa_s_mm": 0.05,
        "effects.feed_limit.slip": 0.1,
        "effects.tail_coulomb_friction.yield_growth_per_mm": 0.0008,
        "effects.pressure_lag.time_s": 0.1,
    }
    lab = set_values(load_model("mammobot_2023"), growth)
    changes = {
        "effects.viscous_eversion.resistance_kpa_s_mm": 0.055,
        "effects.eversion_yield.static_kpa": 4.2,
    }
    truth = set_values(make_rig(lab, TUBE, "sheath"), changes)
    noise = {"everted_length_mm": 3.0, "pressure_measured_kpa": 0.15}
    rng = np.random.default_rng(5)
    runs = []
    for name, low, high, start in (("a", 3.5, 11.0, 200.0), ("b", 6.0, 9.0, 600.0), ("c", 2.0, 14.0, 300.0)):
        time = np.cumsum(rng.uniform(0.08, 0.16, 36))
        pulses = np.where(np.mod(time, 2.0) < 1.0, low, high)
        run = make_run(name, "sheath", time, start, tail_feed_mm_s=120.0, pressure_kpa=pulses)
        signal = simulate_run(truth, run, Numerics(section_length_mm=17.0, step_s=0.02))
        noisy = add_noise(dataclasses.replace(run, measured=signal), noise, rng).measured.copy()
        noisy[rng.random(noisy.shape) < 0.1] = np.nan
        runs.append(dataclasses.replace(run, measured=noisy))
    dataset = load_dataset(write_dataset(tmp_path / "tube", runs, noise, robot=TUBE), lab.robot)
    diagnosis = run_stages(dataset, lab).diagnosis
    assert diagnosis.remarks == ()
    assert diagnosis.verdict is Verdict.NO_EFFECT
    assert max(run.measured[np.isfinite(run.measured[:, 3]), 3].max() for run in dataset.runs) > 700.0
