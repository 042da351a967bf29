"""Retraction: the force that inverts the wall, the work it takes, the loads that buckle the robot, and the tail's
account.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from evergym.effects.retraction_buckling import compute_axial_limit
from evergym.simulator import Command, Simulator
from evergym.state import Scalar

KPA = 1e3
AREA = math.pi * 1.5e-3**2

Create = Callable[..., Simulator]


@pytest.mark.parametrize("gauge_kpa", [2.0, 5.0, 10.0, 20.0])
def test_inversion_balances_pressure_and_fold(create_grower: Create, gauge_kpa: float) -> None:
    """The work of the tail is that against the pressure and that of folding: T 2 dL = p A dL + F_inv dL."""
    inversion_kpa = 9.9
    robot = create_grower({"retraction_buckling.inversion_yield_kpa": inversion_kpa})
    pressure = gauge_kpa * KPA
    start = robot.reset(everted_length=0.050, pressure=pressure)
    command = Command(tail_feed_velocity=-5.8e-3, pressure=pressure)
    work, fed = 0.0, float(robot.state.scalar[Scalar.FED_LENGTH])
    for _ in range(16):
        reading = robot.advance(command, 0.125)
        assert not reading.buckled
        now = float(robot.state.scalar[Scalar.FED_LENGTH])
        work += reading.tail_tension * (fed - now)
        fed = now
    inverted = start.everted_length - reading.everted_length
    assert inverted == pytest.approx(0.5 * 5.8e-3 * 2.0, rel=1e-9)  # all the tail that was pulled came out of the wall
    force = AREA * (pressure + inversion_kpa * KPA)
    # 2 % as asked for; measured 1e-12.
    assert work == pytest.approx(force * inverted, rel=0.02)
    assert reading.tail_tension == pytest.approx(0.5 * force, rel=0.02)


def test_slack_comes_out_before_the_wall_inverts(create_grower: Create) -> None:
    robot = create_grower({"eversion_yield.static_kpa": 30.0, "eversion_yield.kinetic_kpa": 30.0})
    robot.reset(everted_length=0.050, pressure=5.0 * KPA)
    fed = robot.advance(Command(tail_feed_velocity=4e-3, pressure=5.0 * KPA), 1.0)
    assert fed.everted_length == 0.050
    assert fed.slack == pytest.approx(4e-3, abs=1e-9)
    slack = robot.advance(Command(tail_feed_velocity=-4e-3, pressure=5.0 * KPA), 0.75)
    assert (slack.everted_length, slack.tail_tension) == (0.050, 0.0)
    assert slack.slack == pytest.approx(1e-3, abs=1e-9)
    wall = robot.advance(Command(tail_feed_velocity=-4e-3, pressure=5.0 * KPA), 0.75)
    assert wall.slack == 0.0
    assert wall.everted_length == pytest.approx(0.049, abs=1e-9)
    assert wall.tail_tension > 0.0


def _find_buckling_tension(robot: Simulator, length: float) -> float:
    """Return the tail tension [N] at which a robot of ``length`` [m] buckles, by bisection over the pressure."""
    low, high = 0.0, 200.0 * KPA
    for _ in range(30):
        pressure = 0.5 * (low + high)
        robot.reset(everted_length=length, pressure=pressure)
        reading = robot.advance(Command(tail_feed_velocity=-1e-4, insertion_velocity=0.0, pressure=pressure), 0.1)
        assert reading.buckled == (reading.everted_length == length)  # it buckles or it inverts
        low, high = (low, pressure) if reading.buckled else (pressure, high)
    return 0.5 * low * AREA


@pytest.mark.parametrize(("length", "row"), [(0.095, 0.030), (0.050, 0.11)])
def test_sheath_buckles_at_fichters_load(create_grower: Create, length: float, row: float) -> None:
    robot = create_grower({"retraction_buckling.inversion_yield_kpa": 0.0})
    tension = _find_buckling_tension(robot, length)
    radius, wall, modulus = 1.5e-3, 35e-6, 3e8
    euler = math.pi**2 * modulus * math.pi * radius**3 * wall / (2.0 * length) ** 2
    shear = 2.0 * tension + modulus / (2.0 * 1.42) * math.pi * radius * wall
    # The bisection's 200 kPa / 2^30 apart, the law is met exactly.
    assert tension == pytest.approx(euler * shear / (euler + shear), rel=1e-4)
    assert tension == pytest.approx(row, rel=0.02)  # the catalogue's two digits


def test_catheter_carries_its_euler_load(create_grower: Create) -> None:
    """Row 10: the catheter alone carries 0.12 N; inside the sheath both stiffnesses add up."""
    robot = create_grower({"retraction_buckling.inversion_yield_kpa": 0.0}, setup="full")
    parameters = robot.parameters.effects.retraction_buckling
    catheter = compute_axial_limit(parameters, 4.23e-4, 0.095, 0.0)
    assert catheter == pytest.approx(0.12, rel=0.05)  # two digits, and 4.2 to 4.5e-4 N m^2 for the stiffness
    sheath = _find_buckling_tension(create_grower({"retraction_buckling.inversion_yield_kpa": 0.0}), 0.095)
    # The shear term, in both alone and together: below 1 % of the load.
    assert _find_buckling_tension(robot, 0.095) == pytest.approx(catheter + sheath, rel=0.01)


def test_buckled_robot_does_not_shorten_but_bends(create_grower: Create) -> None:
    robot = create_grower({"retraction_buckling.inversion_yield_kpa": 9.9})
    pressure = 20.0 * KPA
    robot.reset(everted_length=0.095, pressure=pressure)
    straight = robot.advance(Command(pressure=pressure), 1.0)
    buckled = robot.advance(Command(tail_feed_velocity=-5.8e-3, pressure=pressure), 1.0)
    assert buckled.buckled
    assert buckled.everted_length == 0.095
    assert np.linalg.norm((buckled.tip_position - straight.tip_position)[:2]) > 1e-3
    freed = robot.advance(Command(pressure=pressure), 5.0)
    assert not freed.buckled
    np.testing.assert_allclose(freed.tip_position, straight.tip_position, atol=1e-6)  # elastic; 5 s of implicit steps


def test_capstan_friction_adds_to_the_inversion_tension(create_grower: Create) -> None:
    tensions = []
    for mu in (0.0, 0.2):
        robot = create_grower({"tail_capstan_friction.mu": mu}, setup="full")
        robot.reset(everted_length=0.060, pressure=5.0 * KPA, tendon_pull=4.9e-3)
        tangent = robot.shape().tangent
        command = Command(tail_feed_velocity=-1e-4, insertion_velocity=0.0, pressure=5.0 * KPA, tendon_pull=4.9e-3)
        reading = robot.advance(command, 0.125)
        assert not reading.buckled
        tensions.append(reading.tail_tension)
    turn = np.arccos(np.clip(np.sum(tangent[1:] * tangent[:-1], axis=1), -1.0, 1.0)).sum()
    assert turn > 0.5
    # The robot unrolls a little in the first step: 0.1 % of the turn.
    assert math.log(tensions[1] / tensions[0]) == pytest.approx(0.2 * turn, rel=1e-2)


@pytest.mark.parametrize("slip", [0.0, 0.492])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_tail_account(create_grower: Create, slip: float, seed: int) -> None:
    """Fed material is twice the everted length plus slack, whatever is commanded, and follows the drive.

    The account is kept outside: what the drive may have moved is its command times the time; the wall's and the
    slack's share of it are read off the robot.
    """
    generator = np.random.default_rng(seed)
    robot = create_grower(
        {
            "feed_limit.slip": slip,
            "eversion_yield.static_kpa": 13.7,
            "eversion_yield.kinetic_kpa": 9.9,
            "tail_coulomb_friction.yield_growth_per_mm": 0.0217,
            "tail_capstan_friction.mu": 0.1,
            "pressure_lag.time_s": 0.15,
            "retraction_buckling.inversion_yield_kpa": 15.0,  # so high that some of the pulls buckle the robot
            "tail_catheter_friction.mu": 0.005,
            "saline_weight.share": 1.0,
            "robot.catheter_damping_time_ms": 5.0,
        },
        setup="full",
        section_mm=5.0,
        tolerance_j=1e-10,
    )
    reading = robot.reset(everted_length=0.050, catheter_length=0.015)
    scalar = robot.state.scalar
    kinds = {"laid in": 0, "taut": 0, "slack out": 0, "inverted": 0, "buckled": 0}
    duration = 0.125  # one substep
    for step in range(800):
        forward = step // 100 % 2 == 0  # on the whole, and then back
        feed = (0.002 if forward else -0.004) + generator.uniform(-0.01, 0.01)
        pressure = float(generator.choice([20.0, 50.0, 50.0] if forward else [0.0, 5.0, 10.0, 20.0])) * KPA
        before, before_fed = reading, float(scalar[Scalar.FED_LENGTH])
        reading = robot.advance(
            Command(insertion_velocity=generator.uniform(-0.005, 0.005), tail_feed_velocity=feed, pressure=pressure),
            duration,
        )
        fed = float(scalar[Scalar.FED_LENGTH])
        assert fed == pytest.approx(2.0 * reading.everted_length + reading.slack, abs=1e-9)  # as in the benchmark
        assert (
            fed - 2.0 * reading.everted_length > -1e-12
        )  # never negative, to rounding; the reading's slack is cut at zero
        assert reading.slack >= 0.0
        assert reading.everted_length <= 0.140
        moved, commanded = fed - before_fed, feed * duration
        if feed >= 0.0:
            # The drive may slip (a taut tail) or have no material left, but never gives more than it turns, nor takes.
            assert -1e-12 <= moved <= commanded + 1e-12
            if reading.slack > 0.0 and before.slack > 0.0 and fed < 0.280 - 1e-12:
                assert moved == pytest.approx(commanded, abs=1e-9)
                kinds["laid in"] += 1
            elif reading.everted_length > before.everted_length:
                kinds["taut"] += 1
        elif reading.buckled:
            assert commanded - 1e-12 <= moved <= 0.0
            kinds["buckled"] += 1
        elif reading.everted_length > 2e-3 + 1e-12:
            assert moved == pytest.approx(commanded, abs=1e-9)
            kinds["inverted" if reading.everted_length < before.everted_length else "slack out"] += 1
    # The commands were varied enough to see every case, or the test would prove little.
    assert min(kinds.values()) >= 3, kinds
