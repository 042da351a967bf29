"""Whether confidence means what it says: of the names given with so much of it, how many were right."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from evergym.discrepancy.blind.rates import Rate, compute_rate
from evergym.discrepancy.blind.score import CaseScore
from evergym.discrepancy.blind.truth import Kind

__all__ = ["Bin", "compute_reliability"]

EDGES = (0.0, 0.5, 0.8, 0.95, 1.0)
"""Limits of the bins; the last holds 1 too."""


@dataclass(frozen=True)
class Bin:
    """First names whose confidence lies between two limits.

    Attributes:
        low: Least confidence.
        high: Its upper limit.
        mean: Mean confidence of the names; None: there are none.
        right: How many of them are hidden effects.
    """

    low: float
    high: float
    mean: float | None
    right: Rate

    def to_json(self) -> dict[str, Any]:
        """Return the bin as plain values."""
        return {"from": self.low, "to": self.high, "mean_confidence": self.mean, "right": self.right.to_json()}


def compute_reliability(scores: Sequence[CaseScore]) -> tuple[Bin, ...]:
    """Return the bins of all first names; one for what lies outside the library, or is not there, is wrong."""
    named = [
        (score.confidence, score.kind in (Kind.SINGLE, Kind.TWO) and score.named[0] in score.truth)
        for score in scores
        if score.kind != Kind.FAULT and score.named and score.confidence is not None
    ]
    bins = []
    for low, high in itertools.pairwise(EDGES):
        mine = [entry for entry in named if low <= entry[0] < high or entry[0] == high == EDGES[-1]]
        mean = round(float(np.mean([confidence for confidence, _ in mine])), 3) if mine else None
        bins.append(Bin(low, high, mean, compute_rate(right for _, right in mine)))
    return tuple(bins)
