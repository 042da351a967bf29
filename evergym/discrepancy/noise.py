"""The noise of each measured channel: white, slowly wandering (AR(1)) and constant per run, learnt from repeats.

Samples that follow each other closely are not independent, so a model of independent noise sees effects everywhere.
Where runs were repeated, the differences between the repeats show the noise without any model of the robot. The
dataset's ``[noise]`` is the floor. Without repeats, a modest share of slow noise is assumed (see ``PRIOR_SHARE``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize

from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.dataset import Dataset, Run

__all__ = ["ChannelNoise", "NoiseModel", "estimate_noise", "find_repeats", "whitening_matrix"]

Array = NDArray[np.float64]

PRIOR_SHARE = 0.3
"""Slow noise (wandering, and constant per run) assumed without repeats, as a share of the floor. Prior."""
PRIOR_SPREAD = 1.0
"""How uncertain (in natural logarithms) the components are before the repeats are seen. Prior."""
PRIOR_TIME_S = 2.0
"""Correlation time of the wandering part before the repeats are seen [s]. Prior."""
SAMPLES_MAX = 160
"""Repeats longer than this are cut into pieces for the estimate, which then costs the cube of this number only."""


@dataclass(frozen=True)
class ChannelNoise:
    """One standard deviation of each part, in the channel's unit."""

    white: float
    wander: float
    wander_time_s: float
    offset: float
    repeats: int
    """Differences between repeats that it rests on."""

    @property
    def total(self) -> float:
        """Standard deviation of a sample."""
        return float(np.sqrt(self.white**2 + self.wander**2 + self.offset**2))

    def covariance(self, time: Array) -> Array:
        """Return the covariance of samples of one run at these times [s]."""
        lag = np.abs(time[:, None] - time[None, :])
        matrix: Array = self.wander**2 * np.exp(-lag / self.wander_time_s) + self.offset**2
        matrix[np.diag_indices(len(time))] += self.white**2
        return matrix


@dataclass(frozen=True)
class NoiseModel:
    """The noise of every measured channel, by name."""

    channels: Mapping[str, ChannelNoise]
    repeat_groups: tuple[tuple[str, ...], ...]
    """Runs that repeat one another."""


def find_repeats(runs: Sequence[Run]) -> list[list[int]]:
    """Return groups of runs with the same commands, start and surroundings at the same times."""
    groups: list[list[int]] = []
    for index, run in enumerate(runs):
        for group in groups:
            if _is_repeat(run, runs[group[0]]):
                group.append(index)
                break
        else:
            groups.append([index])
    return [group for group in groups if len(group) > 1]


def estimate_noise(dataset: Dataset) -> NoiseModel:
    """Return the noise of every measured channel, from repeats where there are any."""
    groups = find_repeats(dataset.runs)
    channels = {}
    for name in dataset.channels:
        contrasts = _collect_contrasts(dataset.runs, groups, CHANNELS.index(name))
        channels[name] = _estimate_channel(contrasts, float(dataset.noise[name]))
    names = tuple(tuple(dataset.runs[i].id for i in group) for group in groups)
    return NoiseModel(channels, names)


def _is_repeat(run: Run, other: Run) -> bool:
    same = (run.setup, run.experiment, run.environment) == (other.setup, other.experiment, other.environment)
    same = same and run.gravity == other.gravity and len(run.time_s) == len(other.time_s)
    return (
        same
        and abs(run.initial_everted_length_mm - other.initial_everted_length_mm) < 1e-6
        and np.allclose(run.time_s - run.time_s[0], other.time_s - other.time_s[0], atol=1e-3)
        and np.allclose(run.commands, other.commands, rtol=1e-6, atol=1e-6, equal_nan=True)
    )


def _collect_contrasts(runs: Sequence[Run], groups: list[list[int]], channel: int) -> list[tuple[Array, Array]]:
    """Return (times, values) of the independent differences between repeats, each with the noise of one run."""
    contrasts = []
    for group in groups:
        values = np.stack([runs[i].measured[:, channel] for i in group])
        common = np.isfinite(values).all(axis=0)
        if common.sum() < 2:
            continue
        time = runs[group[0]].time_s[common]
        count = len(group)
        for k in range(1, count):  # Helmert's contrasts: orthonormal, and free of what the repeats share
            row = np.zeros(count)
            row[:k], row[k] = 1.0, -float(k)
            contrasts.append((time, row @ values[:, common] / np.sqrt(k * (k + 1.0))))
    return contrasts


def _estimate_channel(contrasts: list[tuple[Array, Array]], floor: float) -> ChannelNoise:
    pieces = [piece for time, value in contrasts for piece in _cut(time, value)]
    start = np.log([floor, PRIOR_SHARE * floor, PRIOR_SHARE * floor, PRIOR_TIME_S])
    if not pieces:
        return _apply_floor(np.exp(start), floor, 0)
    spread = float(np.sqrt(np.mean([np.mean(value**2) for _, value in pieces])))
    scale = max(spread, 0.1 * floor)
    centre = np.log([scale, PRIOR_SHARE * scale, PRIOR_SHARE * scale, PRIOR_TIME_S])

    def cost(x: Array) -> float:
        white, wander, offset, time_s = np.exp(np.clip(x, -30.0, 30.0))
        noise = ChannelNoise(float(white), float(wander), float(time_s), float(offset), 0)
        total = 0.5 * float(np.sum(((x - centre) / PRIOR_SPREAD) ** 2))
        for time, value in pieces:
            factor = cho_factor(noise.covariance(time) + 1e-9 * scale**2 * np.eye(len(time)), lower=True)
            total += float(np.sum(np.log(np.diag(factor[0])))) + 0.5 * float(value @ cho_solve(factor, value))
        return total

    result = minimize(cost, centre, method="Nelder-Mead", options={"maxiter": 200, "xatol": 0.03, "fatol": 0.05})
    return _apply_floor(np.exp(result.x), floor, len(contrasts))


def _cut(time: Array, value: Array) -> list[tuple[Array, Array]]:
    """Cut a long difference into thinned and dense pieces that keep both the slow and the fast part visible."""
    if len(time) <= SAMPLES_MAX:
        return [(time, value)]
    half = SAMPLES_MAX // 2
    stride = int(np.ceil(len(time) / half))
    return [(time[::stride], value[::stride]), (time[:half], value[:half])]


def _apply_floor(values: Array, floor: float, repeats: int) -> ChannelNoise:
    white, wander, offset, time_s = (float(value) for value in values)
    missing = floor**2 - (white**2 + wander**2 + offset**2)
    if missing > 0.0:
        white = float(np.sqrt(white**2 + missing))
    return ChannelNoise(white, wander, time_s, offset, repeats)


def whitening_matrix(noise: ChannelNoise, time: Array, common: Array | None = None, own: Array | None = None) -> Array:
    """Return the matrix that turns noise at these times into independent unit noise, shape (k, k).

    Args:
        noise: Of the channel.
        time: Of the samples [s], (k,).
        common: One standard deviation of a further error with this course [channel's unit], (k,); None: none.
        own: One standard deviation of a further error of each sample by itself [channel's unit], (k,); None: none.
    """
    matrix = noise.covariance(time)
    matrix[np.diag_indices(len(time))] += 1e-6 * noise.total**2
    if common is not None:
        matrix += np.outer(common, common)
    if own is not None:
        matrix[np.diag_indices(len(time))] += own**2
    factor = np.linalg.cholesky(matrix)
    inverse: Array = solve_triangular(factor, np.eye(len(time)), lower=True)
    return inverse
