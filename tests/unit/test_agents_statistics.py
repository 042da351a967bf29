"""Statistics against published numbers, closed forms and simulated coverage."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from evergym.agents.statistics import (
    compare_paired,
    compute_iqm,
    compute_mcnemar,
    compute_wilson,
    resample_iqm,
    resample_mean,
)
from evergym.errors import ConfigError


@pytest.mark.parametrize(
    ("successes", "count", "low", "high"),
    [  # Newcombe 1998, doi 10.1002/(SICI)1097-0258(19980430)17:8<857::AID-SIM777>3.0.CO;2-E, Table I, method 3
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0000, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_interval_matches_published_values(successes: int, count: int, low: float, high: float) -> None:
    estimate = compute_wilson(successes, count)
    assert estimate.value == pytest.approx(successes / count)
    assert estimate.low == pytest.approx(low, abs=5e-5)
    assert estimate.high == pytest.approx(high, abs=5e-5)


def test_wilson_interval_matches_its_formula() -> None:
    k, n, z = 37, 50, stats.norm.ppf(0.975)
    centre = (k + z**2 / 2) / (n + z**2)
    half = z / (n + z**2) * math.sqrt(k * (n - k) / n + z**2 / 4)
    estimate = compute_wilson(k, n)
    assert (estimate.low, estimate.high) == pytest.approx((centre - half, centre + half), rel=1e-12)


@pytest.mark.parametrize(("successes", "count"), [(0, 0), (5, 4), (-1, 4)])
def test_wilson_interval_refuses_impossible_counts(successes: int, count: int) -> None:
    with pytest.raises(ConfigError, match="successes <= count"):
        compute_wilson(successes, count)


def test_mcnemar_is_the_binomial_tail() -> None:
    b, c = 3, 14
    tail = sum(math.comb(b + c, i) for i in range(b + 1)) / 2 ** (b + c)
    assert compute_mcnemar(b, c) == pytest.approx(2 * tail, rel=1e-12)
    assert compute_mcnemar(c, b) == compute_mcnemar(b, c)
    assert compute_mcnemar(0, 0) == 1.0
    assert compute_mcnemar(4, 4) == 1.0
    assert compute_mcnemar(0, 6) == pytest.approx(2 / 64)


def test_bootstrap_of_the_mean_agrees_with_the_normal_interval() -> None:
    sample = np.random.default_rng(0).normal(3.0, 2.0, 400)
    estimate = resample_mean(sample, seed=1)
    half = 1.96 * sample.std() / math.sqrt(sample.size)
    assert estimate.value == pytest.approx(sample.mean())
    # The resampling error of a 2.5 % quantile from 9999 draws is about 3 % of the half width.
    assert estimate.low == pytest.approx(sample.mean() - half, abs=0.08 * half)
    assert estimate.high == pytest.approx(sample.mean() + half, abs=0.08 * half)
    assert resample_mean(sample, seed=1) == estimate
    assert resample_mean(sample, seed=2) != estimate


def test_bootstrap_handles_gaps_and_samples_without_spread() -> None:
    assert resample_mean([2.0, math.nan, 2.0, 2.0]) == (2.0, 2.0, 2.0)
    assert all(math.isnan(value) for value in resample_mean([math.nan]))
    single = resample_mean([1.0])
    assert single.value == 1.0
    assert math.isnan(single.low)


def test_paired_comparison_uses_the_pairing() -> None:
    generator = np.random.default_rng(3)
    hard = generator.random(200)
    first = [bool(value) for value in hard < 0.7]
    second = [bool(value) for value in hard < 0.6]  # succeeds only where the first one does
    comparison = compare_paired(first, second)
    assert comparison.second_only == 0
    assert comparison.first_only == sum(first) - sum(second)
    assert comparison.difference.value == pytest.approx(comparison.first_only / 200)
    unpaired = math.hypot(*(np.std(arm) / math.sqrt(200) for arm in (first, second)))
    assert comparison.difference.high - comparison.difference.low < 0.7 * 2 * 1.96 * unpaired
    mirrored = compare_paired(second, first)
    assert mirrored.difference.value == -comparison.difference.value
    assert mirrored.p_value == comparison.p_value


def test_paired_comparison_refuses_unequal_arms() -> None:
    with pytest.raises(ConfigError, match="same episodes"):
        compare_paired([True], [True, False])
    with pytest.raises(ConfigError, match="same episodes"):
        compare_paired([], [])


def test_iqm_is_the_mean_of_the_middle_half() -> None:
    assert compute_iqm([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 1000.0]) == pytest.approx((2 + 3 + 4 + 5) / 4)
    assert compute_iqm([[1.0, 2.0], [3.0, 100.0]]) == pytest.approx(2.5)


def test_iqm_interval_covers_and_shrinks() -> None:
    generator = np.random.default_rng(5)
    small, large = (resample_iqm(generator.normal(0.5, 0.1, (runs, 4))) for runs in (5, 80))
    assert small.low < small.value < small.high
    assert large.high - large.low < 0.5 * (small.high - small.low)
    assert large.low < 0.5 < large.high
    same = resample_iqm(np.full((5, 3), 0.25))
    assert same == (0.25, 0.25, 0.25)
    # Strata are kept: a column without spread stays as it is in every resample.
    columns = np.column_stack([np.zeros(6), np.ones(6)])
    assert resample_iqm(columns) == (0.5, 0.5, 0.5)


def test_iqm_interval_needs_two_training_seeds() -> None:
    with pytest.raises(ConfigError, match="at least 2"):
        resample_iqm([[0.5, 0.7]])


@pytest.mark.slow
def test_intervals_cover_as_often_as_they_say() -> None:
    generator = np.random.default_rng(11)
    trials, count, truth = 400, 100, 0.85
    wilson = [compute_wilson(int(k), count) for k in generator.binomial(count, truth, trials)]
    covered = np.mean([estimate.low <= truth <= estimate.high for estimate in wilson])
    # The exact coverage of Wilson at n = 100, p = 0.85 is 94 to 96 %; 400 trials leave a deviation of 1.1 %.
    assert 0.91 < covered < 0.985
