"""Frequencies at which residuals swing: where to look for what ripples, since no gradient leads from one to another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.dataset import Dataset
from evergym.discrepancy.residual import Measurement

__all__ = ["find_frequencies"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SHARPNESS = 6.0
"""Frequencies tried per resolution (one swing over the longest run)."""
SWINGS_MIN = 2.0
"""A run shows frequencies with at least so many swings in it; slower ones are drift."""
SAMPLES_MIN = 8
BLOCK_MAX = 1_000_000
"""Values of a sine that are held at once: of a run of ten minutes, all frequencies together would take gigabytes."""


def find_frequencies(dataset: Dataset, measurement: Measurement, scaled: Array, use: Mask, count: int) -> list[float]:
    """Return the frequencies [Hz] with the most power in the residuals of all runs and channels, the strongest first.

    A sine and a cosine are fitted to each channel of each run, trend removed (Lomb 1976); their powers add up over all.

    Args:
        dataset: The runs.
        measurement: The samples.
        scaled: Residual over noise, (n,).
        use: Samples that may be looked at, (n,).
        count: Peaks to return at most.
    """
    pieces = []
    for run, recorded in enumerate(dataset.runs):
        for channel in np.unique(measurement.channel[measurement.run == run]):
            mine = use & (measurement.run == run) & (measurement.channel == channel) & np.isfinite(scaled)
            time = recorded.time_s[measurement.row[mine]]
            if len(time) >= SAMPLES_MIN and np.ptp(time) > 0.0:
                value = scaled[mine]
                pieces.append((time, value - np.polyval(np.polyfit(time, value, 1), time)))
    if not pieces:
        return []
    spans = [float(np.ptp(time)) for time, _ in pieces]
    fastest = max(0.5 / float(np.median(np.diff(time))) for time, _ in pieces)
    frequencies = np.arange(SWINGS_MIN / max(spans), fastest, 1.0 / (SHARPNESS * max(spans)))
    power = np.zeros(len(frequencies))
    for (time, value), span in zip(pieces, spans, strict=True):
        shown = (frequencies >= SWINGS_MIN / span) & (frequencies <= 0.5 / float(np.median(np.diff(time))))
        places = np.flatnonzero(shown)
        for block in np.array_split(places, 1 + places.size * time.size // BLOCK_MAX):
            angle = 2.0 * np.pi * frequencies[block, None] * time
            power[block] += _find_power(np.sin(angle), np.cos(angle), value)
    if len(power) < 3:
        return []
    inner = power[1:-1]
    peaks = 1 + np.flatnonzero((inner >= power[:-2]) & (inner > power[2:]))
    strongest = peaks[np.argsort(-power[peaks], kind="stable")[:count]]
    return [float(frequencies[place]) for place in strongest]


def _find_power(sine: Array, cosine: Array, value: Array) -> Array:
    """Return by how much the sum of squares falls with a sine and a cosine of each frequency fitted, shape (f,)."""
    ss, cc, sc = np.sum(sine**2, axis=1), np.sum(cosine**2, axis=1), np.sum(sine * cosine, axis=1)
    s, c = sine @ value, cosine @ value
    determinant = np.maximum(ss * cc - sc**2, 1e-9 * (ss + cc) ** 2 + 1e-30)
    power: Array = (s**2 * cc - 2.0 * s * c * sc + c**2 * ss) / determinant
    return power
