"""Invariances (benchmark B24): what must change nothing changes nothing."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from evergym.model import Numerics, load_model
from evergym.simulator import Command, Simulator
from evergym.world import World

TOLERANCE = 1e-9
"""Of the benchmark [m]."""

Create = Callable[..., Simulator]


def test_turning_robot_and_gravity_together_changes_nothing() -> None:
    """With every effect on, over growth, roll, tendon, pressure and a tip load."""
    gravity = np.array([3.0, -9.0, 1.0])
    results = []
    for turn in (np.eye(3), Rotation.from_rotvec([0.4, -1.0, 0.7]).as_matrix(), np.diag([-1.0, 1.0, -1.0])):
        world = World.free(gravity=turn @ gravity, port_frame=turn)
        robot = Simulator(load_model("mammobot_2023"), world, Numerics(energy_tolerance_j=1e-16))
        robot.reset(everted_length=0.030, pressure=30e3)
        for k in range(40):
            command = Command(
                insertion_velocity=2e-3,
                tail_feed_velocity=6e-3,
                roll=0.05 * k,
                tendon_pull=1.2e-4 * k,
                pressure=40e3,
                tip_load=tuple(turn @ np.array([0.01, 0.02, -0.01])),
            )
            reading = robot.advance(command, 0.25)
        results.append((turn.T @ reading.tip_position, turn.T @ reading.tip_direction, reading.everted_length))
    for position, direction, length in results[1:]:
        np.testing.assert_allclose(position, results[0][0], atol=TOLERANCE)
        np.testing.assert_allclose(direction, results[0][1], atol=1e-7)  # 1e-9 m over some 10 mm
        assert length == pytest.approx(results[0][2], abs=TOLERANCE)
    assert abs(results[0][0][0]) > 5e-3  # it has bent


def test_nothing_loaded_is_straight(create_robot: Create) -> None:
    for setup in ("catheter", "sheath", "full"):
        robot = create_robot(setup=setup)
        robot.reset(everted_length=0.095, pressure=9e3)
        reading = robot.advance(Command(pressure=9e3), 2.0)
        np.testing.assert_allclose(reading.tip_position, [0.0, 0.0, reading.tip_position[2]], atol=TOLERANCE)
        assert reading.tip_position[2] == pytest.approx(
            max(reading.everted_length, reading.catheter_length), abs=TOLERANCE
        )


@pytest.mark.parametrize("roll", [0.0, 2.0])
def test_nothing_loaded_is_pre_curved(create_robot: Create, roll: float) -> None:
    robot = create_robot({"pre_curvature.curvature_1_per_m": 2.2, "robot.catheter_anisotropy": 15.0})
    reading = robot.advance(Command(roll=roll), 5.0)
    angle = 2.2 * 0.095
    direction = [math.sin(angle) * math.cos(roll), math.sin(angle) * math.sin(roll), math.cos(angle)]
    np.testing.assert_allclose(reading.tip_direction, direction, atol=1e-7)  # 1e-9 m over some 10 mm
    across, along = (1.0 - math.cos(angle)) / 2.2, math.sin(angle) / 2.2
    # A polygon of 40 sides on the circle: h^2 kappa^2 / 24 = 1.1e-6 of the length.
    np.testing.assert_allclose(
        reading.tip_position, [across * math.cos(roll), across * math.sin(roll), along], atol=2e-6 * 0.095
    )


@pytest.mark.parametrize("setup", ["catheter", "full"])
def test_base_rotation_turns_the_tip_when_nothing_pulls_down(create_robot: Create, setup: str) -> None:
    changes = {
        "pre_curvature.curvature_1_per_m": 2.2,
        "robot.catheter_anisotropy": 15.0,
        "eversion_yield.static_kpa": 1000.0,
        "eversion_yield.kinetic_kpa": 1000.0,
    }
    robot = create_robot(changes, setup=setup)
    robot.reset(everted_length=0.095, pressure=20e3, tendon_pull=2e-3)
    start = robot.advance(Command(tendon_pull=2e-3, pressure=20e3), 20.0).tip_position
    # In the sheath, a turn by which its 12 fibres fall on each other: 60 deg.
    turned = robot.advance(Command(tendon_pull=2e-3, pressure=20e3, roll=math.pi / 3.0), 20.0).tip_position
    expected = Rotation.from_rotvec([0.0, 0.0, math.pi / 3.0]).apply(start)
    assert np.linalg.norm(start[:2]) > 0.01
    np.testing.assert_allclose(turned, expected, atol=TOLERANCE)


def test_reciprocity_of_a_loaded_robot(create_robot: Create) -> None:
    """delta_ij = delta_ji: the compliance of a bent, rolled, inflated, sagging, wrinkled robot at its tip is
    symmetric.
    """
    changes = {
        "robot.catheter_anisotropy": 15.0,
        "pre_curvature.curvature_1_per_m": 2.2,
        "saline_weight.share": 1.0,
        "eversion_yield.static_kpa": 1000.0,
        "eversion_yield.kinetic_kpa": 1000.0,
    }
    robot = create_robot(changes, setup="full", tolerance_j=1e-18)
    robot.reset(everted_length=0.095, pressure=12e3, tendon_pull=3e-3, roll=0.6)
    load = 1e-4
    moved = np.zeros((3, 3))
    for axis in range(3):
        for sign in (1.0, -1.0):
            tip_load = [0.0, 0.0, 0.0]
            tip_load[axis] = sign * load
            command = Command(tendon_pull=3e-3, roll=0.6, pressure=12e3, tip_load=tuple(tip_load))
            moved[:, axis] += 0.5 * sign * robot.advance(command, 6.0).tip_position
    assert np.abs(moved).max() > 1e-5
    np.testing.assert_allclose(moved, moved.T, atol=TOLERANCE)
    assert np.linalg.eigvalsh(0.5 * (moved + moved.T)).min() > 0.0
