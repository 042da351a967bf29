"""What each effect of catheter and tendon looks like, and what tells it from the one it is taken for."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from evergym.simulator import Command, Reading, Simulator

LENGTH = 0.095
STIFFNESS = 4.23e-4
ARM = 0.75e-3
MM = 1e-3
KPA = 1e3
NO_GROWTH = {"eversion_yield.static_kpa": 1000.0, "eversion_yield.kinetic_kpa": 1000.0}

Create = Callable[..., Simulator]


def _measure_curvature(reading: Reading) -> float:
    """Return the curvature [1/m] as the paper does: tip angle over length."""
    return math.atan2(reading.tip_direction[0], reading.tip_direction[2]) / LENGTH


def _trace_loop(create_robot: Create, changes: dict[str, Any], low_mm: float, high_mm: float) -> dict[str, float]:
    """Return what a loop of the pull shows, once up, down and up again: its height and slope, and how it starts back.

    ``height``: largest difference between the ways [1/m]; ``slope``: of the way up at its upper end [1/m per mm];
    ``rest``: curvature lost in the first 0.2 mm of the way down [1/m].
    """
    robot = create_robot({"robot.catheter_bending_stiffness_n_m2": STIFFNESS, **changes})
    up = np.arange(low_mm, high_mm + 0.05, 0.1)
    robot.reset()
    curvature = {}
    for way, pulls in (("first", up), ("down", up[::-1]), ("up", up)):
        curvature[way] = np.array(
            [_measure_curvature(robot.advance(Command(tendon_pull=float(pull) * MM), 2.0)) for pull in pulls]
        )
    down = curvature["down"][::-1]
    return {
        "height": float(np.max(down - curvature["up"])),
        "slope": float(curvature["up"][-1] - curvature["up"][-3]) / 0.2,
        "rest": float(down[-1] - down[-3]),
    }


def test_stretch_lowers_the_slope_and_opens_no_loop(create_robot: Create) -> None:
    rigid = _trace_loop(create_robot, {"tendon_stretch.compliance_mm_per_n": 0.0}, 1.0, 3.0)
    soft = _trace_loop(create_robot, {"tendon_stretch.compliance_mm_per_n": 0.2561}, 1.0, 3.0)
    assert rigid["slope"] == pytest.approx(1e-3 / (ARM * LENGTH), rel=1e-3)
    assert soft["slope"] == pytest.approx(1e-3 / (ARM * LENGTH + STIFFNESS * 2.561e-4 / ARM), rel=1e-3)
    for loop in (rigid, soft):
        assert loop["height"] < 1e-3 * loop["slope"]
        assert loop["rest"] == pytest.approx(0.2 * loop["slope"], rel=1e-3)


def test_backlash_opens_a_loop_of_one_width_and_keeps_the_slope(create_robot: Create) -> None:
    plain = _trace_loop(create_robot, {}, 1.0, 3.0)
    for low, high in ((0.8, 2.0), (2.0, 4.0)):
        loop = _trace_loop(create_robot, {"tendon_backlash.backlash_mm": 0.4}, low, high)
        assert loop["slope"] == pytest.approx(plain["slope"], rel=1e-3)
        # The same at small and at large pulls.
        assert loop["height"] == pytest.approx(0.4 * plain["slope"], rel=1e-3)
        assert loop["rest"] == pytest.approx(0.0, abs=1e-3 * plain["slope"])


def test_pre_curvature_turns_with_the_catheter_and_is_there_without_pressure(create_robot: Create) -> None:
    robot = create_robot({"pre_curvature.curvature_1_per_m": 2.2})
    for roll_deg in (0.0, 70.0, 180.0):
        reading = robot.advance(Command(roll=math.radians(roll_deg)), 5.0)
        angle = math.acos(reading.tip_direction[2])
        assert angle / LENGTH == pytest.approx(2.2, rel=1e-6)
        side = math.degrees(math.atan2(reading.tip_direction[1], reading.tip_direction[0]))
        assert math.remainder(side - roll_deg, 360.0) == pytest.approx(0.0, abs=1e-3)


def test_anisotropy_turns_the_deflection_without_memory(create_robot: Create) -> None:
    """A load beside the soft plane bends towards it; turning the base back and forth leaves nothing behind."""
    robot = create_robot({"robot.catheter_anisotropy": 15.0})
    load = (1e-4, 0.0, 0.0)
    directions = []
    for roll_deg in (0.0, 30.0, 60.0, 30.0, 0.0):
        reading = robot.advance(Command(roll=math.radians(roll_deg), tip_load=load), 5.0)
        directions.append(math.degrees(math.atan2(reading.tip_position[1], reading.tip_position[0])))
    assert directions[1] > 20.0  # rolled by 30 deg, it gives way some 27.8 deg off the load
    np.testing.assert_allclose(directions[3:], [directions[1], directions[0]], atol=1e-3)
