"""The learning curve of a run: one CSV row per interval of training."""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

__all__ = ["CurvePoint", "CurveWriter", "read_curve"]


@dataclasses.dataclass(frozen=True)
class CurvePoint:
    """Means over the episodes that ended since the point before (NaN where none did)."""

    step: int
    """Environment steps."""
    seconds: float
    """Wall time of training [s]."""
    episodes: int
    """Episodes that ended."""
    return_mean: float
    """Undiscounted return."""
    length_mean: float
    """Steps per episode."""
    success_rate: float
    """Share of successes."""


def read_curve(path: Path) -> tuple[CurvePoint, ...]:
    """Read a curve; a line cut off by a kill is left out."""
    if not path.is_file():
        return ()
    kinds = {field.name: int if field.type == "int" else float for field in dataclasses.fields(CurvePoint)}
    points: list[CurvePoint] = []
    with path.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            try:
                points.append(CurvePoint(**{name: kind(row[name]) for name, kind in kinds.items()}))  # type: ignore[arg-type]
            except (TypeError, ValueError):
                continue
    return tuple(points)


class CurveWriter:
    """Collects finished episodes and appends points to the file.

    Args:
        path: The CSV file.
        step: Points after this step are dropped: they belong to a part that is trained again after a kill.
    """

    def __init__(self, path: Path, step: int):
        self._path = path
        kept = [point for point in read_curve(path) if point.step <= step]
        self.last_step = kept[-1].step if kept else 0
        self._returns: list[float] = []
        self._lengths: list[float] = []
        self._successes: list[float] = []
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([field.name for field in dataclasses.fields(CurvePoint)])
            writer.writerows(dataclasses.astuple(point) for point in kept)

    def collect(self, infos: Sequence[dict[str, Any]]) -> None:
        """Take note of the episodes that ended in a step; `infos` as from a VecMonitor."""
        for info in infos:
            if "episode" in info:
                self._returns.append(float(info["episode"]["r"]))
                self._lengths.append(float(info["episode"]["l"]))
                if "is_success" in info:
                    self._successes.append(float(info["is_success"]))

    def write(self, step: int, seconds: float) -> CurvePoint:
        """Append a point and start a new interval."""
        point = CurvePoint(
            step,
            round(seconds, 1),
            len(self._returns),
            _mean(self._returns),
            _mean(self._lengths),
            _mean(self._successes),
        )
        with self._path.open("a", newline="", encoding="utf-8") as file:
            csv.writer(file).writerow(dataclasses.astuple(point))
        self.last_step = step
        for values in (self._returns, self._lengths, self._successes):
            values.clear()
        return point


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values) if values else math.nan
