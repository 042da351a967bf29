"""A catheter that protrudes from the sheath: a stepped cantilever, whose tip is the further of the two, and whose
sheath grows up behind it.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import quad

from evergym.simulator import Command, Simulator
from evergym.world import World

CATHETER = 4.3e-4
SHEATH = math.pi * 3e8 * 35e-6 * 1.5e-3**3
"""Bending stiffness of the taut film, pi E t R^3 [N m^2]."""
NO_GROWTH = {"eversion_yield.static_kpa": 1000.0, "eversion_yield.kinetic_kpa": 1000.0}
TWO_SIDED = {"robot.catheter_bending_stiffness_n_m2": CATHETER, "wall_wrinkling.enabled": False, **NO_GROWTH}

Create = Callable[..., Simulator]


@pytest.mark.parametrize("protrusion_mm", [0.0, 9.0, 30.0])
@pytest.mark.parametrize("pressure", [5e3, 45e3])
def test_protruding_catheter_bends_as_a_stepped_cantilever(
    create_robot: Create, protrusion_mm: float, pressure: float
) -> None:
    """P / 3 ((L^3 - b^3) / (EI_c + EI_s) + b^3 / EI_c) for the bare length b, at any pressure."""
    length, bare = 0.090, protrusion_mm * 1e-3
    robot = create_robot(TWO_SIDED, setup="full", section_mm=1.5)
    robot.reset(everted_length=length - bare, catheter_length=length, pressure=pressure)
    load = 1e-4
    reading = robot.advance(Command(pressure=pressure, tip_load=(load, 0.0, 0.0)), 10.0)
    deflection = load / 3.0 * ((length**3 - bare**3) / (CATHETER + SHEATH) + bare**3 / CATHETER)
    slope = load / 2.0 * ((length**2 - bare**2) / (CATHETER + SHEATH) + bare**2 / CATHETER)
    # 0.1 % as B1; measured 0.01 %. Leaving the step out would be wrong by up to 5 %.
    assert reading.tip_position[0] == pytest.approx(deflection, rel=1e-3)
    assert math.atan2(reading.tip_direction[0], reading.tip_direction[2]) == pytest.approx(slope, rel=1e-3)


def test_protruding_catheter_weighs_what_it_is(create_robot: Create) -> None:
    """Sag of a cantilever with two weights per length and two stiffnesses, by integrating its moment twice."""
    length, bare, gravity = 0.090, 0.030, 1.0
    world = World.free(gravity=(gravity, 0.0, 0.0))
    robot = create_robot({**TWO_SIDED, "saline_weight.share": 1.0}, setup="full", section_mm=1.5, world=world)
    robot.reset(everted_length=length - bare, catheter_length=length, pressure=20e3)
    reading = robot.advance(Command(pressure=20e3), 10.0)
    masses = robot.parameters.robot
    outer, inner = gravity * masses.catheter_mass, gravity * (masses.sheath_mass + masses.inner_mass)
    step = length - bare

    def compute_moment(station: float) -> float:
        if station > step:
            return 0.5 * outer * (length - station) ** 2
        return outer * bare * (step + 0.5 * bare - station) + 0.5 * inner * (step - station) ** 2

    deflection = quad(lambda s: compute_moment(s) * (length - s) / (CATHETER + SHEATH), 0.0, step)[0]
    deflection += quad(lambda s: compute_moment(s) * (length - s) / CATHETER, step, length)[0]
    assert reading.tip_position[0] == pytest.approx(deflection, rel=1e-3)  # as B4
    assert masses.sheath_mass > 2.0 * masses.catheter_mass  # so the weights could not be exchanged unnoticed


def test_tip_is_the_further_of_sheath_and_catheter(create_robot: Create) -> None:
    robot = create_robot(NO_GROWTH, setup="full", section_mm=3.0)
    robot.reset(everted_length=0.030, catheter_length=0.025, pressure=5e3)
    command = Command(insertion_velocity=2e-3, tail_feed_velocity=0.0, pressure=5e3)
    reach = [robot.advance(command, 0.5).tip_position[2] for _ in range(12)]
    expected = [max(0.030, 0.025 + 1e-3 * (k + 1)) for k in range(12)]
    np.testing.assert_allclose(reach, expected, atol=1e-9)  # a straight robot: rounding and the solver's tolerance


def test_sheath_grows_up_behind_the_tip_and_then_leads(create_grower: Create) -> None:
    """Growth does not move the tip as long as the catheter leads; the robot gets stiffer, though."""
    robot = create_grower({"viscous_eversion.resistance_kpa_s_mm": 20.0}, setup="full", section_mm=2.5)
    robot.reset(everted_length=0.030, catheter_length=0.040, pressure=20e3)
    load = (2e-3, 0.0, 0.0)
    command = Command(tail_feed_velocity=0.05, pressure=20e3, tip_load=load)
    along, across, everted = [], [], []
    for _ in range(15):
        reading = robot.advance(command, 1.0)
        along.append(math.hypot(*reading.tip_position))
        across.append(reading.tip_position[0])
        everted.append(reading.everted_length)
    np.testing.assert_allclose(everted, 0.030 + 1e-3 * np.arange(1, 16), rtol=1e-6)  # 1 mm/s from 20 kPa
    behind = np.array(everted) < 0.040 - 1e-9
    assert np.ptp(np.array(along)[behind]) < 1e-6  # a rod's length; its chord by the square of a slope of 0.01
    assert np.all(np.diff(np.array(across)[behind]) < 0.0)
    np.testing.assert_allclose(np.diff(np.array(along)[~behind]), 1e-3, rtol=1e-3)


def test_contact_of_the_protruding_tip_does_not_press_on_growth(create_grower: Create, create_plane: Create) -> None:
    """A wall ahead that the catheter bears on stops the sheath only when that reaches it."""
    wall = create_plane((0.0, 0.0, -1.0), -0.045)  # at z = 45 mm
    growth = {}
    for everted, catheter in ((0.0440, 0.0440), (0.0440, 0.0455), (0.0455, 0.0300)):
        robot = create_grower(
            {"viscous_eversion.resistance_kpa_s_mm": 20.0, "robot.catheter_damping_time_ms": 5.0},
            setup="full",
            section_mm=2.5,
            world=World(wall=wall),
            tolerance_j=1e-10,
        )
        robot.reset(everted_length=everted, catheter_length=catheter, pressure=20e3)
        reading = robot.advance(Command(tail_feed_velocity=0.05, insertion_velocity=0.0, pressure=20e3), 0.5)
        growth[everted, catheter] = reading.everted_length - everted
        assert (reading.contact_count > 0) == (max(everted, catheter) > 0.045)
    free = growth[0.0440, 0.0440]
    assert growth[0.0440, 0.0455] == pytest.approx(free, rel=1e-9)
    assert growth[0.0455, 0.0300] < 0.9 * free
