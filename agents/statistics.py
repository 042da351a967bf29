"""Statistics of comparisons: how sure a success rate is, and whether two arms on the same seeds really differ."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from evergym.errors import ConfigError

__all__ = [
    "Comparison",
    "Estimate",
    "compare_paired",
    "compute_iqm",
    "compute_mcnemar",
    "compute_wilson",
    "resample_iqm",
    "resample_mean",
]

CONFIDENCE = 0.95
RESAMPLES = 9999


class Estimate(NamedTuple):
    """A number with its interval."""

    value: float
    low: float
    high: float


class Comparison(NamedTuple):
    """Two arms on the same episodes: successes of one only, of the other only, and what follows from them."""

    difference: Estimate
    first_only: int
    second_only: int
    p_value: float


def compute_wilson(successes: int, count: int, confidence: float = CONFIDENCE) -> Estimate:
    """Success rate with its Wilson score interval.

    Source: Wilson 1927, doi 10.1080/01621459.1927.10502953; computed by scipy.

    Raises:
        ConfigError: No trials, or more successes than trials.
    """
    if not 0 <= successes <= count or count == 0:
        raise ConfigError(f"A success rate needs 0 <= successes <= count and count > 0; got {successes} of {count}.")
    interval = stats.binomtest(successes, count).proportion_ci(confidence, method="wilson")
    return Estimate(successes / count, float(interval.low), float(interval.high))


def compute_mcnemar(first_only: int, second_only: int) -> float:
    """Two-sided p-value of McNemar's exact test.

    Under the hypothesis of equal arms, a pair of which exactly one succeeded is a fair coin.

    Args:
        first_only: Pairs in which only the first arm succeeded.
        second_only: Pairs in which only the second did.

    Source: McNemar 1947, doi 10.1007/BF02295996, in its exact binomial form.
    """
    count = first_only + second_only
    return float(stats.binomtest(first_only, count).pvalue) if count else 1.0


def resample_mean(values: ArrayLike, seed: int = 0, confidence: float = CONFIDENCE) -> Estimate:
    """Mean with its percentile-bootstrap interval; of paired differences, this is the paired bootstrap.

    Args:
        values: Sample, shape (n,); NaN entries are left out.
        seed: Seed of the resampling.
        confidence: Coverage of the interval.

    Source: Efron 1979, doi 10.1214/aos/1176344552. The percentile form, since the bias-corrected one is undefined for
        samples without spread, which success differences often are.
    """
    sample = np.asarray(values, dtype=float)
    sample = sample[~np.isnan(sample)]
    if sample.size == 0:
        return Estimate(np.nan, np.nan, np.nan)
    mean = float(sample.mean())
    if sample.size == 1:
        return Estimate(mean, np.nan, np.nan)  # one value says nothing of its spread
    return Estimate(mean, *_bootstrap((sample,), np.mean, seed, confidence))


def compare_paired(first: Sequence[bool], second: Sequence[bool], seed: int = 0) -> Comparison:
    """Compare the successes of two arms on the same episodes, in the same order.

    Returns:
        Difference of the success rates (first minus second) with its paired-bootstrap interval, the discordant
        pairs and McNemar's exact p-value.
    """
    a, b = np.asarray(first, dtype=bool), np.asarray(second, dtype=bool)
    if a.shape != b.shape or a.size == 0:
        raise ConfigError(f"A paired comparison needs the same episodes in both arms; got {a.size} and {b.size}.")
    first_only, second_only = int(np.sum(a & ~b)), int(np.sum(b & ~a))
    difference = resample_mean(a.astype(float) - b.astype(float), seed)
    return Comparison(difference, first_only, second_only, compute_mcnemar(first_only, second_only))


def compute_iqm(scores: ArrayLike) -> float:
    """Interquartile mean: the mean of the middle half of all values.

    Source: Agarwal 2021, arXiv:2108.13264.
    """
    return float(stats.trim_mean(np.asarray(scores, dtype=float), 0.25, axis=None))


def resample_iqm(scores: ArrayLike, seed: int = 0, confidence: float = CONFIDENCE) -> Estimate:
    """IQM over training seeds and tasks with its stratified-bootstrap interval.

    Training seeds are resampled independently within each task.

    Args:
        scores: Shape (training seeds, tasks), for example success rates per split.
        seed: Seed of the resampling.
        confidence: Coverage of the interval.

    Source: Agarwal 2021, arXiv:2108.13264.

    Raises:
        ConfigError: Fewer than two training seeds.
    """
    table = np.asarray(scores, dtype=float)
    if table.ndim != 2 or table.shape[0] < 2:
        raise ConfigError(
            f"An interval over training seeds needs at least 2 of them; got an array of shape {table.shape}."
        )
    generator = np.random.default_rng(seed)
    run_count, task_count = table.shape
    index = generator.integers(run_count, size=(RESAMPLES, run_count, task_count))
    resampled = np.take_along_axis(table[None], index, axis=1).reshape(RESAMPLES, -1)
    values = stats.trim_mean(resampled, 0.25, axis=1)
    low, high = np.quantile(values, [0.5 - confidence / 2, 0.5 + confidence / 2])
    return Estimate(compute_iqm(table), float(low), float(high))


def _bootstrap(
    data: tuple[NDArray[np.float64], ...], statistic: Callable[..., Any], seed: int, confidence: float
) -> tuple[float, float]:
    generator = np.random.default_rng(seed)
    result = stats.bootstrap(
        data,
        statistic,
        n_resamples=RESAMPLES,
        confidence_level=confidence,
        method="percentile",
        paired=True,
        rng=generator,
        batch=1000,  # bounds the memory
    )
    return float(result.confidence_interval.low), float(result.confidence_interval.high)
