"""The laws of growth and retraction, one kernel at a time."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evergym.effects.burst_limit import BurstLimit, has_burst
from evergym.effects.eversion_yield import EversionYield, compute_yield_pressure
from evergym.effects.feed_limit import FeedLimit, compute_taut_speed
from evergym.effects.pressure_lag import PressureLag, compute_lagged_pressure
from evergym.effects.retraction_buckling import RetractionBuckling, compute_axial_limit, compute_inversion_tension
from evergym.effects.tail_capstan_friction import TailCapstanFriction, compute_capstan_factor
from evergym.effects.tail_catheter_friction import TailCatheterFriction, compute_squeeze_loss
from evergym.effects.tail_coulomb_friction import FEED_REFERENCE, TailCoulombFriction, compute_tail_loss
from evergym.effects.viscous_eversion import ViscousEversion, compute_pressure_speed

AREA = math.pi * 1.5e-3**2


def test_yield_is_static_at_rest_and_kinetic_in_motion() -> None:
    law = EversionYield(static_kpa=14.0, kinetic_kpa=10.0).compile()
    assert compute_yield_pressure(law, False) == 14e3
    assert compute_yield_pressure(law, True) == 10e3


def test_static_yield_is_never_below_the_kinetic_one() -> None:
    law = EversionYield(static_kpa=5.0, kinetic_kpa=10.0).compile()
    assert compute_yield_pressure(law, False) == 10e3


def test_rate_law_in_the_units_of_its_source() -> None:
    # phi = 0.41 mm/s/kPa of Fig. 8: 10 kPa drive 4.1 mm/s.
    assert compute_pressure_speed(ViscousEversion().compile(), 10e3) == pytest.approx(4.1e-3, rel=1e-12)
    # With n = 0.913 the unit is mm/s/kPa^n: 10 kPa drive 0.41 x 10^0.913 mm/s.
    law = ViscousEversion(exponent=0.913).compile()
    assert compute_pressure_speed(law, 10e3) == pytest.approx(0.41e-3 * 10.0**0.913, rel=1e-12)
    assert compute_pressure_speed(law, 0.0) == compute_pressure_speed(law, -1.0) == 0.0


@given(exponent=st.floats(0.3, 2.0), low=st.floats(1.0, 6e4), more=st.floats(1.0, 6e4))
def test_more_pressure_is_faster(exponent: float, low: float, more: float) -> None:
    law = ViscousEversion(exponent=exponent).compile()
    assert compute_pressure_speed(law, low + more) > compute_pressure_speed(law, low) > 0.0


def test_no_resistance_is_no_limit() -> None:
    assert compute_pressure_speed(ViscousEversion(resistance_kpa_s_mm=0.0).compile(), 1.0) > 1e6


@given(slip=st.floats(0.0, 0.95), pressure_speed=st.floats(1e-6, 1.0), feed_speed=st.floats(1e-6, 1.0))
def test_taut_tail_is_never_faster_than_either_of_its_limits(
    slip: float, pressure_speed: float, feed_speed: float
) -> None:
    speed = compute_taut_speed(FeedLimit(slip=slip).compile(), pressure_speed, feed_speed)
    assert 0.0 < speed <= min(pressure_speed, feed_speed)
    # In series: at worst half of the lower of the two.
    assert speed >= 0.5 * min(pressure_speed, feed_speed) * (1.0 - 1e-12)


def test_taut_tail_without_feed_or_pressure_stands() -> None:
    law = FeedLimit().compile()
    assert compute_taut_speed(law, 1e-3, 0.0) == compute_taut_speed(law, 0.0, 1e-3) == 0.0


@pytest.mark.parametrize(
    ("law", "pressure", "expected"),
    [
        (TailCoulombFriction(0.64, 0.0, 0.0, 0.0), 20e3, 0.64e3 * 50.0),
        (TailCoulombFriction(0.0, 0.01, 0.0, 0.0), 20e3, 20e3 * 0.5),
        (TailCoulombFriction(0.0, 0.0, 0.0217, 0.0), 20e3, 9.9e3 * (math.exp(0.0217 * 50.0) - 1.0)),
        (TailCoulombFriction(0.0, 0.0, 0.0, 0.5), 20e3, 0.0),
    ],
)
def test_three_laws_of_tail_friction_at_50_mm(law: TailCoulombFriction, pressure: float, expected: float) -> None:
    assert compute_tail_loss(law.compile(), 0.050, pressure, 9.9e3, 5e-3) == pytest.approx(expected, rel=1e-12)


def test_tail_friction_falls_with_the_feed_speed() -> None:
    law = TailCoulombFriction(0.64, 0.0, 0.0, 0.39).compile()
    first = compute_tail_loss(law, 0.050, 0.0, 0.0, FEED_REFERENCE)
    assert compute_tail_loss(law, 0.050, 0.0, 0.0, 2.0 * FEED_REFERENCE) == pytest.approx(first * 2.0**-0.39, rel=1e-12)
    # Slower feeds were not measured: no extrapolation.
    assert compute_tail_loss(law, 0.050, 0.0, 0.0, 0.0) == compute_tail_loss(law, 0.050, 0.0, 0.0, -1.0) == first


def test_exponential_friction_of_an_impossible_tail_stays_finite() -> None:
    assert math.isfinite(compute_tail_loss(TailCoulombFriction(yield_growth_per_mm=1.0).compile(), 10.0, 0.0, 1e4, 0.0))


def test_squeeze_loss_is_the_catalogues_82_mu_at_100_mm() -> None:
    law = TailCatheterFriction(mu=0.01).compile()
    loss = compute_squeeze_loss(law, 48.7e3, 0.100, 0.925e-3, 1.5e-3)
    assert loss / 48.7e3 == pytest.approx(82.0 * 0.01, rel=5e-3)  # the catalogue's two digits
    assert loss * AREA == pytest.approx(0.28, rel=0.02)  # N, likewise
    assert compute_squeeze_loss(TailCatheterFriction(mu=0.0).compile(), 48.7e3, 0.1, 0.925e-3, 1.5e-3) == 0.0


@given(mu=st.floats(1e-6, 1.0), first=st.floats(0.0, 5.0), second=st.floats(0.0, 5.0))
def test_capstan_factor_of_two_bends_is_that_of_their_sum(mu: float, first: float, second: float) -> None:
    law = TailCapstanFriction(mu=mu).compile()
    product = compute_capstan_factor(law, first) * compute_capstan_factor(law, second)
    assert compute_capstan_factor(law, first + second) == pytest.approx(product, rel=1e-12)


def test_capstan_factor_is_the_catalogues() -> None:
    assert compute_capstan_factor(TailCapstanFriction(mu=0.2).compile(), math.pi / 2.0) == pytest.approx(
        1.3691, rel=1e-4
    )
    assert compute_capstan_factor(TailCapstanFriction(mu=0.0).compile(), 100.0) == 1.0


def test_inversion_tension_is_half_of_pressure_and_fold() -> None:
    law = RetractionBuckling(inversion_yield_kpa=10.0).compile(1.5e-3, 35e-6, 3e8)
    assert compute_inversion_tension(law, 20e3, AREA) == pytest.approx(0.5 * 30e3 * AREA, rel=1e-12)


def test_axial_limit_is_fichters_column() -> None:
    law = RetractionBuckling().compile(1.5e-3, 35e-6, 3e8)
    stiffness = 3e8 * math.pi * 1.5e-3**3 * 35e-6
    # Row 10 of the catalogue, two digits.
    assert compute_axial_limit(law, stiffness, 0.095, 40e3 * AREA) == pytest.approx(0.030, rel=0.02)
    assert compute_axial_limit(law, stiffness, 0.050, 40e3 * AREA) == pytest.approx(0.11, rel=0.02)
    # A short column fails in shear: the limit ends at pA + G pi R t.
    shear = 0.3 + law.shear_rigidity
    assert compute_axial_limit(law, stiffness, 1e-6, 0.3) == pytest.approx(shear, rel=1e-3)


def test_axial_limit_off_or_without_length_is_infinite() -> None:
    off = RetractionBuckling(length_factor=0.0).compile(1.5e-3, 35e-6, 3e8)
    assert compute_axial_limit(off, 1e-4, 0.1, 0.0) == math.inf
    assert compute_axial_limit(RetractionBuckling().compile(1.5e-3, 35e-6, 3e8), 1e-4, 0.0, 0.0) == math.inf


@given(time=st.floats(0.01, 10.0), start=st.floats(0.0, 6e4), target=st.floats(0.0, 6e4), dt=st.floats(1e-4, 10.0))
def test_pressure_lag_is_exact_in_any_step(time: float, start: float, target: float, dt: float) -> None:
    law = PressureLag(time_s=time).compile()
    halfway = compute_lagged_pressure(law, start, target, 0.5 * dt)
    both = compute_lagged_pressure(law, halfway, target, 0.5 * dt)
    assert both == pytest.approx(compute_lagged_pressure(law, start, target, dt), rel=1e-9, abs=1e-6)
    assert min(start, target) - 1e-6 <= both <= max(start, target) + 1e-6


def test_pressure_without_lag_is_the_set_point() -> None:
    assert compute_lagged_pressure(PressureLag(time_s=0.0).compile(), 1.0, 2.0, 0.1) == 2.0


def test_burst_is_above_the_limit_only_and_never_when_off() -> None:
    law = BurstLimit(pressure_kpa=60.0).compile()
    assert not has_burst(law, 60e3)
    assert has_burst(law, 60.001e3)
    assert not has_burst(BurstLimit(pressure_kpa=0.0).compile(), 1e9)
