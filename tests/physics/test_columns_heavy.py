"""Columns that carry their weight, that have already given way, or that a side load bends, and a hanging cord:
benchmarks B6, B7, B8 and B15.

The rod is the bare catheter. Side loads point towards the tendon's side, where it stays slack.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy import optimize

from evergym.simulator import Command, Simulator
from evergym.world import World

STIFFNESS = 4.3e-4
LENGTH = 0.095
EULER_LOAD = 0.25 * math.pi**2 * STIFFNESS / LENGTH**2
"""Of the column that is fixed at one end and free at the other [N]."""
STANDING = {"robot.catheter_bending_stiffness_n_m2": STIFFNESS, "saline_weight.share": 1.0}

Create = Callable[..., Simulator]


def _stand(create_robot: Create, weight: float, lean: float) -> float:
    """Return the tip's deflection [m] of a rod with w L^3 / EI = ``weight`` that stands on the port."""
    mass = create_robot(STANDING).parameters.robot.catheter_mass
    gravity = weight * STIFFNESS / LENGTH**3 / mass
    rod = create_robot(STANDING, world=World.free(gravity=(lean * gravity, 0.0, -gravity)))
    return float(rod.advance(Command(), 100.0).tip_position[0])


def test_column_gives_way_under_its_own_weight(create_robot: Create) -> None:
    """B6, Greenhill: w L^3 / EI = 7.83735, by Southwell's line over the weight."""
    weights = np.array([0.97, 0.985]) * 7.83735
    deflection = np.array([_stand(create_robot, weight, 1e-6 * weights[0] / weight) for weight in weights])
    critical = np.diff(deflection)[0] / np.diff(deflection / weights)[0]
    assert critical == pytest.approx(7.83735, rel=0.01)  # as in the benchmark; measured 0.07 %


def test_heavy_column_stands_below_greenhills_weight_and_falls_above(create_robot: Create) -> None:
    assert _stand(create_robot, 0.98 * 7.83735, 1e-5) < 0.01 * LENGTH
    assert _stand(create_robot, 1.02 * 7.83735, 1e-5) > 0.1 * LENGTH


@pytest.mark.parametrize(
    ("angle_deg", "load", "along", "across"),
    [(20.0, 1.01540, 0.96973, 0.21941), (60.0, 1.15172, 0.74102, 0.59321), (120.0, 1.88480, 0.12316, 0.80317)],
)
def test_buckled_column_bends_further_as_the_elastica(
    create_robot: Create, angle_deg: float, load: float, along: float, across: float
) -> None:
    """B7: the load at which the tip of a column that has given way points in a given direction."""
    rod = create_robot({"robot.catheter_bending_stiffness_n_m2": STIFFNESS}, section_mm=LENGTH * 1e3 / 80.0)
    # Pushed over first, so that every trial starts on the bent branch.
    rod.advance(Command(tip_load=(0.2 * EULER_LOAD, 0.0, -load * EULER_LOAD)), 20.0)

    def miss(trial: float) -> float:
        # A thousandth of a percent to the side chooses the branch; it moves the load at 20 deg by 0.003 %.
        reading = rod.advance(Command(tip_load=(1e-5 * EULER_LOAD, 0.0, -trial * EULER_LOAD)), 200.0)
        return math.degrees(math.atan2(reading.tip_direction[0], reading.tip_direction[2])) - angle_deg

    found = optimize.brentq(miss, load - 0.02, load + 0.02, xtol=1e-7)
    tip = rod.reading.tip_position / LENGTH
    # 0.5 % as in the benchmark; 80 links: 0.004 % of the load, 0.06 % of the place.
    assert found == pytest.approx(load, rel=5e-3)
    assert (tip[2], tip[0]) == pytest.approx((along, across), rel=5e-3)


@pytest.mark.parametrize(("share", "amplification"), [(0.25, 1.3289), (0.5, 1.9863), (0.75, 3.9578)])
def test_thrust_amplifies_what_a_side_load_does(create_robot: Create, share: float, amplification: float) -> None:
    """B8: 3 (tan u - u) / u^3, u = (pi / 2) sqrt(P / P_cr)."""
    rod = create_robot({"robot.catheter_bending_stiffness_n_m2": STIFFNESS})
    load = 1e-4 * EULER_LOAD  # so small that the rod stays linear
    u = 0.5 * math.pi * math.sqrt(share)
    assert 3.0 * (math.tan(u) - u) / u**3 == pytest.approx(amplification, rel=1e-4)  # the table's digits
    reading = rod.advance(Command(tip_load=(load, 0.0, -share * EULER_LOAD)), 20.0)
    linear = load * LENGTH**3 / (3.0 * STIFFNESS)
    assert reading.tip_position[0] / linear == pytest.approx(amplification, rel=0.01)  # as in the benchmark; 0.1 %


def test_tension_holds_back_what_a_side_load_does(create_robot: Create) -> None:
    """The same law with the sign of the thrust turned: 3 (u - tanh u) / u^3."""
    rod = create_robot({"robot.catheter_bending_stiffness_n_m2": STIFFNESS})
    load, share = 1e-4 * EULER_LOAD, 4.0
    u = 0.5 * math.pi * math.sqrt(share)
    reading = rod.advance(Command(tip_load=(load, 0.0, share * EULER_LOAD)), 20.0)
    linear = load * LENGTH**3 / (3.0 * STIFFNESS)
    assert reading.tip_position[0] / linear == pytest.approx(3.0 * (u - math.tanh(u)) / u**3, rel=1e-3)


def _hang_cord(create_robot: Create, gravity: float) -> np.ndarray:
    """Return the horizontal and vertical force on the far support over the weight per length [m], the sag [m] and the
    end's slope [rad] of a cord of 0.10 m over a span of 0.08 m: the force that holds its free end there is looked for.
    """
    length, span, slope = 0.100, 0.080, math.radians(55.925)
    changes = {
        **STANDING,
        "robot.catheter_bending_stiffness_n_m2": 1e-8,
        "robot.catheter_length_mm": length * 1e3,
        "robot.catheter_flexible_length_mm": length * 1e3,
        "robot.catheter_damping_time_ms": 5.0,  # something to hold on to on the way: it has no say at rest
    }
    # The port points along the catenary's end slope, below the horizontal (x): no boundary layer of bending there.
    direction = np.array([math.cos(slope), 0.0, -math.sin(slope)])
    frame = np.column_stack([np.cross([0.0, -1.0, 0.0], direction), [0.0, -1.0, 0.0], direction])
    world = World.free(gravity=(0.0, 0.0, -gravity), port_frame=frame)
    cord = create_robot(changes, section_mm=length * 1e3 / 200.0, world=world, step_s=0.05)
    weight = cord.parameters.robot.catheter_mass * gravity

    def miss(force: np.ndarray) -> np.ndarray:
        load = weight * length * force
        tip = cord.advance(Command(tip_load=(float(load[0]), 0.0, float(load[1]))), 20.0).tip_position
        return np.array([tip[0] - span, tip[2]]) / length

    solution = optimize.root(miss, np.array([0.5, 0.4]), options={"eps": 1e-4, "xtol": 1e-8})
    assert np.abs(miss(solution.x)).max() < 1e-8
    tip = cord.reading.tip_direction
    sag = -cord.shape().position[:, 2].min()
    return np.array([*(solution.x * length), sag, math.atan2(tip[2], tip[0])])


def test_cord_between_two_supports_hangs_as_the_catenary(create_robot: Create) -> None:
    """B15, for EI -> 0: w L^3 / EI = 8.6e4 and twice that, by a weight that no cord has."""
    light, heavy = _hang_cord(create_robot, 300.0), _hang_cord(create_robot, 600.0)
    horizontal, vertical, sag, _ = heavy
    # 0.1 % as in the benchmark; the bending stiffness that is left takes 0.016 %.
    assert horizontal == pytest.approx(0.033820, rel=1e-3)  # the catenary's a
    assert vertical == pytest.approx(0.050, rel=1e-3)
    assert math.hypot(horizontal, vertical) == pytest.approx(0.060364, rel=1e-3)  # T_max / w
    assert sag == pytest.approx(0.026544, rel=1e-3)
    # The end straightens over a boundary layer of sqrt(EI / T): its slope is extrapolated in sqrt(EI / w).
    slope = (math.sqrt(2.0) * heavy[3] - light[3]) / (math.sqrt(2.0) - 1.0)
    assert math.degrees(slope) == pytest.approx(55.925, rel=1e-3)
