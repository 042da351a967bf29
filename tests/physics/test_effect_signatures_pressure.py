"""What each effect of the pressure line and of the gauges looks like, and what tells it from those like it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from evergym.discrepancy.data.channels import read_channels
from evergym.discrepancy.data.columns import CHANNELS
from evergym.simulator import Command, Simulator

KPA = 1e3
MM = 1e-3
RESISTANCE = 20.0
"""Of the rate law [kPa s/mm]."""
YIELD = 6.0
GROWING = {
    "eversion_yield.static_kpa": YIELD,
    "eversion_yield.kinetic_kpa": YIELD,
    "viscous_eversion.resistance_kpa_s_mm": RESISTANCE,
}
GAUGE, ANGLE = CHANNELS.index("pressure_measured_kpa"), CHANNELS.index("tip_angle_deg")

Create = Callable[..., Simulator]


def _grow(create_grower: Create, changes: dict[str, Any], pressure_kpa: float) -> tuple[float, float, float]:
    """Return growth rate [mm/s], pressure in the sheath and on the gauge [kPa] once growth is steady."""
    robot = create_grower({**GROWING, **changes}, step_s=0.01)
    robot.reset(everted_length=0.03, pressure=pressure_kpa * KPA)
    reading = robot.advance(Command(tail_feed_velocity=0.1, pressure=pressure_kpa * KPA), 2.0)
    return reading.growth_rate / MM, reading.pressure / KPA, float(read_channels(robot)[GAUGE])


def test_droop_takes_pressure_in_proportion_to_the_speed(create_grower: Create) -> None:
    for pressure in (15.0, 30.0):
        rate, inside, gauge = _grow(create_grower, {"pressure_droop.resistance_kpa_s_mm": 5.0}, pressure)
        # Speed and droop settle with 50 ms: e^-40 is left after 2 s.
        assert rate == pytest.approx((pressure - YIELD) / (RESISTANCE + 5.0), rel=1e-6)
        assert inside == gauge == pytest.approx(pressure - 5.0 * rate, rel=1e-6)
    robot = create_grower({**GROWING, "pressure_droop.resistance_kpa_s_mm": 5.0})
    robot.reset(everted_length=0.03, pressure=15.0 * KPA)
    assert robot.advance(Command(pressure=15.0 * KPA, tail_feed_velocity=0.0), 1.0).pressure == 15.0 * KPA


@pytest.mark.parametrize("viscous", [0.0, 0.4])
@pytest.mark.parametrize("step_s", [0.0625, 0.008])
def test_a_droop_that_outweighs_the_tips_resistance_is_steady_at_any_step(
    create_grower: Create, viscous: float, step_s: float
) -> None:
    """Flow and pressure settle where both laws hold; taken one after the other, they would chase each other."""
    pressure, droop = 30.0, 20.0
    changes = {"viscous_eversion.resistance_kpa_s_mm": viscous, "pressure_droop.resistance_kpa_s_mm": droop}
    robot = create_grower({**GROWING, **changes}, step_s=step_s)
    robot.reset(everted_length=0.03, pressure=pressure * KPA)
    command = Command(tail_feed_velocity=0.1, pressure=pressure * KPA)
    robot.advance(command, 2.0)
    for _ in range(10):
        reading = robot.advance(command, step_s)
        assert reading.growth_rate / MM == pytest.approx((pressure - YIELD) / (viscous + droop), rel=1e-6)
        assert reading.pressure / KPA == pytest.approx(pressure - droop * reading.growth_rate / MM, rel=1e-6)


def test_droop_ends_when_the_tail_is_pulled(create_grower: Create) -> None:
    robot = create_grower({**GROWING, "pressure_droop.resistance_kpa_s_mm": 5.0})
    robot.reset(everted_length=0.03, pressure=30.0 * KPA)
    robot.advance(Command(tail_feed_velocity=0.1, pressure=30.0 * KPA), 2.0)
    pulled = Command(tail_feed_velocity=-1e-3, pressure=30.0 * KPA)
    assert robot.advance(pulled, 1.0).pressure == pytest.approx(30.0 * KPA, rel=1e-6)


def test_droop_is_no_yield_and_no_resistance_of_the_tip(create_grower: Create) -> None:
    """A yield that takes as much at one pressure shifts the threshold and takes the same at the other; a resistance of
    the tip gives the very same speeds, and only the gauge tells.
    """
    droop = {"pressure_droop.resistance_kpa_s_mm": 5.0}
    rate = _grow(create_grower, droop, 30.0)[0]
    raised = 30.0 - rate * RESISTANCE
    higher = {"eversion_yield.static_kpa": raised, "eversion_yield.kinetic_kpa": raised}
    assert _grow(create_grower, higher, 30.0)[0] == pytest.approx(rate, rel=1e-6)
    assert _grow(create_grower, higher, 15.0)[0] < 0.7 * _grow(create_grower, droop, 15.0)[0]
    # Just above the tip's own yield, droop still grows, the raised yield does not.
    assert _grow(create_grower, droop, YIELD + 0.5)[0] > 0.0
    assert _grow(create_grower, higher, YIELD + 0.5)[0] == 0.0
    slower = {"viscous_eversion.resistance_kpa_s_mm": RESISTANCE + 5.0}
    for pressure in (15.0, 30.0):
        drooping, resisting = _grow(create_grower, droop, pressure), _grow(create_grower, slower, pressure)
        assert drooping[0] == pytest.approx(resisting[0], rel=1e-6)
        assert resisting[2] == pressure
        assert drooping[2] < pressure - 1.0


def test_leak_takes_a_share_and_bias_a_constant_that_the_gauge_hides(create_grower: Create) -> None:
    for pressure in (20.0, 40.0):
        rate, inside, gauge = _grow(create_grower, {"pressure_leak.share": 0.15}, pressure)
        assert inside == gauge == pytest.approx(0.85 * pressure, rel=1e-12)
        assert rate == pytest.approx((0.85 * pressure - YIELD) / RESISTANCE, rel=1e-6)
        rate, inside, gauge = _grow(create_grower, {"pressure_bias.bias_kpa": 3.0}, pressure)
        assert inside == pytest.approx(pressure - 3.0, rel=1e-12)
        assert gauge == pytest.approx(pressure, rel=1e-12)
        assert rate == pytest.approx((pressure - 3.0 - YIELD) / RESISTANCE, rel=1e-6)


def test_bias_shifts_the_threshold_as_a_yield_does_and_everything_else_too(create_grower: Create) -> None:
    """In growth alone a bias cannot be told from a yield; where pressure acts otherwise, it can: here, in what the
    catheter's squeeze takes.
    """
    higher = {"eversion_yield.static_kpa": YIELD + 3.0, "eversion_yield.kinetic_kpa": YIELD + 3.0}
    for pressure in (15.0, 30.0):
        biased = _grow(create_grower, {"pressure_bias.bias_kpa": 3.0}, pressure)
        assert biased[0] == pytest.approx(_grow(create_grower, higher, pressure)[0], rel=1e-6)
    squeeze = {"tail_coulomb_friction.pressure_gradient_per_mm": 0.01}
    biased = _grow(create_grower, {**squeeze, "pressure_bias.bias_kpa": 3.0}, 30.0)
    yielding = _grow(create_grower, {**squeeze, **higher}, 30.0)
    # Friction on 3 kPa less over 30 to 33 mm: about 0.9 kPa less loss.
    assert (biased[0] - yielding[0]) * RESISTANCE == pytest.approx(0.01 * 31.0 * 3.0, rel=0.1)


def _sample_pressure(create_grower: Create, changes: dict[str, Any], set_point: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] and pressures [Pa] over 8 s, of which the first half settles."""
    robot = create_grower({"eversion_yield.static_kpa": 1e3, "eversion_yield.kinetic_kpa": 1e3, **changes}, step_s=0.01)
    robot.reset(everted_length=0.03, pressure=set_point)
    readings = [robot.advance(Command(pressure=set_point), 0.01) for _ in range(800)]
    return np.array([r.time for r in readings]), np.array([r.pressure for r in readings])


@pytest.mark.parametrize("lag_s", [0.0, 0.3])
def test_ripple_swings_at_its_frequency_and_lag_smooths_it(create_grower: Create, lag_s: float) -> None:
    changes = {"pressure_ripple.amplitude_kpa": 4.0, "pressure_ripple.frequency_hz": 0.5, "pressure_lag.time_s": lag_s}
    time, pressure = _sample_pressure(create_grower, changes, 20.0 * KPA)
    time, pressure = time[400:], pressure[400:]
    omega = 2.0 * math.pi * 0.5
    basis = np.column_stack([np.ones_like(time), np.sin(omega * time), np.cos(omega * time)])
    (mean, sine, cosine), residual, *_ = np.linalg.lstsq(basis, pressure, rcond=None)
    assert mean == pytest.approx(20.0 * KPA, rel=1e-4)
    # First order: smaller by sqrt(1 + (omega time)^2) and later by atan(omega time); 2 % for steps of 10 ms.
    assert math.hypot(sine, cosine) == pytest.approx(4.0 * KPA / math.hypot(1.0, omega * lag_s), rel=0.02)
    assert math.atan2(cosine, sine) == pytest.approx(-math.atan(omega * lag_s), abs=0.03)
    assert residual[0] < 1e-3 * len(time) * (4.0 * KPA) ** 2  # no other frequency


def test_lag_alone_does_not_swing_and_ripple_needs_pressure(create_grower: Create) -> None:
    lagged = _sample_pressure(create_grower, {"pressure_lag.time_s": 0.3}, 20.0 * KPA)[1]
    assert np.ptp(lagged) < 1e-9 * 20.0 * KPA
    ripple = {"pressure_ripple.amplitude_kpa": 4.0, "pressure_ripple.frequency_hz": 0.5}
    assert np.all(_sample_pressure(create_grower, ripple, 0.0)[1] == 0.0)


def _pull_through(create_robot: Create, changes: dict[str, Any]) -> tuple[str, np.ndarray, np.ndarray]:
    """Return a hash of all states, true and read tip angles [deg] while the tendon is pulled and paid out."""
    robot = create_robot(changes)
    robot.reset()
    digest, true, read = hashlib.sha256(), [], []
    for pull in np.concatenate([np.linspace(0.0, 3.0, 31), np.linspace(3.0, 0.0, 31)]):
        reading = robot.advance(Command(tendon_pull=float(pull) * MM), 1.0)
        for array in robot.state:
            digest.update(array.tobytes())
        true.append(math.degrees(math.acos(min(reading.tip_direction[2], 1.0))))
        read.append(float(read_channels(robot)[ANGLE]))
    return digest.hexdigest(), np.array(true), np.array(read)


def test_quantisation_rounds_what_is_read_and_leaves_the_robot_alone(create_robot: Create) -> None:
    plain, true, exact = _pull_through(create_robot, {})
    np.testing.assert_allclose(exact, true, atol=1e-6)  # an arc cosine near 1
    rounded, _, read = _pull_through(create_robot, {"angle_quantisation.step_deg": 5.0})
    assert rounded == plain  # bit for bit
    np.testing.assert_allclose(read / 5.0, np.round(read / 5.0), atol=1e-9)
    assert np.abs(read - true).max() <= 2.5 + 1e-6
    assert len(set(read)) > 4


def test_quantisation_has_no_memory_and_backlash_has(create_robot: Create) -> None:
    """Both hold the reading over some pull; only with backlash does it differ between the ways."""
    _, _, read = _pull_through(create_robot, {"angle_quantisation.step_deg": 5.0})
    up, down = read[:31], read[31:][::-1]
    # Where the angle is just between two steps, the solver's last digits choose.
    assert np.count_nonzero(up != down) <= 1
    _, _, lagging = _pull_through(create_robot, {"tendon_backlash.backlash_mm": 0.4})
    assert np.count_nonzero(np.abs(lagging[:31] - lagging[31:][::-1]) > 1.0) > 20
