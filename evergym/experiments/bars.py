"""How close the project wants to come to the measured robot: bars on the errors, set before the identification."""

from __future__ import annotations

from typing import NamedTuple

from evergym.experiments.parameter_sets import Column

__all__ = ["BARS", "Bar", "find_bar"]


class Bar(NamedTuple):
    """Largest error that was asked for, fitted and in the other column, in the experiment's unit; None: no bar."""

    fitted: float
    other: float | None = None
    column: Column | None = None
    """The other column."""


BARS = {
    "fig6_toward": Bar(0.20),
    "fig6_opposite": Bar(0.15),
    "fig7": Bar(0.15),
    "fig8b": Bar(5.0, 12.0, Column.LEFT_OUT),
    "fig8c": Bar(0.10, 0.20, Column.LEFT_OUT),
    "fig9": Bar(2.0, 4.0, Column.LEFT_OUT),
    "fig10": Bar(0.10, 0.20, Column.PREDICTED),
    "fig11a": Bar(0.45, 1.1, Column.PREDICTED),
    "fig11b": Bar(0.40, 0.8, Column.PREDICTED),
    "fig11c": Bar(0.70, 0.8, Column.PREDICTED),
    "fig11d": Bar(0.60, 1.8, Column.PREDICTED),
}
"""The project's own aims. They are no measurements; Fig. 6 across the plane and the tip position have none."""


def find_bar(experiment: str, column: Column) -> float | None:
    """Return the bar of an experiment in a column, None where there is none."""
    bar = BARS.get(experiment)
    if bar is None:
        return None
    if column is Column.FITTED:
        return bar.fitted
    return bar.other if bar.column is column else None
