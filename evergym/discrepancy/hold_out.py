"""Choose the experiments that are neither used to choose nor to fit, before any effect is looked at."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.dataset import Dataset
from evergym.discrepancy.regimes import label_regimes
from evergym.discrepancy.residual import Measurement

__all__ = ["choose_held_out"]

Array = NDArray[np.float64]

SHARE = 0.25
"""Share of the experiments that are held out."""
COVER_MAX = 0.6
"""No regime and no channel should have more than this share of its samples in the experiments held out."""
COMBINATIONS_MAX = 5_000
DISAGREEMENT = (0.1, 0.4)
"""Share of the disagreement that should be held out: an effect that shows only there cannot be found, and one that does
not show there cannot be tested."""
LOST_WEIGHT, SPREAD_WEIGHT, DISAGREEMENT_WEIGHT = 5.0, 1.0, 3.0


def choose_held_out(
    dataset: Dataset, measurement: Measurement, jacobian: Array, disagreement: Array
) -> tuple[int, ...]:
    """Return the indices of the experiments to hold out, about a quarter; none if there are fewer than three.

    Those are held out that the others prepare for best: every regime and channel is in the others too, the nominal
    parameters that they need are known from the others, and so is most of what the recalibrated model leaves
    unexplained.

    Args:
        dataset: The runs.
        measurement: The samples.
        jacobian: Change of the whitened prediction by one tolerance of each nominal parameter, (n, m).
        disagreement: How far off the recalibrated model is in each experiment [sigma, all its samples together], (e,).
    """
    count = len(measurement.experiments)
    if count < 3:
        return ()
    table = _count_samples(dataset, measurement)
    total = table.sum(axis=0)
    scaled = np.stack([measurement.scale(column) for column in jacobian.T], axis=1) if jacobian.size else jacobian
    rows = [np.flatnonzero(measurement.experiment == k) for k in range(count)]
    information = np.stack([jacobian[part].T @ jacobian[part] for part in rows])
    spread = np.stack([scaled[part].T @ scaled[part] for part in rows])
    prior = np.eye(jacobian.shape[1])
    size = max(1, round(SHARE * count))
    while math.comb(count, size) > COMBINATIONS_MAX and size > 1:
        size -= 1
    best: tuple[float, tuple[int, ...]] | None = None
    for chosen in itertools.combinations(range(count), size):
        share = table[list(chosen)].sum(axis=0) / total
        lost = float(np.sum(np.maximum(share - COVER_MAX, 0.0)))
        rest = [k for k in range(count) if k not in chosen]
        covariance = np.linalg.inv(information[rest].sum(axis=0) + prior)
        samples = sum(len(rows[k]) for k in chosen)
        variance = float(np.sum(covariance * spread[list(chosen)].sum(axis=0))) / max(samples, 1)
        penalty = LOST_WEIGHT * lost + float(np.mean(np.abs(share - SHARE))) + SPREAD_WEIGHT * math.sqrt(variance)
        if disagreement.sum() > 0.0:
            off = float(disagreement[list(chosen)].sum() / disagreement.sum())
            penalty += DISAGREEMENT_WEIGHT * max(DISAGREEMENT[0] - off, off - DISAGREEMENT[1], 0.0)
        if best is None or penalty < best[0] - 1e-12:
            best = penalty, chosen
    assert best is not None
    return best[1]


def _count_samples(dataset: Dataset, measurement: Measurement) -> Array:
    """Return the number of samples of each experiment in each regime, of each channel, and in all; (e, columns)."""
    labels = label_regimes(dataset.runs)
    names = list(dict.fromkeys(name for label in labels for name in label)) + list(CHANNELS)
    table = np.zeros((len(measurement.experiments), len(names) + 1))
    index = {name: i for i, name in enumerate(measurement.experiments)}
    for run, label in zip(dataset.runs, labels, strict=True):
        row = table[index[run.experiment]]
        row[-1] += len(run.time_s)
        for name, mask in label.items():
            row[names.index(name)] += int(mask.sum())
        for name, measured in zip(CHANNELS, np.isfinite(run.measured).T, strict=True):
            row[names.index(name)] += int(measured.sum())
    return table[:, table.sum(axis=0) > 0]
