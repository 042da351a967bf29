"""Where model and measurement disagree beyond the noise: a map of channels and regimes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2 as chi2_distribution

from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.dataset import Dataset
from evergym.discrepancy.regimes import label_regimes
from evergym.discrepancy.residual import Measurement

__all__ = ["SIGNIFICANCE", "Cell", "locate", "select_significant"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SAMPLES_MIN = 6
"""Cells with fewer samples are left out of the map."""
P_VALUE_MIN = 1e-300
"""Smaller ones cannot be written down."""
SIGNIFICANCE = 0.01
"""Cells with a larger corrected p-value are noise."""


@dataclass(frozen=True)
class Cell:
    """One cell of the map.

    Attributes:
        channel: Measured channel.
        regime: One of `evergym.discrepancy.regimes.REGIMES`.
        runs: Those with the largest share of the disagreement.
        samples: Number of samples.
        rms: Root mean square of the residual [sigma].
        excess: What of it is beyond the noise [sigma].
        p_value: Probability of as much in noise alone, for all cells together (Holm).
    """

    channel: str
    regime: str
    runs: tuple[str, ...]
    samples: int
    rms: float
    excess: float
    p_value: float


def locate(
    dataset: Dataset, measurement: Measurement, prediction: Array, whitened: Array, freedom: float, use: Mask
) -> list[Cell]:
    """Return the map of disagreement, the largest excess first; insignificant cells have a p-value near 1.

    Args:
        dataset: The runs.
        measurement: The samples.
        prediction: Of every sample [channel's unit], (n,).
        whitened: Whitened residual, (n,): independent under pure noise, so chi-square tests hold.
        freedom: Share of the samples that the fit has used up, which makes the residual smaller than the noise.
        use: Samples that take part, (n,).
    """
    scaled = measurement.subtract(prediction) / measurement.sigma
    labels = label_regimes(dataset.runs)
    cells: list[Cell] = []
    for channel in sorted(set(measurement.channel.tolist())):
        for regime in dict.fromkeys(name for label in labels for name in label):
            mask = _select(measurement, labels, channel, regime) & use
            count = int(mask.sum())
            if count < SAMPLES_MIN:
                continue
            rms = float(np.sqrt(np.mean(scaled[mask] ** 2)))
            excess = float(np.sqrt(max(rms**2 - 1.0, 0.0)))
            statistic = float(whitened[mask] @ whitened[mask])
            p_value = float(chi2_distribution.sf(statistic, count * (1.0 - freedom)))
            names = _rank_runs(dataset, measurement, scaled, mask)
            cells.append(Cell(CHANNELS[channel], regime, names, count, rms, excess, p_value))
    cells = _correct(cells)
    return sorted(cells, key=lambda cell: (cell.p_value > SIGNIFICANCE, -cell.excess))


def select_significant(dataset: Dataset, measurement: Measurement, cells: Sequence[Cell]) -> Mask:
    """Return the samples in significant cells, (n,)."""
    labels = label_regimes(dataset.runs)
    mask = np.zeros(measurement.size, dtype=bool)
    for cell in cells:
        if cell.p_value <= SIGNIFICANCE:
            mask |= _select(measurement, labels, CHANNELS.index(cell.channel), cell.regime)
    return mask


def _select(measurement: Measurement, labels: Sequence[dict[str, Mask]], channel: int, regime: str) -> Mask:
    mask = np.zeros(measurement.size, dtype=bool)
    for run, label in enumerate(labels):
        if regime in label:
            places = np.flatnonzero((measurement.run == run) & (measurement.channel == channel))
            mask[places] = label[regime][measurement.row[places]]
    return mask


def _rank_runs(dataset: Dataset, measurement: Measurement, scaled: Array, mask: Mask) -> tuple[str, ...]:
    total = np.bincount(measurement.run[mask], scaled[mask] ** 2, minlength=len(dataset.runs))
    order = np.argsort(-total, kind="stable")[:3]
    return tuple(dataset.runs[i].id for i in order if total[i] > 0.1 * total.sum())


def _correct(cells: list[Cell]) -> list[Cell]:
    """Correct the p-values for the number of cells (Holm: cells overlap, so nothing about independence is assumed)."""
    order = np.argsort([cell.p_value for cell in cells], kind="stable")
    corrected = np.ones(len(cells))
    worst = 0.0
    for rank, place in enumerate(order):
        worst = max(worst, min(1.0, cells[place].p_value * (len(cells) - rank)))
        corrected[place] = max(worst, P_VALUE_MIN)
    return [
        Cell(c.channel, c.regime, c.runs, c.samples, c.rms, c.excess, float(p))
        for c, p in zip(cells, corrected, strict=True)
    ]
