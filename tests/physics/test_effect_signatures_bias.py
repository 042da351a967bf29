"""What bends an unloaded robot: a set catheter, a wall under pre-tension, or nothing but a gauge that is off; and the
play in which it tilts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from evergym.simulator import Command, Reading, Simulator

KPA = 1e3
MM = 1e-3
LENGTH = 0.095
AREA = math.pi * 1.5e-3**2
CATHETER = 4.23e-4
FILM = 3e8 * math.pi * 1.5e-3**3 * 35e-6
"""Bending stiffness of the taut film [N m^2]."""
# Two-sided fibres: the stiffness does not depend on the bend. A slack tendon: it holds the catheter from no side.
STILL = {
    "tendon_backlash.lost_motion_mm": 5.0,
    "eversion_yield.static_kpa": 1000.0,
    "eversion_yield.kinetic_kpa": 1000.0,
    "wall_wrinkling.enabled": False,
    "robot.catheter_bending_stiffness_n_m2": CATHETER,
}

Create = Callable[..., Simulator]


def _measure_bend(reading: Reading) -> np.ndarray:
    """Return the curvature of a robot bent to an arc [1/m], along x and y, shape (2,)."""
    x, y, z = reading.tip_direction
    across = math.hypot(x, y)
    return np.array([x, y]) * (math.atan2(across, z) / LENGTH / across if across > 0.0 else 0.0)


def _rest(create_robot: Create, changes: dict[str, Any], pressure_kpa: float, roll_deg: float = 0.0) -> np.ndarray:
    robot = create_robot({**STILL, **changes}, setup="full")
    roll = math.radians(roll_deg)
    robot.reset(everted_length=LENGTH, pressure=pressure_kpa * KPA, roll=roll)
    return _measure_bend(robot.advance(Command(pressure=pressure_kpa * KPA, roll=roll), 10.0))


@pytest.mark.parametrize("direction_deg", [0.0, 130.0])
def test_pretension_bends_by_its_moment_over_the_stiffness(create_robot: Create, direction_deg: float) -> None:
    """M = M_0 + p A e + M_1 / (1 + exp(-(p - p_1) / w)), towards its direction."""
    side = np.array([math.cos(math.radians(direction_deg)), math.sin(math.radians(direction_deg))])
    turned = {"wall_pretension.direction_deg": direction_deg}
    for pressure in (5.0, 40.0):
        bend = _rest(create_robot, {**turned, "wall_pretension.moment_n_m": 1e-4}, pressure)
        np.testing.assert_allclose(bend, 1e-4 / (CATHETER + FILM) * side, atol=1e-6)
        bend = _rest(create_robot, {**turned, "wall_pretension.eccentricity_mm": 0.5}, pressure)
        np.testing.assert_allclose(bend, pressure * KPA * AREA * 0.5e-3 / (CATHETER + FILM) * side, atol=1e-6)
    step = {**turned, "wall_pretension.step_moment_n_m": 2e-4, "wall_pretension.step_pressure_kpa": 13.7}
    for pressure, share in ((3.0, 0.0), (13.7, 0.5), (14.7, 1.0 / (1.0 + math.exp(-1.0))), (40.0, 1.0)):
        bend = _rest(create_robot, step, pressure)
        # The step has a tail of exp(-10.7).
        np.testing.assert_allclose(bend, share * 2e-4 / (CATHETER + FILM) * side, atol=1e-5)


def test_set_catheter_tense_wall_and_biased_gauge_are_told_apart_by_pressure_and_roll(create_robot: Create) -> None:
    """The same bend at 40 kPa: does it change with the pressure, and does it turn with the catheter?"""
    bend = 0.5
    effects: dict[str, dict[str, Any]] = {
        "pre_curvature": {"pre_curvature.curvature_1_per_m": bend * (CATHETER + FILM) / CATHETER},
        "wall_pretension": {"wall_pretension.step_moment_n_m": bend * (CATHETER + FILM)},
        "pressure_bias": {"pressure_bias.bias_kpa": 3.0},
    }
    answers = {}
    for name, changes in effects.items():
        high = _rest(create_robot, changes, 40.0)
        low = _rest(create_robot, changes, 5.0)
        rolled = _rest(create_robot, changes, 40.0, roll_deg=90.0)
        size = float(np.hypot(*high))
        if size > 0.0:
            np.testing.assert_allclose(high, [bend, 0.0], atol=1e-6)
        answers[name] = (size > 0.1, bool(np.hypot(*(high - low)) > 0.1), bool(np.hypot(*(high - rolled)) > 0.1))
    # (bends, with the pressure, with the roll)
    assert answers == {
        "pre_curvature": (True, False, True),
        "wall_pretension": (True, True, False),
        "pressure_bias": (False, False, False),
    }


def test_biased_gauge_shifts_the_step_of_the_wall(create_robot: Create) -> None:
    """With a gauge that reads 3 kPa too much, the wall's step comes at 3 kPa more on the gauge."""
    step = {"wall_pretension.step_moment_n_m": 2e-4, "wall_pretension.step_pressure_kpa": 13.7}
    plain = _rest(create_robot, step, 13.7)
    biased = _rest(create_robot, {**step, "pressure_bias.bias_kpa": 3.0}, 16.7)
    np.testing.assert_allclose(biased, plain, atol=1e-9)
    assert np.hypot(*(_rest(create_robot, step, 16.7) - plain)) > 0.1


LIMIT = 4.0
LIMP_ROOT = {"root_kink.pressure_share": 1e-6}
"""A sheath that holds nothing at its root, so that the play's own moment is alone."""
PLAY = {"clearance_play.angle_deg": LIMIT, "clearance_play.centring_moment_n_m": 1e-4, **LIMP_ROOT}


def _tilt(robot: Simulator, load: float) -> float:
    """Return the direction of the tip under a side load [deg], less what bends elastically."""
    reading = robot.advance(Command(pressure=20.0 * KPA, tip_load=(load, 0.0, 0.0)), 10.0)
    elastic = load * LENGTH**2 / (2.0 * (CATHETER + FILM))
    return math.degrees(math.atan2(reading.tip_direction[0], reading.tip_direction[2]) - elastic)


def test_play_tilts_up_to_its_angle_and_no_further(create_robot: Create) -> None:
    """The centring moment at the angle is overcome at F L = 1e-4 N m; beyond it the robot is only bent."""
    robot = create_robot({**STILL, **PLAY}, setup="full", section_mm=0.5)
    robot.reset(everted_length=LENGTH, pressure=20.0 * KPA)
    for share in (0.25, 0.5, -0.5, 1.5, 3.0, -3.0, 0.25):
        load = share * 1e-4 / LENGTH
        # 1 %: the first link of 0.5 mm tilts in place of bending, and the robot shortens its lever.
        expected = LIMIT * max(-1.0, min(1.0, share))
        assert _tilt(robot, load) == pytest.approx(expected, rel=0.01, abs=0.02)


def test_the_sheaths_root_holds_the_catheter_in_its_play(create_robot: Create) -> None:
    """Up to the kink's moment c pi p R^3 nothing tilts; beyond it and the centring moment, the whole play opens."""
    share, centring = 0.3, 1e-5
    changes = {**PLAY, "clearance_play.centring_moment_n_m": centring, "root_kink.pressure_share": share}
    robot = create_robot({**STILL, **changes}, setup="full", section_mm=0.5)
    hold = share * math.pi * 20.0 * KPA * 1.5e-3**3
    robot.reset(everted_length=LENGTH, pressure=20.0 * KPA)
    assert abs(_tilt(robot, 0.5 * hold / LENGTH)) < 0.05
    assert _tilt(robot, (hold + 0.5 * centring) / LENGTH) == pytest.approx(0.5 * LIMIT, rel=0.05)
    assert _tilt(robot, (hold + 2.0 * centring) / LENGTH) == pytest.approx(LIMIT, rel=0.02)


@pytest.mark.parametrize("direction_deg", [90.0, 210.0])
def test_play_is_the_same_to_all_sides_and_needs_the_assembled_robot(
    create_robot: Create, direction_deg: float
) -> None:
    load = 2e-4 / LENGTH
    side = np.array([math.cos(math.radians(direction_deg)), math.sin(math.radians(direction_deg)), 0.0])
    answers = {}
    for setup in ("full", "catheter"):
        for name, changes in (("play", PLAY), ("none", {})):
            robot = create_robot({**STILL, **changes}, setup=setup)
            robot.reset(everted_length=LENGTH, pressure=20.0 * KPA)
            reading = robot.advance(Command(pressure=20.0 * KPA, tip_load=tuple(load * side)), 10.0)
            answers[setup, name] = math.degrees(math.asin(reading.tip_direction @ side))
    assert answers["full", "play"] - answers["full", "none"] == pytest.approx(LIMIT, rel=0.03)
    assert answers["catheter", "play"] == answers["catheter", "none"]


def test_play_answers_loads_and_backlash_answers_pulls(create_robot: Create) -> None:
    """A small side load tilts the robot with play, a small pull bends it; with backlash it is the other way round."""
    load, pull = 0.25e-4 / LENGTH, 0.3 * MM
    answers = {}
    for name, changes in (("clearance_play", PLAY), ("tendon_backlash", {"tendon_backlash.backlash_mm": 0.4})):
        robot = create_robot({**STILL, "tendon_backlash.lost_motion_mm": 0.0, **changes}, setup="full")
        robot.reset(everted_length=LENGTH, pressure=20.0 * KPA)
        tilted = abs(_tilt(robot, load)) > 0.5
        robot.reset(everted_length=LENGTH, pressure=20.0 * KPA)
        bent = robot.advance(Command(pressure=20.0 * KPA, tendon_pull=pull), 10.0)
        answers[name] = (tilted, math.degrees(math.acos(bent.tip_direction[2])) > 0.5)
    assert answers == {"clearance_play": (True, True), "tendon_backlash": (False, False)}


def test_play_without_memory_is_no_friction(create_robot: Create) -> None:
    """Loaded and unloaded, to either side, it comes back to the same tilt: it is centred, not held."""
    robot = create_robot({**STILL, **PLAY}, setup="full")
    robot.reset(everted_length=LENGTH, pressure=20.0 * KPA)
    small = 0.5e-4 / LENGTH
    first = _tilt(robot, small)
    for extreme in (3e-4 / LENGTH, -3e-4 / LENGTH):
        _tilt(robot, extreme)
        assert _tilt(robot, small) == pytest.approx(first, abs=1e-3)
