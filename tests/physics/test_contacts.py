"""Contact forces against closed forms (benchmark B23 among them): balance, indentation, Coulomb's law."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from evergym.contact import add_friction
from evergym.duct_models.field import WallField
from evergym.simulator import Command, Simulator
from evergym.world import World

LENGTH = 0.095
RADIUS = 0.925e-3
SOFT = {"robot.catheter_bending_stiffness_n_m2": 1e-8, "saline_weight.share": 1.0}
"""A catheter so limp (3e-7 N for 1 mm) that the port carries nothing."""
DOWN = np.array([0.0, -9.81, 0.0])

Create = Callable[..., Simulator]
CreatePlane = Callable[..., WallField]


def _compute_indentation(force: float, length: float, stiffness: float = 30e3, depth: float = 0.5e-3) -> float:
    """Return the depth d [m] at which k' d (1 + (d / depth)^2) over a length [m] carries a force [N]."""
    return float(brentq(lambda d: stiffness * length * d * (1.0 + (d / depth) ** 2) - force, 0.0, 10e-3, xtol=1e-15))


def test_robot_lies_on_a_plane_with_its_weight(create_robot: Create, create_plane: CreatePlane) -> None:
    weight = 9.81 * create_robot().parameters.robot.catheter_mass  # per length [N/m]
    settled = _compute_indentation(weight, 1.0)
    # The port is as deep in the plane as the robot settles, so that it lies straight.
    world = World(wall=create_plane((0.0, 1.0, 0.0), settled - RADIUS), gravity=DOWN)
    robot = create_robot(SOFT, section_mm=2.5, world=world, tolerance_j=1e-18)
    reading = robot.advance(Command(), 5.0)
    force = robot.contacts().force
    # Half a link's weight is the port's. What bends at the two ends carries less than 1e-4 of the load.
    total = weight * (LENGTH - 1.25e-3)
    np.testing.assert_allclose(force.sum(axis=0), [0.0, total, 0.0], rtol=1e-4, atol=1e-9)
    assert reading.wall_force_sum == pytest.approx(total, rel=1e-4)
    assert reading.contact_count == 38
    # Sections away from the ends carry a link's weight each, at the depth of the tissue's law.
    np.testing.assert_allclose(force[5:30, 1], weight * 2.5e-3, rtol=1e-3)
    np.testing.assert_allclose(robot.state.depth[6:31], settled, rtol=1e-3)


@pytest.mark.parametrize("load", [0.01, 0.05])
def test_tip_load_bears_on_the_plane(create_robot: Create, create_plane: CreatePlane, load: float) -> None:
    normal = np.array([0.6, 0.8, 0.0])
    world = World(wall=create_plane(normal, -RADIUS), gravity=np.zeros(3))
    robot = create_robot({**SOFT, "saline_weight.share": 0.0}, section_mm=2.5, world=world, tolerance_j=1e-18)
    reading = robot.advance(Command(tip_load=tuple(-load * normal)), 10.0)
    # The limp robot passes nothing to the port: 1e-3 of the load is what it takes to bend it into the dent.
    np.testing.assert_allclose(robot.contacts().force.sum(axis=0), load * normal, atol=1e-3 * load)
    # Each section's force and depth obey the tissue's law over the length that bears on it; at the rounded tip a radius
    # more.
    tributary = np.full(38, 2.5e-3)
    tributary[-1] = 1.25e-3 + RADIUS
    depth = robot.state.depth[1:39]
    law = 30e3 * tributary * depth * (1.0 + (depth / 0.5e-3) ** 2)
    np.testing.assert_allclose(robot.state.contact_force[1:39] @ normal, law, atol=1e-9 * load)
    assert reading.penetration_max == depth.max() == depth[-1]
    # Depth is geometry: radius less the distance of the rounded tip's centre.
    centre = reading.tip_position - RADIUS * reading.tip_direction
    assert depth[-1] == pytest.approx(RADIUS - (centre @ normal + RADIUS), rel=1e-9)


@pytest.mark.parametrize("section_mm", [2.5, 1.25])
def test_point_contact_bends_the_rod_beyond_it(create_robot: Create, section_mm: float) -> None:
    """B23: 10 mN at 60 mm give the tip 3.1395 mm and 2.398 deg."""
    stiffness, load, place, peg_radius = 4.3e-4, 0.010, 0.060, 2.5e-3
    dent = load / (2e6 * section_mm * 1e-3)
    # The peg stands where it pushes the rod aside by what 10 mN give there.
    x = load * place**3 / (3.0 * stiffness) + dent - peg_radius - RADIUS
    world = World(pegs=np.array([[x, 0.0, place, 0.0, 1.0, 0.0, peg_radius]]), gravity=np.zeros(3))
    changes = {"robot.catheter_bending_stiffness_n_m2": stiffness, "contact_friction.mu_peg": 0.2}
    robot = create_robot(changes, section_mm=section_mm, world=world)
    reading = robot.advance(Command(), 10.0)
    assert reading.contact_count == 1
    angle = math.degrees(math.atan2(reading.tip_direction[0], reading.tip_direction[2]))
    # 0.5 % as in the benchmark; large rotations and the peg's round make 0.1 %.
    assert reading.wall_force_sum == pytest.approx(load, rel=5e-3)
    assert reading.tip_position[0] == pytest.approx(3.1395e-3, rel=5e-3)
    assert angle == pytest.approx(2.398, rel=5e-3)
    # The peg's spring is there to be rigid: 10 mN dent it by micrometres.
    assert reading.penetration_max <= 5e-6
    normal_force = robot.contacts().force[0]
    assert robot.state.friction_limit.max() == pytest.approx(0.2 * np.linalg.norm(normal_force), rel=1e-9)


def test_cord_around_a_peg_bears_on_it_with_both_its_tensions(create_robot: Create) -> None:
    """A limp robot hangs over a round peg: without friction its tension is the load on both sides, towards the port
    and down.
    """
    load, peg_radius = 0.020, 5e-3
    world = World(pegs=np.array([[0.0, -peg_radius - RADIUS, 0.0475, 1.0, 0.0, 0.0, peg_radius]]), gravity=np.zeros(3))
    robot = create_robot({**SOFT, "saline_weight.share": 0.0}, section_mm=0.5, world=world, step_s=0.05)
    # Load it slowly: laid down in one step, a cord without stiffness would end up on whichever side of the peg.
    for part in np.geomspace(1e-4, 1.0, 40):
        robot.advance(Command(tip_load=(0.0, -part * load, 0.0)), 0.1)
    reading = robot.advance(Command(tip_load=(0.0, -load, 0.0)), 5.0)
    assert reading.tip_direction[1] < -0.999
    # 1 %: the links turn in steps of 5 deg around the circle, and the first and last contact lie up to half of that
    # off.
    np.testing.assert_allclose(robot.contacts().force.sum(axis=0), [0.0, load, load], atol=0.01 * load)


@given(
    limit=st.floats(1e-6, 1.0),
    motion=st.tuples(*[st.floats(-1e-2, 1e-2)] * 3),
    angle=st.tuples(st.floats(0.0, math.pi), st.floats(0.0, 2.0 * math.pi)),
)
def test_friction_never_exceeds_its_limit_nor_helps(
    limit: float, motion: tuple[float, float, float], angle: tuple[float, float]
) -> None:
    polar, azimuth = angle
    normal = np.array([math.sin(polar) * math.cos(azimuth), math.sin(polar) * math.sin(azimuth), math.cos(polar)])
    gradient, hessian = np.zeros(3), np.zeros((3, 3))
    energy = add_friction(limit, normal, np.array(motion), np.zeros(3), 1e-5, gradient, hessian)
    assert np.linalg.norm(gradient) <= limit * (1.0 + 1e-12)  # |F_t| <= mu N, to rounding
    assert gradient @ normal == pytest.approx(0.0, abs=1e-12 * limit)
    assert gradient @ np.array(motion) >= -1e-15 * limit  # it opposes the motion
    assert energy >= 0.0
    assert np.linalg.eigvalsh(hessian).min() >= -1e-9 * limit / 1e-5  # convex


@pytest.mark.parametrize("mu", [0.1, 0.3])
def test_rod_on_a_plane_breaks_away_at_coulombs_force(
    create_robot: Create, create_plane: CreatePlane, mu: float
) -> None:
    """A stiff rod on a limp hinge lies on a plane: a force across its tip turns it from F L = mu w L^2 / 2 on."""
    changes = {
        "robot.catheter_bending_stiffness_n_m2": 0.1,
        "robot.catheter_flexible_length_mm": 93.0,  # the first link is the hinge
        "robot.catheter_proximal_stiffness_n_m2": 1e-8,
        "saline_weight.share": 1.0,
        "contact_friction.mu_tissue": mu,
        "contact_friction.sliding_speed_mm_s": 1e-3,  # below it, it creeps
    }
    world = World(wall=create_plane((0.0, 1.0, 0.0), -RADIUS), gravity=DOWN)
    robot = create_robot(changes, section_mm=2.0, world=world, step_s=0.05)
    robot.advance(Command(), 1.0)
    critical = 0.5 * mu * 9.81 * robot.parameters.robot.catheter_mass * LENGTH
    moved = []
    for share in (0.97, 1.03):
        start = robot.reading.tip_position[0]
        moved.append(robot.advance(Command(tip_load=(share * critical, 0.0, 0.0)), 0.5).tip_position[0] - start)
    assert moved[0] < 10e-6  # creeps: 4 um
    assert moved[1] > 2e-3  # gives way


def test_wall_damping_presses_but_never_pulls(create_robot: Create, create_plane: CreatePlane) -> None:
    world = World(wall=create_plane((0.0, 1.0, 0.0), -RADIUS), gravity=np.zeros(3))
    robot = create_robot({"duct_compliance.damping_time_s": 1.0}, world=world, step_s=0.01)
    for load in (-0.05, 0.05):
        for _ in range(20):
            robot.advance(Command(tip_load=(0.0, load, 0.0)), 0.01)
            assert robot.state.contact_force[:, 1].min() >= 0.0
