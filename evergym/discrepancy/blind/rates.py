"""Rates with their Wilson intervals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from scipy import stats

__all__ = ["Rate", "compute_rate"]

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Rate:
    """How many of how many, with the 95 % interval; all None where there are none to count."""

    count: int
    of: int
    rate: float | None
    low: float | None
    high: float | None

    def to_json(self) -> dict[str, Any]:
        """Return the rate as plain numbers."""
        return {"rate": self.rate, "low": self.low, "high": self.high, "count": self.count, "of": self.of}

    def describe(self) -> str:
        """Return the rate as people read it: ``92 % (84 to 96 %, 55 of 60)``."""
        if self.rate is None or self.low is None or self.high is None:
            return "no cases"
        return f"{self.rate:.1%} ({self.low:.0%} to {self.high:.0%}, {self.count} of {self.of})"


def compute_rate(outcomes: Iterable[bool | None]) -> Rate:
    """Return the rate of True among what is not None.

    Source: Wilson 1927, doi 10.1080/01621459.1927.10502953; computed by scipy.
    """
    counted = [bool(outcome) for outcome in outcomes if outcome is not None]
    if not counted:
        return Rate(0, 0, None, None, None)
    interval = stats.binomtest(sum(counted), len(counted)).proportion_ci(CONFIDENCE, method="wilson")
    return Rate(
        sum(counted),
        len(counted),
        round(sum(counted) / len(counted), 4),
        round(float(interval.low), 4),
        round(float(interval.high), 4),
    )
