"""Measurements and predictions as vectors: which sample is which, and the same in units of independent unit noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.dataset import Dataset
from evergym.discrepancy.noise import ChannelNoise, NoiseModel, whitening_matrix

__all__ = ["Measurement"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FAILED = 1000.0
"""Standard deviations that a sample is taken to be off by where the simulation failed: more than any model is that does
not fail, or a fit would look for parameters that nothing can be simulated with."""
BLOCK_MAX = 400
"""Longest stretch that is whitened together; the noise of longer runs is taken as independent between stretches."""


@dataclass(frozen=True)
class _Segment:
    """The samples of one channel in one run (or in a stretch of it) that are whitened together."""

    rows: Index
    start: int
    stop: int
    whitening: Array


class Measurement:
    """All finite samples of a dataset as one vector of n values, ordered by run and channel.

    Args:
        dataset: The runs.
        noise: Their noise.
        numerics: One standard deviation of what discretisation does to each sample, signed [channel's unit], (n,): it
            counts as noise that is the same throughout a run. None: nothing.
        doubt: One standard deviation of what is not known of the prediction itself [channel's unit], (n,), each sample
            by itself. None: nothing.

    Attributes:
        value: Measured, in the channels' units, shape (n,).
        sigma: Standard deviation of the noise of each, shape (n,).
        run: Index of the run, (n,).
        channel: Index in `CHANNELS`, (n,).
        row: Sample within the run, (n,).
        experiment: Index in ``experiments``, (n,).
        experiments: Names, in the order of their first run.
    """

    def __init__(
        self, dataset: Dataset, noise: NoiseModel, numerics: Array | None = None, doubt: Array | None = None
    ) -> None:
        self._made_of = dataset, noise, numerics
        self.experiments = tuple(dict.fromkeys(run.experiment for run in dataset.runs))
        self._segments: list[_Segment] = []
        runs, channels, rows, sigma = [], [], [], []
        known: dict[tuple[bytes, bytes, str], Array] = {}
        stop = 0
        for index, run in enumerate(dataset.runs):
            for name in dataset.channels:
                channel = CHANNELS.index(name)
                finite = np.flatnonzero(np.isfinite(run.measured[:, channel]))
                pieces = np.array_split(finite, max(1, int(np.ceil(len(finite) / BLOCK_MAX)))) if len(finite) else []
                for piece in pieces:
                    time = run.time_s[piece] - run.time_s[piece[0]]
                    start, stop = stop, stop + len(piece)
                    shape = np.zeros(len(piece)) if numerics is None else numerics[start:stop]
                    own = np.zeros(len(piece)) if doubt is None else doubt[start:stop]
                    key = (np.round(time, 6).tobytes(), shape.tobytes() + own.tobytes(), name)
                    if key not in known:
                        known[key] = whitening_matrix(noise.channels[name], time, shape, own)
                    self._segments.append(_Segment(piece, start, stop, known[key]))
                    runs.append(np.full(len(piece), index))
                    channels.append(np.full(len(piece), channel))
                    rows.append(piece)
                    sigma.append(np.sqrt(noise.channels[name].total ** 2 + shape**2 + own**2))
        self.run = _join(runs)
        self.channel = _join(channels)
        self.row = _join(rows)
        self.sigma: Array = np.concatenate(sigma) if sigma else np.zeros(0)
        index_of = {name: i for i, name in enumerate(self.experiments)}
        of_run = np.array([index_of[run.experiment] for run in dataset.runs], dtype=np.int64)
        self.experiment: Index = of_run[self.run]
        self.value: Array = self.flatten([run.measured for run in dataset.runs])

    @property
    def size(self) -> int:
        """Number of samples n."""
        return len(self.run)

    def flatten(self, tables: Sequence[Array], elsewhere: Array | None = None) -> Array:
        """Return the values of per-run tables (k, 9) at the measured samples, shape (n,).

        Args:
            tables: One for each run; empty: not known.
            elsewhere: What to return for the samples of empty tables, (n,).
        """
        out = np.empty(self.size) if elsewhere is None else elsewhere.copy()
        for segment in self._segments:
            run, channel = self.run[segment.start], self.channel[segment.start]
            if len(tables[run]) == 0:
                continue
            out[segment.start : segment.stop] = tables[run][segment.rows, channel]
        return out

    def subtract(self, prediction: Array) -> Array:
        """Return measured minus predicted [channel's unit], (n,); where a simulation failed, it is `FAILED` sigmas."""
        difference = self.value - prediction
        return np.where(np.isfinite(difference), difference, FAILED * self.sigma)

    def whiten(self, values: Array) -> Array:
        """Return values (n,) or columns (n, m) in units of independent unit noise."""
        out = np.empty_like(values)
        for segment in self._segments:
            out[segment.start : segment.stop] = segment.whitening @ values[segment.start : segment.stop]
        return out

    def restore(self, whitened: Array) -> Array:
        """Return a whitened vector (n,) or columns (n, m) as they were before, in the channels' units."""
        out = np.empty_like(whitened)
        for segment in self._segments:
            part = whitened[segment.start : segment.stop]
            out[segment.start : segment.stop] = solve_triangular(segment.whitening, part, lower=True)
        return out

    def scale(self, whitened: Array) -> Array:
        """Return a whitened vector (n,) as it was before, in units of the standard deviation of each sample's noise."""
        scaled: Array = self.restore(whitened) / self.sigma
        return scaled

    def add_doubt(self, doubt: Array) -> Measurement:
        """Return the same samples with a further error of each, one standard deviation [channel's unit], (n,)."""
        return Measurement(*self._made_of, doubt)

    def as_independent(self) -> Measurement:
        """Return the same samples as though all their noise were white."""
        dataset, noise, numerics = self._made_of
        white = {name: ChannelNoise(one.total, 0.0, 1.0, 0.0, one.repeats) for name, one in noise.channels.items()}
        return Measurement(dataset, NoiseModel(white, noise.repeat_groups), None, numerics)

    def widen(self, numerics: Array) -> Measurement:
        """Return the same samples with what discretisation does where it is more than was known, signed, (n,)."""
        dataset, noise, known = self._made_of
        known = np.zeros(self.size) if known is None else known
        return Measurement(dataset, noise, np.where(np.abs(numerics) > np.abs(known), numerics, known))


def _join(parts: list[NDArray[np.int64]]) -> Index:
    return np.concatenate(parts).astype(np.int64) if parts else np.zeros(0, dtype=np.int64)
