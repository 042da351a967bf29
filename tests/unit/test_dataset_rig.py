"""Robots of other sizes: overrides of a dataset reach the model, and the numerics follow the robot."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import CHANNELS, COMMANDS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.data.rig import apply_robot, choose_numerics
from evergym.discrepancy.simulate import try_simulate_run
from evergym.errors import ConfigError
from evergym.model import Model, load_model
from evergym.units import DEG

Array = NDArray[np.float64]
MODEL = load_model("mammobot_2023")


def make_run(
    time: Array, setup: str = "full", everted_mm: float = 40.0, environment: str = "free", **commands: object
) -> Run:
    table = np.zeros((len(time), len(COMMANDS)))
    table[:, COMMANDS.index("tail_feed_mm_s")] = np.nan
    for name, values in commands.items():
        table[:, COMMANDS.index(name)] = values
    measured = np.full((len(time), len(CHANNELS)), np.nan)
    return Run("r", setup, (0.0, -9.81, 0.0), "e", environment, everted_mm, time, table, measured)


def channel(predicted: Array, name: str) -> Array:
    values: Array = predicted[:, CHANNELS.index(name)]
    return values


def make_dataset(robot: dict[str, float], *runs: Run) -> Dataset:
    return Dataset("d", "", {}, robot, (), runs, (), Path("d"))


# -- other robots


def test_overrides_reach_the_robot() -> None:
    model = apply_robot(MODEL, make_dataset({"catheter_length_mm": 55.0}, make_run(np.zeros(1), "catheter")))
    assert model.robot.catheter_length_mm == 55.0
    assert model.effects == MODEL.effects


@pytest.mark.parametrize("diameter", [0.9, 3.5, 8.0])
def test_a_catheter_of_any_size_can_be_simulated_alone(diameter: float) -> None:
    robot = {
        "catheter_length_mm": 55.0,
        "catheter_flexible_length_mm": 55.0,
        "catheter_outer_diameter_mm": diameter,
        "catheter_inner_diameter_mm": 0.6 * diameter,
        "catheter_bending_stiffness_n_m2": 4.5e-5 * diameter,
        "tendon_arm_mm": 0.4 * diameter,
    }
    time = np.arange(0.0, 4.0, 0.5)
    run = make_run(time, "catheter", tendon_pull_mm=np.linspace(0.0, 2.5, len(time)))
    model = apply_robot(MODEL, make_dataset(robot, run))
    prediction = try_simulate_run(model, run)
    assert prediction.failure == ""
    angle = channel(prediction.channels, "tip_angle_deg")
    # Pull less play, stretch aside, is arm times angle: never more than that, and the robot bends.
    limit = math.degrees(2.5 / (0.4 * diameter)) + 2.2 * 0.055 / DEG
    assert 5.0 < angle[-1] < limit


def test_a_wide_tube_grows() -> None:
    robot = {
        "sheath_outer_diameter_mm": 24.0,
        "sheath_wall_um": 50.0,
        "sheath_material_length_mm": 2000.0,
        "fluid_density_kg_m3": 1.2,
        "feed_max_mm_s": 100.0,
    }
    time = np.arange(0.0, 10.0, 0.2)
    run = make_run(time, "sheath", 50.0, tail_feed_mm_s=40.0, pressure_kpa=25.0)
    model = apply_robot(MODEL, make_dataset(robot, run))
    assert choose_numerics(model, "sheath").section_length_mm == pytest.approx(1000.0 / 72.0)
    prediction = try_simulate_run(model, run)
    assert prediction.failure == ""
    assert channel(prediction.channels, "everted_length_mm")[-1] > 55.0


def test_parts_that_no_run_has_are_made_to_fit() -> None:
    thick = {"catheter_outer_diameter_mm": 6.0}
    catheter, full = make_run(np.zeros(1), "catheter"), make_run(np.zeros(1), "full")
    assert apply_robot(MODEL, make_dataset(thick, catheter)).robot.sheath_outer_diameter_mm > 6.0
    with pytest.raises(ConfigError, match="does not fit"):
        apply_robot(MODEL, make_dataset(thick, full))
    thin = {"sheath_outer_diameter_mm": 1.5}
    tube = apply_robot(MODEL, make_dataset(thin, make_run(np.zeros(1), "sheath"))).robot
    assert tube.catheter_inner_diameter_mm < tube.catheter_outer_diameter_mm < 1.5


def test_sections_and_tolerance_go_with_the_robot() -> None:
    default = choose_numerics(MODEL, "full")
    assert default.energy_tolerance_j == pytest.approx(1e-10, rel=0.1)  # as the simulator's own
    robot = dataclasses.replace(MODEL.robot, sheath_material_length_mm=560.0)
    doubled = choose_numerics(Model(robot=robot), "full")
    assert doubled.section_length_mm == pytest.approx(2.0 * default.section_length_mm)
