"""How much smaller the disagreement is on experiments that were used neither to choose nor to fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.dataset import Dataset
from evergym.discrepancy.residual import Measurement

__all__ = ["Gap", "measure_gap"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Gap:
    """Root mean squares of residual / noise on the held-out runs.

    Attributes:
        held_out_runs: Ids.
        nominal: Model as given.
        before: Recalibrated model.
        after: With the effects named.
        per_channel: Root mean square of the residual of each channel, in its unit: (before, after).
    """

    held_out_runs: tuple[str, ...]
    nominal: float
    before: float
    after: float
    per_channel: Mapping[str, tuple[float, float]]


def measure_gap(
    dataset: Dataset, measurement: Measurement, held_out: Mask, nominal: Array, before: Array, after: Array
) -> Gap:
    """Compare three predictions (n,) with the samples ``held_out``."""
    runs = tuple(dataset.runs[i].id for i in sorted(set(measurement.run[held_out].tolist())))
    per_channel = {}
    for channel in sorted(set(measurement.channel[held_out].tolist())):
        mask = held_out & (measurement.channel == channel)
        per_channel[CHANNELS[channel]] = (_rms(measurement, before, mask, 1.0), _rms(measurement, after, mask, 1.0))
    values = [_rms(measurement, prediction, held_out, measurement.sigma) for prediction in (nominal, before, after)]
    return Gap(runs, values[0], values[1], values[2], per_channel)


def _rms(measurement: Measurement, prediction: Array, mask: Mask, unit: Array | float) -> float:
    scaled = (measurement.subtract(prediction) / unit)[mask]
    return float(np.sqrt(np.mean(scaled**2)))
