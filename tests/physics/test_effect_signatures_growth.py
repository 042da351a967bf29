"""What each effect on growth looks like, and what tells it from the one it is taken for.

The loss of an effect is read off the robot: with the rate law v = (p - Y - losses) / R and feed in plenty, the pressure
that growth does not use.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from evergym.simulator import Command, Simulator

KPA = 1e3
MM = 1e-3
AREA = math.pi * 1.5e-3**2
RESISTANCE = 20.0
"""Of the rate law [kPa s/mm]: so slow that a measurement changes no length."""

FRICTIONS = {
    "tail_coulomb_friction": {"tail_coulomb_friction.gradient_kpa_per_mm": 0.1},
    "tail_catheter_friction": {"tail_catheter_friction.mu": 0.003},
    "tail_capstan_friction": {"tail_capstan_friction.mu": 0.3},
}
YIELD = {"eversion_yield.static_kpa": 6.0, "eversion_yield.kinetic_kpa": 6.0}

Create = Callable[..., Simulator]


def _measure_loss(
    create_grower: Create,
    changes: dict[str, Any],
    *,
    length_mm: float = 60.0,
    pressure_kpa: float = 30.0,
    catheter_mm: float = 60.0,
    pull_mm: float = 0.0,
) -> float:
    """Return the pressure [kPa] that yield and friction take."""
    robot = create_grower(
        {**YIELD, "viscous_eversion.resistance_kpa_s_mm": RESISTANCE, **changes},
        setup="full",
        section_mm=5.0,
        step_s=0.01,
    )
    pressure, pull = pressure_kpa * KPA, pull_mm * MM
    robot.reset(everted_length=length_mm * MM, catheter_length=catheter_mm * MM, pressure=pressure, tendon_pull=pull)
    command = Command(tail_feed_velocity=0.1, insertion_velocity=0.0, pressure=pressure, tendon_pull=pull)
    return pressure_kpa - robot.advance(command, 0.01).growth_rate / MM * RESISTANCE


def test_friction_along_the_tail_goes_with_its_length_alone(create_grower: Create) -> None:
    changes = FRICTIONS["tail_coulomb_friction"]
    base = _measure_loss(create_grower, changes)
    # In a step of 10 ms the robot grows by 0.01 mm: 0.02 %.
    assert base - 6.0 == pytest.approx(0.1 * 60.0, rel=1e-3)
    assert _measure_loss(create_grower, changes, length_mm=30.0, catheter_mm=30.0) - 6.0 == pytest.approx(3.0, rel=1e-3)
    for other in ({"pressure_kpa": 20.0}, {"catheter_mm": 20.0}, {"pull_mm": 4.9}):
        assert _measure_loss(create_grower, changes, **other) == pytest.approx(base, rel=1e-4), other


def test_friction_on_the_catheter_goes_with_its_length_and_the_pressure(create_grower: Create) -> None:
    changes = FRICTIONS["tail_catheter_friction"]
    base = _measure_loss(create_grower, changes)
    share = 2.0 * 0.003 * 0.925e-3 * 0.060 / 1.5e-3**2  # row 5: 2 mu r_c L_c / R^2
    assert base - 6.0 == pytest.approx(share * 30.0, rel=1e-3)
    assert _measure_loss(create_grower, changes, pressure_kpa=20.0) - 6.0 == pytest.approx(share * 20.0, rel=1e-3)
    shorter = _measure_loss(create_grower, changes, catheter_mm=20.0)
    assert shorter - 6.0 == pytest.approx(share * 30.0 / 3.0, rel=1e-3)
    assert _measure_loss(create_grower, changes, length_mm=90.0) == pytest.approx(base, rel=1e-4)
    assert _measure_loss(create_grower, changes, pull_mm=4.9) == pytest.approx(base, rel=1e-4)


def test_friction_in_bends_multiplies_what_there_is_and_needs_a_bend(create_grower: Create) -> None:
    changes = FRICTIONS["tail_capstan_friction"]
    for straight in ({}, {"length_mm": 90.0}, {"pressure_kpa": 20.0}, {"catheter_mm": 20.0}):
        # 1e-6: what the tolerance of the solver leaves of bend in a straight robot.
        assert _measure_loss(create_grower, changes, **straight) == pytest.approx(6.0, rel=1e-6), straight
    bent = _measure_loss(create_grower, changes, pull_mm=4.9)
    assert bent > 6.5
    harder = {**changes, "eversion_yield.static_kpa": 12.0, "eversion_yield.kinetic_kpa": 12.0}
    # Twice the loss before the bend, twice behind it; the pull bends the same robot.
    assert _measure_loss(create_grower, harder, pull_mm=4.9) == pytest.approx(2.0 * bent, rel=1e-3)


def test_the_three_frictions_are_told_apart_by_length_pressure_and_bend(create_grower: Create) -> None:
    """Each of three experiments moves another of them: the table of signs is what a diagnosis goes by."""
    answers = {}
    for name, changes in FRICTIONS.items():
        base = _measure_loss(create_grower, changes, length_mm=40.0, catheter_mm=40.0)
        longer_sheath = _measure_loss(create_grower, changes, length_mm=80.0, catheter_mm=40.0)
        pressed = _measure_loss(create_grower, changes, length_mm=40.0, catheter_mm=40.0, pressure_kpa=45.0)
        bent = _measure_loss(create_grower, changes, length_mm=40.0, catheter_mm=40.0, pull_mm=4.9)
        answers[name] = [bool(abs(value - base) > 0.1) for value in (longer_sheath, pressed, bent)]
    assert answers == {
        "tail_coulomb_friction": [True, False, False],
        "tail_catheter_friction": [False, True, False],
        "tail_capstan_friction": [False, False, True],
    }


def test_yield_is_a_threshold_with_memory(create_grower: Create) -> None:
    """Nothing below it whatever the feed; stops lower than it starts; takes the same pressure at all speeds."""
    changes = {
        "eversion_yield.static_kpa": 14.0,
        "eversion_yield.kinetic_kpa": 10.0,
        "viscous_eversion.resistance_kpa_s_mm": RESISTANCE,
    }
    robot = create_grower(changes, step_s=0.01)
    rates = []
    for feed in (1e-3, 5e-3):
        robot.reset(everted_length=0.03, pressure=12.0 * KPA)
        robot.advance(Command(tail_feed_velocity=feed, pressure=13.9 * KPA), 0.5)
        assert robot.reading.everted_length == 0.03
        reading = robot.advance(Command(tail_feed_velocity=feed, pressure=20.0 * KPA), 0.5)
        assert reading.pressure == 20.0 * KPA
        rates.append(robot.advance(Command(tail_feed_velocity=feed, pressure=12.0 * KPA), 0.5).growth_rate)
    # Below the static yield it goes on, with p - Y_k; the feed has no say as long as there is enough.
    np.testing.assert_allclose(rates, (12.0 - 10.0) / RESISTANCE * MM, rtol=1e-6)
