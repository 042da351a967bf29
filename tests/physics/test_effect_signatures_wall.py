"""What each effect of the sheath's wall looks like, and what tells it from the one it is taken for."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from evergym.simulator import Command, Simulator

RADIUS = 1.5e-3
WALL = 35e-6
MODULUS = 3e8
LENGTH = 0.095
KPA = 1e3
NO_GROWTH = {"eversion_yield.static_kpa": 1000.0, "eversion_yield.kinetic_kpa": 1000.0}
KINK = {"root_kink.moment_n_m": 1.2e-4, "root_kink.pressure_share": 0.305}

Create = Callable[..., Simulator]


def _measure_droop(
    create_robot: Create, changes: dict[str, Any], *, pressure: float, length: float = LENGTH, wait: float = 5.0
) -> float:
    """Return by how much the chord of a sheath alone hangs below the horizontal [deg]."""
    sheath = create_robot({**NO_GROWTH, "saline_weight.share": 1.0, **changes}, setup="sheath", section_mm=1.0)
    sheath.reset(everted_length=length, pressure=pressure)
    tip = sheath.advance(Command(pressure=pressure), wait).tip_position
    return math.degrees(math.atan2(-tip[1], tip[2]))


def _measure_compliance(create_robot: Create, changes: dict[str, Any], load: float, pressure: float) -> float:
    """Return tip deflection over tip load [m/N] of a weightless sheath alone."""
    sheath = create_robot({**NO_GROWTH, **changes}, setup="sheath", section_mm=1.0, fibres=32)
    sheath.reset(everted_length=LENGTH, pressure=pressure)
    return float(sheath.advance(Command(pressure=pressure, tip_load=(load, 0.0, 0.0)), 5.0).tip_position[0] / load)


def test_wrinkling_sets_in_at_a_moment_in_proportion_to_the_pressure(create_robot: Create) -> None:
    # Ten times the film's stiffness, so that the tube is straight when it wrinkles.
    stiff = {"robot.sheath_modulus_mpa": 3000.0}
    two_sided = {**stiff, "wall_wrinkling.enabled": False}
    for pressure in (10.0 * KPA, 30.0 * KPA):
        onset = 0.5 * math.pi * pressure * RADIUS**3 / LENGTH
        plain = _measure_compliance(create_robot, two_sided, 0.01 * onset, pressure)
        # Below the onset nothing of it is seen; at 1.6 times it, the tip gives 1.305 times as much (Comer and Levy).
        assert _measure_compliance(create_robot, stiff, 0.9 * onset, pressure) == pytest.approx(plain, rel=2e-3)
        assert _measure_compliance(create_robot, stiff, 1.6 * onset, pressure) == pytest.approx(
            1.3054 * plain, rel=0.01
        )
        assert _measure_compliance(create_robot, two_sided, 1.6 * onset, pressure) == pytest.approx(plain, rel=2e-3)


def test_kink_is_a_hinge_with_a_length_and_wrinkling_is_not(create_robot: Create) -> None:
    """A kinked sheath turns about its root beyond its collapse length; a wrinkled one bends a little at that length."""
    changes = {**KINK, "robot.sheath_modulus_mpa": 1e5}
    pressure = 40.0 * KPA
    hinge = 1.2e-4 + 0.305 * math.pi * pressure * RADIUS**3
    sheath = create_robot({**NO_GROWTH, **changes}, setup="sheath")
    collapse = math.sqrt(2.0 * hinge / (9.81 * sheath.parameters.robot.sheath_mass))
    assert collapse < LENGTH
    assert _measure_droop(create_robot, changes, pressure=pressure, length=0.9 * collapse) < 1.0
    assert _measure_droop(create_robot, changes, pressure=pressure, length=1.1 * collapse) > 15.0
    # (With damping to hold on to while it settles.)
    wrinkled = {"robot.sheath_modulus_mpa": 1e5, "robot.catheter_damping_time_ms": 5.0}
    # Without the kink it carries pi p R^3 everywhere, here 1.4 times the moment at that length, so it only wrinkles.
    assert _measure_droop(create_robot, wrinkled, pressure=pressure, length=1.1 * collapse) < 5.0
