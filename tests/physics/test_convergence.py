"""Order of convergence, measured: second in the spacing of the sections, first in the step."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from evergym.simulator import Command, Simulator
from evergym.world import World

LENGTH = 0.095
STIFFNESS = 4.3e-4
NO_GROWTH = {"eversion_yield.static_kpa": 1000.0, "eversion_yield.kinetic_kpa": 1000.0}

Create = Callable[..., Simulator]


def _fit_slope(sizes: list[float], errors: list[float]) -> float:
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])


def test_elastica_is_second_order_in_spacing(create_robot: Create) -> None:
    exact = LENGTH * np.array([0.493457, 0.839358])  # B2 at 2; its digits are 1e-4 of the error of the finest grid here
    sizes, errors = [LENGTH / n for n in (5, 10, 20, 40)], []
    for size in sizes:
        rod = create_robot({"robot.catheter_bending_stiffness_n_m2": STIFFNESS}, section_mm=size * 1e3)
        tip = rod.advance(Command(tip_load=(2.0 * STIFFNESS / LENGTH**2, 0.0, 0.0)), 20.0).tip_position
        errors.append(float(np.linalg.norm(tip[[0, 2]] - exact)))
    slope = _fit_slope(sizes, errors)
    print(f"elastica: errors {errors} m, order {slope:.3f}")
    assert slope == pytest.approx(2.0, abs=0.1)  # measured 2.00
    assert errors[-1] < 1e-4 * LENGTH


def test_whole_robot_is_second_order_in_spacing(create_robot: Create) -> None:
    """Inflated, pulled, rolled, sagging, anisotropic and pre-curved, with 60 fibres: by Richardson's differences."""
    changes = {
        **NO_GROWTH,
        "robot.catheter_anisotropy": 15.0,
        "pre_curvature.curvature_1_per_m": 2.2,
        "saline_weight.share": 1.0,
    }
    tips = []
    counts = (10, 20, 40, 80)
    for count in counts:
        robot = create_robot(changes, setup="full", section_mm=LENGTH * 1e3 / count, fibres=60)
        robot.reset(everted_length=LENGTH, pressure=30e3, tendon_pull=2.5e-3, roll=0.8)
        command = Command(pressure=30e3, tendon_pull=2.5e-3, roll=0.8, tip_load=(0.0, 0.005, 0.0))
        tips.append(robot.advance(command, 10.0).tip_position)
    differences = [float(np.linalg.norm(fine - coarse)) for coarse, fine in pairwise(tips)]
    slope = _fit_slope([1.0 / count for count in counts[:-1]], differences)
    print(f"whole robot: differences {differences} m, order {slope:.3f}")
    # A little less than 2 is the fibres' doing: the moment has kinks where one of them goes slack.
    assert slope == pytest.approx(2.0, abs=0.25)


def test_swing_is_first_order_in_step(create_robot: Create) -> None:
    """A rod let go swings back; implicit Euler with dashpots in the fibres."""
    changes = {"robot.catheter_bending_stiffness_n_m2": STIFFNESS, "robot.catheter_damping_time_ms": 2.0}
    steps = [4e-4, 2e-4, 1e-4, 5e-5]
    tips = []
    for step in [*steps, 2.5e-5]:
        robot = create_robot(changes, section_mm=9.5, step_s=step)
        robot.advance(Command(tip_load=(0.05, 0.0, 0.0)), 0.4)
        tips.append(robot.advance(Command(), 0.012).tip_position)
    differences = [float(np.linalg.norm(fine - coarse)) for coarse, fine in pairwise(tips)]
    slope = _fit_slope(steps, differences)
    print(f"swing: differences {differences} m, order {slope:.3f}")
    assert slope == pytest.approx(1.0, abs=0.15)


def test_growth_into_a_bend_is_first_order_in_step(create_robot: Create) -> None:
    """The whole robot grows while it is steered: capstan friction, pressure lag and the feed act on each other."""
    changes = {
        "tail_capstan_friction.mu": 0.3,
        "robot.catheter_anisotropy": 15.0,
        "pressure_lag.time_s": 0.5,
        "saline_weight.share": 1.0,
        "robot.catheter_damping_time_ms": 5.0,
    }
    steps = [0.2, 0.1, 0.05, 0.025]
    lengths = []
    for step in [*steps, 0.0125]:
        robot = create_robot(changes, setup="full", section_mm=4.0, step_s=step)
        robot.reset(everted_length=0.030, catheter_length=0.030)
        for k in range(10):
            command = Command(
                insertion_velocity=4e-3, tail_feed_velocity=0.05, tendon_pull=4e-4 * (k + 1), pressure=45e3
            )
            reading = robot.advance(command, 0.8)
        lengths.append(reading.everted_length)
    differences = np.abs(np.diff(lengths)).tolist()
    slope = _fit_slope(steps, differences)
    print(f"growth: lengths {lengths} m, differences {differences} m, order {slope:.3f}")
    assert slope == pytest.approx(1.0, abs=0.3)


def test_gravity_sag_is_second_order_in_spacing(create_robot: Create) -> None:
    exact = LENGTH * np.array([-0.495905, 0.846657])  # B4 at 5
    weight = {"robot.catheter_bending_stiffness_n_m2": STIFFNESS, "saline_weight.share": 1.0}
    gravity = 5.0 * STIFFNESS / LENGTH**3 / create_robot(weight).parameters.robot.catheter_mass
    sizes, errors = [LENGTH / n for n in (5, 10, 20, 40)], []
    for size in sizes:
        rod = create_robot(weight, section_mm=size * 1e3, world=World.free(gravity=(0.0, -gravity, 0.0)))
        errors.append(float(np.linalg.norm(rod.advance(Command(), 10.0).tip_position[1:] - exact)))
    slope = _fit_slope(sizes, errors)
    print(f"sag: errors {errors} m, order {slope:.3f}")
    assert slope == pytest.approx(2.0, abs=0.1)  # measured 2.04: the digits of the exact values tell on the finest grid
