"""What is left between model and robot: its size, and which of the conditions it goes with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evergym.experiments.experiment import ErrorMeasure, Experiment
from evergym.units import GRAM_FORCE, KPA, MM

__all__ = ["Dependence", "LoadParts", "ResidualStructure", "analyse_residual", "split_by_load"]


class _Condition(NamedTuple):
    label: str
    unit: str
    scale: float


_CONDITIONS = {
    "load": _Condition("tip load", "g", GRAM_FORCE),
    "pressure": _Condition("gauge pressure", "kPa", KPA),
    "tendon_pull": _Condition("tendon pull", "mm", MM),
    "feed_velocity": _Condition("feed", "mm/s", MM),
    "time": _Condition("time", "s", 1.0),
    "series": _Condition("series", "", 1.0),
}
_GROUPS_MAX = 8
"""More values of a condition than this are put into so many groups of neighbours."""


@dataclass(frozen=True)
class Dependence:
    """How the residual goes with one condition.

    Attributes:
        condition: The condition, in words.
        means: Value of the condition (with its unit) and mean residual there, in the experiment's unit.
        share: Share of the residual's variance about its mean that these means hold, 0..1; where every point has its
            own value of the condition, the share that a straight line holds.
        chance: Share that they would hold on average if the residual had nothing to do with the condition.
    """

    condition: str
    means: tuple[tuple[str, float], ...]
    share: float
    chance: float


@dataclass(frozen=True)
class ResidualStructure:
    """The residual (simulated minus measured) of an experiment.

    Attributes:
        bias: Mean residual.
        scatter: Standard deviation about it.
        reading: Standard deviation that the reading alone makes: its step over the root of 12.
        dependences: The conditions that were varied, the one that holds most of the residual first.
    """

    bias: float
    scatter: float
    reading: float
    dependences: tuple[Dependence, ...]

    def describe(self, unit: str) -> str:
        """Return the structure in a sentence or two."""
        text = f"The model is off by {self.bias:+.3g} {unit} on average, with a scatter of {self.scatter:.2g} {unit}"
        text += f" (the reading alone makes {self.reading:.2g} {unit})."
        telling = [item for item in self.dependences if item.share > max(2.0 * item.chance, 0.25)]
        if self.scatter <= self.reading:
            return f"{text} Beyond the mean nothing is left that the readings resolve."
        if not telling:
            return f"{text} The scatter goes with none of the conditions that were varied."
        parts = []
        for item in telling:
            ends = f"{item.means[0][1]:+.2g} at {item.means[0][0]} to {item.means[-1][1]:+.2g} at {item.means[-1][0]}"
            parts.append(f"{item.condition} holds {100 * item.share:.0f} % of it ({ends} {unit})")
        return f"{text} {_capitalise('; '.join(parts))}."


def analyse_residual(experiment: Experiment, simulated: NDArray[np.float64]) -> ResidualStructure:
    """Return what remains between a simulation and the robot, and what it goes with."""
    residual = experiment.compute_deviations(simulated)
    points = experiment.points.iloc[::2] if experiment.measure is ErrorMeasure.DISTANCE else experiment.points
    found = [
        _find_dependence(condition, points[name].reset_index(drop=True), residual)
        for name, condition in _CONDITIONS.items()
        if name in points and points[name].nunique() > 1
    ]
    return ResidualStructure(
        bias=float(residual.mean()),
        scatter=float(residual.std()),
        reading=2.0 * experiment.resolution / np.sqrt(12.0),
        dependences=tuple(sorted(found, key=lambda item: item.share, reverse=True)),
    )


class LoadParts(NamedTuple):
    """What changes sign with the load (the compliance) and what does not (a bias), means over the loads."""

    pressure: NDArray[np.float64]
    odd: NDArray[np.float64]
    even: NDArray[np.float64]


def split_by_load(
    opposite: NDArray[np.float64], toward: NDArray[np.float64], pressure: NDArray[np.float64]
) -> LoadParts:
    """Split curvatures under opposite loads into the odd and the even part in the load, for every pressure.

    Args:
        opposite: Curvatures with the load opposite [1/m], shape (n,).
        toward: Curvatures with the same loads toward, at the same pressures [1/m], shape (n,).
        pressure: Pressures of the points [Pa], shape (n,).
    """
    table = pd.DataFrame({"odd": 0.5 * (toward - opposite), "even": 0.5 * (toward + opposite), "pressure": pressure})
    means = table.groupby("pressure", sort=True).mean()
    return LoadParts(means.index.to_numpy(dtype=float), means.odd.to_numpy(), means.even.to_numpy())


def _find_dependence(condition: _Condition, values: pd.Series, residual: NDArray[np.float64]) -> Dependence:
    group = values
    if values.nunique() > _GROUPS_MAX:
        group = pd.qcut(values, _GROUPS_MAX, labels=False, duplicates="drop")
    table = pd.DataFrame({"residual": residual, "value": values, "group": group}).groupby("group", sort=True)
    means = table.residual.mean()
    centred = means - residual.mean()
    total = float(np.sum((residual - residual.mean()) ** 2))
    if len(means) == len(residual):
        # Without repeats the means hold everything: a straight line says whether there is a trend.
        share, freedom = float(np.corrcoef(values, residual)[0, 1] ** 2) if total > 0.0 else 0.0, 1
    else:
        share, freedom = float(np.sum(table.size() * centred**2)) / total if total > 0.0 else 0.0, len(means) - 1
    labels = [_label(condition, rows.value) for _, rows in table]
    return Dependence(
        condition.label,
        tuple(zip(labels, means.tolist(), strict=True)),
        share,
        freedom / max(len(residual) - 1, 1),
    )


def _label(condition: _Condition, values: pd.Series) -> str:
    if not pd.api.types.is_numeric_dtype(values):
        return str(values.iloc[0])
    return f"{values.mean() / condition.scale:.3g} {condition.unit}"


def _capitalise(text: str) -> str:
    return text[:1].upper() + text[1:]
