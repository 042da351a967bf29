"""Rods in closed form: benchmarks B1 to B4 and B21.

The rod is the bare catheter: 40 links, bending stiffness 4.3e-4 N m^2 from its four fibres, no sheath.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from evergym.simulator import Command, Simulator
from evergym.world import World

STIFFNESS = 4.3e-4
LENGTH = 0.095
RESULTANT = STIFFNESS / LENGTH**2
"""EI / L^2 [N]: the unit of the loads."""

Create = Callable[..., Simulator]


@pytest.fixture
def rod(create_robot: Create) -> Simulator:
    return create_robot({"robot.catheter_bending_stiffness_n_m2": STIFFNESS})


def test_small_tip_load_bends_a_cantilever_by_the_linear_law(rod: Simulator) -> None:
    load = 0.05 * RESULTANT
    reading = rod.advance(Command(tip_load=(load, 0.0, 0.0)), 5.0)
    angle = math.atan2(reading.tip_direction[0], reading.tip_direction[2])
    # 0.1 %: the elastica itself is 0.04 % below the linear law at this load, 40 links add 0.01 %.
    assert reading.tip_position[0] == pytest.approx(load * LENGTH**3 / (3.0 * STIFFNESS), rel=1e-3)
    assert angle == pytest.approx(load * LENGTH**2 / (2.0 * STIFFNESS), rel=1e-3)


@pytest.mark.parametrize(
    ("load", "along", "across", "angle_deg"),
    [
        (0.5, 0.984081, 0.162144, 14.0108),
        (1.0, 0.943567, 0.301721, 26.4335),
        (2.0, 0.839358, 0.493457, 44.7910),
        (3.0, 0.745580, 0.603253, 56.4946),
        (5.0, 0.612372, 0.713792, 69.6355),
        (10.0, 0.445004, 0.810609, 81.9493),
    ],
)
@pytest.mark.parametrize(
    "direction_deg", [0.0, 50.0]
)  # towards the tendon's side: away from it the tendon would resist
def test_dead_load_bends_the_elastica(
    rod: Simulator, load: float, along: float, across: float, angle_deg: float, direction_deg: float
) -> None:
    side = np.array([math.cos(math.radians(direction_deg)), math.sin(math.radians(direction_deg)), 0.0])
    reading = rod.advance(Command(tip_load=tuple(load * RESULTANT * side)), 40.0)
    # 1e-3 L and 0.1 deg as in the benchmark; 40 links are within 7e-5 L and 0.012 deg.
    assert reading.tip_position[2] / LENGTH == pytest.approx(along, abs=1e-3)
    assert reading.tip_position @ side / LENGTH == pytest.approx(across, abs=1e-3)
    angle = math.degrees(math.acos(reading.tip_direction[2]))
    assert angle == pytest.approx(angle_deg, abs=0.1)
    # The root moment is the load times its lever: curvature at the root a x / L, read half a link inside.
    bend = np.hypot(*rod.state.bend[0])
    lever = reading.tip_position[2] - 0.5 * rod.state.length[0]
    assert bend / rod.state.length[0] * STIFFNESS == pytest.approx(load * RESULTANT * lever, rel=1e-3)


@pytest.mark.parametrize("turns", [0.25, 0.5, 1.0])
def test_end_moment_bends_a_circle(rod: Simulator, turns: float) -> None:
    # A tendon at a constant arm loads the catheter with the moment tension x arm, the same at every section.
    arm = rod.parameters.robot.tendon_arm
    compliance = rod.parameters.effects.tendon_stretch.compliance
    curvature = 2.0 * math.pi * turns / LENGTH
    pull = curvature * arm * LENGTH + curvature * STIFFNESS / arm * compliance
    reading = rod.advance(Command(tendon_pull=pull), 10.0)
    assert reading.tendon_tension * arm == pytest.approx(curvature * STIFFNESS, rel=1e-6)  # solver tolerance
    angle = curvature * LENGTH
    tip = np.array([(1.0 - math.cos(angle)) / angle, 0.0, math.sin(angle) / angle])
    # 1e-3 L as in the benchmark; a polygon of 40 sides closes exactly and is 7e-5 L off at a quarter turn.
    np.testing.assert_allclose(reading.tip_position / LENGTH, tip, atol=1e-3)


@pytest.mark.parametrize(
    ("weight", "along", "down", "angle_deg"),
    [
        (0.5, 0.997779, 0.062306, 4.7634),
        (1.0, 0.991246, 0.123471, 9.4604),
        (2.0, 0.966893, 0.238507, 18.4260),
        (5.0, 0.846657, 0.495905, 39.9354),
        (10.0, 0.656354, 0.700200, 60.3120),
        (20.0, 0.445232, 0.829881, 76.7478),
    ],
)
def test_heavy_cantilever_sags(
    create_robot: Create, weight: float, along: float, down: float, angle_deg: float
) -> None:
    changes = {"robot.catheter_bending_stiffness_n_m2": STIFFNESS, "saline_weight.share": 1.0}
    mass = create_robot(changes).parameters.robot.catheter_mass
    gravity = weight * STIFFNESS / LENGTH**3 / mass
    rod = create_robot(changes, world=World.free(gravity=(0.0, -gravity, 0.0)))
    reading = rod.advance(Command(), 5.0)
    # 1e-3 L as in the benchmark; 0.1 deg as in B2. 40 links are within 5e-5 L and 0.025 deg.
    assert reading.tip_position[2] / LENGTH == pytest.approx(along, abs=1e-3)
    assert -reading.tip_position[1] / LENGTH == pytest.approx(down, abs=1e-3)
    assert math.degrees(math.acos(reading.tip_direction[2])) == pytest.approx(angle_deg, abs=0.1)


@pytest.mark.parametrize(
    ("load_deg", "direction_deg", "magnitude"),
    [(30.0, 2.204, 0.8667), (45.0, 3.814, 0.7087), (60.0, 6.587, 0.5033)],
)
@pytest.mark.parametrize("roll_deg", [0.0, 75.0])
def test_notched_catheter_gives_way_towards_its_soft_plane(
    create_robot: Create, load_deg: float, direction_deg: float, magnitude: float, roll_deg: float
) -> None:
    rod = create_robot({"robot.catheter_bending_stiffness_n_m2": STIFFNESS, "robot.catheter_anisotropy": 15.0})
    load = 0.001 * RESULTANT  # so small that the rod stays linear
    angle = math.radians(load_deg + roll_deg)
    tip_load = (load * math.cos(angle), load * math.sin(angle), 0.0)
    reading = rod.advance(Command(roll=math.radians(roll_deg), tip_load=tip_load), 5.0)
    x, y, _ = reading.tip_position
    # 0.1 deg and 0.1 % as in the benchmarks; the digits of the closed form are the larger error.
    assert math.degrees(math.atan2(y, x)) - roll_deg == pytest.approx(direction_deg, abs=0.1)
    assert math.hypot(x, y) / (load * LENGTH**3 / (3.0 * STIFFNESS)) == pytest.approx(magnitude, rel=1e-3)
