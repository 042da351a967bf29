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


COMPLIANCE = 2.561e-4
MU = 0.2


def _solve_pull(curvature: float, sign: float) -> float:
    """Return the pull [m] at which a rubbing tendon holds a curvature [1/m]: kappa d L + C T exp(+-mu theta)."""
    tension = STIFFNESS * curvature / ARM
    return curvature * ARM * LENGTH + COMPLIANCE * tension * math.exp(sign * MU * curvature * LENGTH)


def test_friction_takes_a_share_of_the_tension_that_grows_with_the_bend(create_robot: Create) -> None:
    """Pulled, the drive feels T exp(mu theta); paid out, T exp(-mu theta): the loop opens with the pull."""
    robot = create_robot(
        {
            "robot.catheter_bending_stiffness_n_m2": STIFFNESS,
            "tendon_stretch.compliance_mm_per_n": COMPLIANCE * 1e3,
            "tendon_friction.mu": MU,
            "tendon_friction.presliding_mm": 0.005,
        }
    )
    for sign, pulls in ((1.0, np.linspace(0.02, 4.0, 200)), (-1.0, np.linspace(3.98, 0.5, 175))):
        for pull in pulls:
            reading = robot.advance(Command(tendon_pull=float(pull) * MM), 1.0)
            if pull < 0.5 or (sign < 0.0 and pull > 2.6):
                continue  # the presliding distance counts; or it sticks
            curvature = _measure_curvature(reading)
            # 0.3 %: the bend in the exponent is that of the step's start, here 0.02 mm of pull ago.
            assert _solve_pull(curvature, sign) / MM == pytest.approx(pull, rel=3e-3)
            tension = STIFFNESS * curvature / ARM * math.exp(sign * MU * curvature * LENGTH)
            assert reading.tendon_tension == pytest.approx(tension, rel=3e-3)


def test_friction_backlash_and_stretch_are_told_apart_by_the_loop(create_robot: Create) -> None:
    """Friction: a loop that opens with the pull. Backlash: one of a constant height. Stretch: none, a lower slope."""
    effects: dict[str, dict[str, Any]] = {
        "tendon_friction": {"tendon_friction.mu": MU},
        "tendon_backlash": {"tendon_backlash.backlash_mm": 0.4},
        "tendon_stretch": {"tendon_stretch.compliance_mm_per_n": 1.5 * COMPLIANCE * 1e3},
    }
    plain = _trace_loop(create_robot, {}, 2.0, 4.0)
    answers = {}
    for name, changes in effects.items():
        small, large = _trace_loop(create_robot, changes, 0.8, 2.0), _trace_loop(create_robot, changes, 2.0, 4.0)
        step = 0.1 * plain["slope"]
        answers[name] = (
            large["height"] > step,
            large["height"] > 1.5 * small["height"] + 0.01 * step,
            abs(large["slope"] / plain["slope"] - 1.0) > 0.1 and large["height"] < step,
        )
    # (a loop, that opens with the pull; a slope without a loop)
    assert answers == {
        "tendon_friction": (True, True, False),
        "tendon_backlash": (True, False, False),
        "tendon_stretch": (False, False, True),
    }


CLOSURE = {"notch_closure.curvature_1_per_m": 6.0, "notch_closure.stiffness_n_m2": 2e-3}


def test_closed_notches_stiffen_beyond_a_curvature_and_to_one_side(create_robot: Create) -> None:
    """Pulled beyond kappa_c: dl = kappa d L + C (EI kappa + S (kappa - kappa_c)) / d. Loaded away: nothing."""
    changes = {
        "robot.catheter_bending_stiffness_n_m2": STIFFNESS,
        "tendon_stretch.compliance_mm_per_n": COMPLIANCE * 1e3,
        **CLOSURE,
    }
    robot = create_robot(changes)
    for pull in (1.0, 1.2, 2.0, 4.0):
        reading = robot.advance(Command(tendon_pull=pull * MM), 5.0)
        free = pull * MM / (ARM * LENGTH + STIFFNESS * COMPLIANCE / ARM)
        closed = (pull * MM + 2e-3 * 6.0 * COMPLIANCE / ARM) / (ARM * LENGTH + (STIFFNESS + 2e-3) * COMPLIANCE / ARM)
        assert _measure_curvature(reading) == pytest.approx(free if free < 6.0 else closed, rel=1e-3)
        assert (free > 6.0) == (pull > 1.3)
    # A slack tendon, so that it does not hold the catheter back.
    slack = {**changes, "tendon_backlash.backlash_mm": 8.0}
    load = 8.0 * STIFFNESS / LENGTH
    deflection = {}
    for name, parts in (("notched", slack), ("plain", {**slack, "notch_closure.stiffness_n_m2": 0.0})):
        for side in (1.0, -1.0):
            robot = create_robot(parts)
            reading = robot.advance(Command(tip_load=(side * load, 0.0, 0.0)), 20.0)
            deflection[name, side] = side * float(reading.tip_position[0])
    assert deflection["notched", -1.0] == pytest.approx(deflection["plain", -1.0], rel=1e-9)
    assert deflection["notched", 1.0] < 0.95 * deflection["plain", 1.0]


def test_closed_notches_are_no_stretch_and_no_friction(create_robot: Create) -> None:
    """Below the closing curvature nothing is seen of them, above it the slope is lower, and no loop opens."""
    plain = _trace_loop(create_robot, {}, 2.0, 4.0)
    below = _trace_loop(create_robot, CLOSURE, 0.2, 1.2)
    above = _trace_loop(create_robot, CLOSURE, 2.0, 4.0)
    assert below["slope"] == pytest.approx(plain["slope"], rel=1e-3)
    assert above["slope"] < 0.5 * plain["slope"]
    for loop in (below, above):
        assert loop["height"] < 1e-3 * plain["slope"]
    stretched = {"tendon_stretch.compliance_mm_per_n": 2.0 * COMPLIANCE * 1e3}
    assert _trace_loop(create_robot, stretched, 0.2, 1.2)["slope"] < 0.8 * plain["slope"]


TORSION = 7.4e-4
SQUEEZE = {"torsional_windup.mu": 0.1, "torsional_windup.presliding_deg": 0.002}


def _turn(robot: Simulator, roll: float, pressure: float, load: float = 0.0) -> float:
    """Return the roll of the tip [rad] once the base is turned to ``roll``."""
    for _ in range(3):
        robot.advance(Command(roll=roll, pressure=pressure, tip_load=(load, 0.0, 0.0)), 2.0)
    return float(robot.state.roll[int(robot.state.links[0])])


@pytest.mark.parametrize("pressure", [20.0 * KPA, 40.0 * KPA])
def test_windup_lags_by_its_twist_and_turns_round_after_twice_that(create_robot: Create, pressure: float) -> None:
    """B22: tau L^2 / (2 G J) with tau = mu p 2 pi r_c^2; on the way back the tip rests over twice the lag."""
    robot = create_robot({**NO_GROWTH, **SQUEEZE}, setup="full")
    robot.reset(everted_length=LENGTH, pressure=pressure)
    lag = 0.1 * pressure * 2.0 * math.pi * 0.925e-3**2 * LENGTH**2 / (2.0 * TORSION)
    tip = _turn(robot, 1.0, pressure)
    assert 1.0 - tip == pytest.approx(lag, rel=5e-3)  # as in the benchmark
    # The presliding angle is all that the tip gives within the dead band.
    assert _turn(robot, 1.0 - 1.9 * lag, pressure) == pytest.approx(tip, abs=2.0 * math.radians(0.002))
    back = 1.0 - 3.0 * lag
    assert _turn(robot, back, pressure) - back == pytest.approx(lag, rel=5e-3)


def test_windup_lags_with_memory_and_pressure_and_anisotropy_does_neither(create_robot: Create) -> None:
    """The direction of the deflection under a small load, with the base at 30 deg on the way there and back."""
    load, answers = 1e-5, {}
    for name, changes in (
        ("torsional_windup", {**SQUEEZE, "robot.catheter_anisotropy": 15.0}),
        ("bending_anisotropy", {"bending_anisotropy.enabled": True, "robot.catheter_anisotropy": 15.0}),
    ):
        for pressure in (10.0 * KPA, 40.0 * KPA):
            two_sided = {**NO_GROWTH, "wall_wrinkling.enabled": False}
            robot = create_robot({**two_sided, **changes}, setup="full")
            robot.reset(everted_length=LENGTH, pressure=pressure)
            directions = []
            for roll_deg in (0.0, 30.0, 60.0, 30.0):
                _turn(robot, math.radians(roll_deg), pressure, load)
                x, y, _ = robot.reading.tip_position
                directions.append(math.degrees(math.atan2(y, x)))
            answers[name, pressure] = directions[3] - directions[1]
    for pressure in (10.0 * KPA, 40.0 * KPA):
        assert answers["bending_anisotropy", pressure] == pytest.approx(0.0, abs=1e-2)
    # There the tip is behind the base, back it is ahead of it, and the more so the harder the tail is pressed on.
    assert answers["torsional_windup", 10.0 * KPA] > 0.5
    assert answers["torsional_windup", 40.0 * KPA] > 2.0 * answers["torsional_windup", 10.0 * KPA]


def _push(create_robot: Create, enabled: bool, push: float) -> float:
    """Return what a small side load does beside a push [Euler loads], over what it does alone by the linear law."""
    euler = 0.25 * math.pi**2 * STIFFNESS / LENGTH**2
    side = 1e-4 * euler
    changes = {"robot.catheter_bending_stiffness_n_m2": STIFFNESS, "axial_buckling.enabled": enabled}
    reading = create_robot(changes).advance(Command(tip_load=(side, 0.0, -push * euler)), 60.0)
    return float(reading.tip_position[0] / (side * LENGTH**3 / (3.0 * STIFFNESS)))


def test_push_along_the_robot_amplifies_and_buckles_where_buckling_is_on(create_robot: Create) -> None:
    assert _push(create_robot, True, 0.5) == pytest.approx(1.9863, rel=0.01)  # B8
    assert _push(create_robot, True, 2.0) > 1000.0
    # A pull along the robot is none of it: it straightens with the switch as without.
    assert _push(create_robot, False, -4.0) == pytest.approx(_push(create_robot, True, -4.0), rel=1e-9)


def test_push_along_the_robot_does_nothing_where_buckling_is_off(create_robot: Create) -> None:
    for push in (0.5, 2.0):
        assert _push(create_robot, False, push) == pytest.approx(1.0, rel=0.01)


def test_buckling_needs_a_push_and_anisotropy_a_side(create_robot: Create) -> None:
    """Anisotropy divides the deflection across the soft plane with and without a push; buckling only with one."""
    euler = 0.25 * math.pi**2 * STIFFNESS / LENGTH**2
    side = 1e-4 * euler
    ratio = {}
    for anisotropy in (1.0, 15.0):
        for push in (0.0, 0.5):
            robot = create_robot(
                {"robot.catheter_bending_stiffness_n_m2": STIFFNESS, "robot.catheter_anisotropy": anisotropy}
            )
            reading = robot.advance(Command(tip_load=(side, side, -push * euler)), 20.0)
            ratio[anisotropy, push] = reading.tip_position[0] / reading.tip_position[1]
    assert ratio[1.0, 0.0] == pytest.approx(1.0, rel=1e-3)
    assert ratio[1.0, 0.5] == pytest.approx(1.0, rel=1e-3)
    assert ratio[15.0, 0.0] == pytest.approx(15.0, rel=1e-2)
    # The stiff plane is far from its own critical load: 1 / (1 - P / 15 P_cr) there.
    assert ratio[15.0, 0.5] == pytest.approx(15.0 * 1.9863 / (1.0 + 0.5 / 15.0), rel=2e-2)
