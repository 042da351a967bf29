"""The inflated film without a catheter: wrinkling, collapse and the kink at the root (benchmarks B11 to B14)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from evergym.effects.root_kink import RootKinkParameters, compute_kink_moment
from evergym.effects.wall_wrinkling import compute_collapse_curve
from evergym.lattice import compute_bundle
from evergym.simulator import Command, Simulator

RADIUS = 1.5e-3
MODULUS = 3e8
WALL = 35e-6
LENGTH = 0.095
NO_GROWTH = {"eversion_yield.static_kpa": 1000.0, "eversion_yield.kinetic_kpa": 1000.0}
COLLAPSE_CURVE = [
    (0.0, 0.5, 1.0),
    (30.0, 0.55127, 1.1353),
    (60.0, 0.66051, 1.6420),
    (90.0, 0.78540, 3.1416),
    (120.0, 0.89681, 9.1745),
    (150.0, 0.97299, 67.488),
]
"""Wrinkled angle [deg], M / M_c, kappa / kappa_w."""

Create = Callable[..., Simulator]


@pytest.mark.parametrize(("angle_deg", "moment", "curvature"), COLLAPSE_CURVE)
def test_closed_form_of_comer_and_levy(angle_deg: float, moment: float, curvature: float) -> None:
    result = compute_collapse_curve(math.radians(angle_deg))
    assert result == pytest.approx((moment, curvature), rel=1e-4)  # as in the benchmark: the digits of the table


@pytest.mark.parametrize("pressure", [8.675e3, 48.675e3])
def test_fibres_wrinkle_along_the_curve_of_comer_and_levy(create_robot: Create, pressure: float) -> None:
    bundle = create_robot(NO_GROWTH, setup="sheath", fibres=32).parameters.robot.sheath_bundle
    out = np.zeros(7)
    length = 1e-3
    onset = pressure / (2.0 * MODULUS * WALL)
    for _, moment, curvature in COLLAPSE_CURVE:
        for direction in np.linspace(0.0, 2.0 * math.pi / 32, 9):  # all places between two fibres
            x, y = math.cos(direction), math.sin(direction)
            bend = curvature * onset * length
            compute_bundle(bundle, pressure * math.pi * RADIUS**2, bend * x, bend * y, length, out)
            # 0.5 % with 32 fibres as asked for; measured 0.18 %.
            assert (out[1] * x + out[2] * y) / (math.pi * pressure * RADIUS**3) == pytest.approx(moment, rel=5e-3)


@pytest.mark.parametrize(
    ("pressure", "wrinkling", "wrinkling_force"), [(8.675e3, 4.60e-5, 4.84e-4), (48.675e3, 2.58e-4, 2.72e-3)]
)
def test_moments_at_which_the_tube_wrinkles_and_collapses(
    create_robot: Create, pressure: float, wrinkling: float, wrinkling_force: float
) -> None:
    """B11, the law: pi p R^3 / 2 and pi p R^3, met by the fibres."""
    law = compute_kink_moment(RootKinkParameters(0.0, 1.0), pressure, RADIUS)
    # The table's three digits are known to 0.2 %.
    assert 0.5 * law == pytest.approx(wrinkling, rel=2e-3)
    assert 0.5 * law / LENGTH == pytest.approx(wrinkling_force, rel=2e-3)
    bundle = create_robot(NO_GROWTH, setup="sheath", fibres=60).parameters.robot.sheath_bundle
    thrust = pressure * math.pi * RADIUS**2
    out = np.zeros(7)
    length = 1e-3

    def bend(curvature: float) -> tuple[float, float]:
        compute_bundle(bundle, thrust, curvature * length, 0.0, length, out)
        return out[1], out[3] * length

    # Onset: the curvature up to which the stiffness is the whole tube's, by bisection.
    _, stiffness = bend(0.0)
    assert stiffness == pytest.approx(MODULUS * math.pi * RADIUS**3 * WALL, rel=1e-3)
    low, high = 0.0, 10.0 * pressure / (2.0 * MODULUS * WALL)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if bend(middle)[1] > (1.0 - 1e-9) * stiffness else (low, middle)
    # 0.1 % as in the benchmark, beside cos(pi / 60): the outermost of 60 fibres lies that much inside the rim.
    assert bend(low)[0] * math.cos(math.pi / 60.0) == pytest.approx(0.5 * law, rel=1e-3)
    # Collapse: 99.9 % of the limit are reached, and it is never passed, however sharp the bend.
    moments = [bend(curvature)[0] for curvature in np.geomspace(1.0, 1e7, 50)]
    assert max(moments) == pytest.approx(law, rel=2e-3)  # with 60 fibres; the last one taut is 0.14 % inside the rim
    assert max(moments) <= law


def _create_sheath(create_robot: Create, modulus_mpa: float, section_mm: float) -> Simulator:
    changes = {**NO_GROWTH, "robot.sheath_modulus_mpa": modulus_mpa}
    return create_robot(changes, setup="sheath", fibres=32, section_mm=section_mm)


@pytest.mark.parametrize("pressure", [8.675e3, 48.675e3])
def test_inflated_cantilever_wrinkles_and_collapses_at_its_loads(create_robot: Create, pressure: float) -> None:
    """B11, the events, in the simulated tube; ten times stiffer than the film, so that it is still straight when it
    collapses.
    """
    sheath = _create_sheath(create_robot, 3000.0, 1.0)
    collapse = math.pi * pressure * RADIUS**3 / LENGTH

    def deflect(share: float) -> float:
        sheath.reset(everted_length=LENGTH, pressure=pressure)
        load = (0.0, -share * collapse, 0.0)
        return float(-sheath.advance(Command(pressure=pressure, tip_load=load), 20.0).tip_position[1])

    # Linear to 0.1 % below wrinkling (the rotation's share is less), softer above it.
    linear = deflect(0.05) / 0.05
    assert deflect(0.49) / 0.49 == pytest.approx(linear, rel=1e-3)
    assert deflect(0.60) / 0.60 > 1.01 * linear
    # 2 % as in the benchmark for the load at which the first fibre goes slack; measured 1 %: half a link of lever, and
    # the outermost of 32 fibres inside the rim.
    robot, out = sheath.parameters.robot, np.zeros(7)
    taut = 2.0 * float(robot.sheath_bundle[:, 0] @ robot.sheath_bundle[:, 1] ** 2)
    slack = {}
    for share in (0.49, 0.51):
        deflect(share)
        length = sheath.state.length[0]
        compute_bundle(robot.sheath_bundle, pressure * math.pi * RADIUS**2, *sheath.state.bend[0], length, out)
        slack[share] = (out[3] + out[5]) * length < (1.0 - 1e-9) * taut
    assert slack == {0.49: False, 0.51: True}
    # Beyond collapse it turns about its root until the dead load's lever has shrunk to M_c / F, which measures M_c: 2 %
    # as in the benchmark. Below, it stands.
    for share in (1.02, 1.1, 1.3):
        lever = math.sqrt(LENGTH**2 - deflect(share) ** 2)
        assert share * collapse * lever == pytest.approx(collapse * LENGTH, rel=0.02)
    assert deflect(0.97) < 0.5 * deflect(1.02)


def test_wrinkled_cantilever_deflects_by_comer_and_levy(create_robot: Create) -> None:
    """B13, in small rotations: the film is made ten times stiffer, which leaves the ratios as they are."""
    pressure, modulus_mpa = 8.675e3, 3000.0
    sheath = _create_sheath(create_robot, modulus_mpa, 1.0)
    sheath.reset(everted_length=LENGTH, pressure=pressure)
    stiffness = modulus_mpa * 1e6 * math.pi * RADIUS**3 * WALL
    collapse = math.pi * pressure * RADIUS**3 / LENGTH
    expected = {
        0.5: (1.0, 1.0),
        0.6: (1.0160, 1.0111),
        0.7: (1.0952, 1.0682),
        0.8: (1.3054, 1.2218),
        0.9: (1.9205, 1.6669),
        0.95: (2.9195, 2.3729),
    }
    for share, ratios in expected.items():
        load = share * collapse
        reading = sheath.advance(Command(pressure=pressure, tip_load=(load, 0.0, 0.0)), 5.0)
        deflection = reading.tip_position[0] / (load * LENGTH**3 / (3.0 * stiffness))
        rotation = math.atan2(reading.tip_direction[0], reading.tip_direction[2]) / (
            load * LENGTH**2 / (2.0 * stiffness)
        )
        assert (deflection, rotation) == pytest.approx(ratios, rel=0.01)  # as in the benchmark; measured 0.2 %


@pytest.mark.parametrize("gauge_kpa", [8.7, 18.7, 28.7, 38.7, 48.7])
def test_kinked_sheath_hangs_as_a_straight_rod(create_robot: Create, gauge_kpa: float) -> None:
    """B14: cos(theta) = 2 M_h / (w L^2), with a film so stiff that the rod is straight and links so short that the
    root is a point.
    """
    changes = {
        **NO_GROWTH,
        "robot.sheath_modulus_mpa": 1e5,
        "root_kink.moment_n_m": 1.2e-4,
        "root_kink.pressure_share": 0.305,
        "saline_weight.share": 1.0,
    }
    sheath = create_robot(changes, setup="sheath", section_mm=0.1)
    sheath.reset(everted_length=LENGTH, pressure=gauge_kpa * 1e3)
    reading = sheath.advance(Command(pressure=gauge_kpa * 1e3), 5.0)
    weight = 9.81 * sheath.parameters.robot.sheath_mass
    assert weight == pytest.approx(0.072, rel=0.005)  # N/m, the catalogue's digits
    hinge = 1.2e-4 + 0.305 * math.pi * gauge_kpa * 1e3 * RADIUS**3
    expected = math.degrees(math.acos(2.0 * hinge / (weight * LENGTH**2)))
    tip = reading.tip_position
    # 0.2 deg as in the benchmark. The bend is spread over the first link: error of the order of its length, 0.08 deg at
    # 0.1 mm.
    assert math.degrees(math.atan2(-reading.tip_direction[1], reading.tip_direction[2])) == pytest.approx(
        expected, abs=0.2
    )
    assert math.degrees(math.atan2(-tip[1], tip[2])) == pytest.approx(expected, abs=0.2)


def test_kinked_sheath_stays_level_up_to_its_collapse_length(create_robot: Create) -> None:
    changes = {
        **NO_GROWTH,
        "robot.sheath_modulus_mpa": 1e5,
        "root_kink.moment_n_m": 1.2e-4,
        "saline_weight.share": 1.0,
    }
    sheath = create_robot(changes, setup="sheath", section_mm=1.0)
    weight = 9.81 * sheath.parameters.robot.sheath_mass
    length = math.sqrt(2.0 * 1.2e-4 / weight)
    droops = []
    for share in (0.97, 1.05):
        sheath.reset(everted_length=share * length, pressure=10e3)
        tip = sheath.advance(Command(pressure=10e3), 5.0).tip_position
        droops.append(math.degrees(math.atan2(-tip[1], tip[2])))
    assert droops[0] < 0.5  # the hinge's elastic give
    assert droops[1] > 15.0  # acos(1 / 1.05^2) = 25 deg, less the root's spread


def test_unpressurised_film_hangs_like_a_chain(create_robot: Create) -> None:
    """Without pressure no fibre is taut: under its weight it hangs straight down, and the solver finds that."""
    # Damping and tolerance of everyday use: without any stiffness Newton's method has nothing else to hold on to.
    changes = {**NO_GROWTH, "saline_weight.share": 1.0, "robot.catheter_damping_time_ms": 5.0}
    sheath = create_robot(changes, setup="sheath", tolerance_j=1e-10, step_s=0.125)
    sheath.reset(everted_length=LENGTH, pressure=0.0)
    reading = sheath.advance(Command(), 30.0)
    # All but the first link, which is clamped at one end, hang; half a link of it is lost.
    assert reading.tip_position[1] == pytest.approx(-LENGTH, rel=0.02)
    assert reading.tip_direction[1] < -0.999
