"""The paper's figures: the robot, the paper's simulator and ours in one plot each."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from evergym.experiments.comparison import Comparison, ExperimentResult
from evergym.experiments.experiment import ErrorMeasure
from evergym.experiments.paper import AMBIENT_PRESSURE
from evergym.experiments.parameter_sets import Column
from evergym.experiments.residuals import split_by_load
from evergym.units import GRAM_FORCE, KPA, MM

__all__ = ["FIGURES", "draw_figure", "draw_load_parts"]


class _Line(NamedTuple):
    label: str
    colour: str
    style: str


_MEASURED = _Line("measured", "black", "o")
_PAPER = _Line("the paper's simulator", "#adb5bd", "-")
_LINES = {
    Column.FITTED: _Line("ours, fitted", "#0b7285", "-"),
    Column.PREDICTED: _Line("ours, predicted", "#d9480f", "--"),
    Column.LEFT_OUT: _Line("ours, left out", "#5f3dc4", ":"),
}
_LOAD_PAIRS = {"straight": ("fig11a", "fig11b"), "deflected": ("fig11c", "fig11d")}
"""Panels of Fig. 11 with the load opposite and toward."""


class _Axis(NamedTuple):
    """A condition on the horizontal axis."""

    column: str
    label: str
    scale: float
    offset: float = 0.0


_LOAD = _Axis("load", "tip load [g]", GRAM_FORCE)
_PULL = _Axis("tendon_pull", "tendon pull [mm]", MM)
_TIME = _Axis("time", "time [s]", 1.0)
_PRESSURE = _Axis("pressure", "absolute pressure [kPa]", KPA, AMBIENT_PRESSURE)


class _Panel(NamedTuple):
    title: str
    result: ExperimentResult
    rows: NDArray[np.bool_]


class _Plan(NamedTuple):
    """What a figure shows: experiments, the condition along x, and the condition of which each value has a panel."""

    title: str
    experiments: tuple[str, ...]
    axis: _Axis
    split: str = ""
    quantity: str = ""


FIGURES = {
    "fig6": _Plan(
        "Fig. 6: catheter under tip loads", ("fig6_toward", "fig6_opposite", "fig6_90deg"), _LOAD, quantity="curvature"
    ),
    "fig7": _Plan("Fig. 7: catheter, tendon pulled", ("fig7",), _PULL, quantity="curvature"),
    "fig8a": _Plan("Fig. 8a: growth of the sheath", ("fig8a",), _TIME, "curve", "grown length"),
    "fig8b": _Plan("Fig. 8b: final grown length", ("fig8b",), _PRESSURE, "feed_velocity", "final length"),
    "fig8c": _Plan("Fig. 8c: mean growing speed", ("fig8c",), _PRESSURE, "feed_velocity", "mean speed"),
    "fig9": _Plan("Fig. 9: the sheath hanging under gravity", ("fig9",), _PRESSURE, quantity="angle below horizontal"),
    "fig10": _Plan("Fig. 10: full system, tendon pulled by 4.9 mm", ("fig10",), _PRESSURE, quantity="curvature"),
    "fig11a": _Plan("Fig. 11a: full system, straight, load opposite", ("fig11a",), _PRESSURE, "load", "curvature"),
    "fig11b": _Plan("Fig. 11b: full system, straight, load toward", ("fig11b",), _PRESSURE, "load", "curvature"),
    "fig11c": _Plan("Fig. 11c: full system, deflected, load opposite", ("fig11c",), _PRESSURE, "load", "curvature"),
    "fig11d": _Plan("Fig. 11d: full system, deflected, load toward", ("fig11d",), _PRESSURE, "load", "curvature"),
}
"""The figures of the report, by their names in the paper."""


def draw_figure(name: str, comparison: Comparison) -> str | None:
    """Draw one of `FIGURES` and return it as a data address; None where its experiments were not run."""
    plan = FIGURES[name]
    found = [result for result in map(comparison.find, plan.experiments) if result is not None]
    panels = [panel for result in found for panel in _split(result, plan)]
    if not panels:
        return None
    columns = min(len(panels), 4)
    rows = -(-len(panels) // columns)
    width = 5.2 if len(panels) == 1 else 2.2 + 2.3 * columns
    figure = Figure(figsize=(width, 0.9 + 2.2 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharey=len(found) == 1)
    for number, (panel, axes) in enumerate(zip(panels, grid.flat, strict=False)):
        _draw_panel(axes, panel, plan.axis)
        axes.set_title(panel.title, fontsize=9)
        if number // columns == rows - 1:
            axes.set_xlabel(plan.axis.label)
        if number % columns == 0:
            axes.set_ylabel(f"{plan.quantity} [{panel.result.experiment.unit}]")
    for axes in list(grid.flat)[len(panels) :]:
        axes.set_visible(False)
    handles, labels = _collect_legend([axes for axes in grid.flat if axes.get_visible()])
    figure.legend(handles, labels, fontsize=8, ncols=5, loc="outside upper left", frameon=False)
    return _encode(figure)


def draw_load_parts(comparison: Comparison) -> str | None:
    """Draw the parts of Fig. 11 that change sign with the load and that do not, over the pressure.

    Returns:
        A data address; None where no pair of panels was run.
    """
    pairs = [(title, pair) for title, names in _LOAD_PAIRS.items() if (pair := _find_pair(comparison, *names))]
    if not pairs:
        return None
    figure = Figure(figsize=(2.2 + 4.6 * len(pairs), 3.1), layout="constrained")
    grid = figure.subplots(1, 2 * len(pairs), squeeze=False)[0]
    for number, (title, (opposite, toward)) in enumerate(pairs):
        lines = [(_MEASURED, opposite.experiment.measured, toward.experiment.measured)]
        if opposite.experiment.paper_simulated is not None and toward.experiment.paper_simulated is not None:
            lines.append((_PAPER, opposite.experiment.paper_simulated, toward.experiment.paper_simulated))
        lines += [
            (line, opposite.values[column], toward.values[column])
            for column, line in _LINES.items()
            if column in opposite.values and column in toward.values
        ]
        points = toward.experiment.points
        for line, one, other in lines:
            parts = split_by_load(one, other, points.pressure.to_numpy())
            x = (parts.pressure + _PRESSURE.offset) / _PRESSURE.scale
            for axes, values in zip(grid[2 * number : 2 * number + 2], (parts.odd, parts.even), strict=True):
                _draw_line(axes, x, values, line)
        for axes, part in zip(grid[2 * number : 2 * number + 2], ("changes sign with", "independent of"), strict=True):
            axes.set_title(f"{title}, {part} the load", fontsize=8)
            axes.set_xlabel(_PRESSURE.label)
            axes.spines[["top", "right"]].set_visible(False)
            axes.tick_params(labelsize=8)
    grid[0].set_ylabel("curvature [1/m]")
    handles, labels = _collect_legend(grid)
    figure.legend(handles, labels, fontsize=8, ncols=5, loc="outside upper left", frameon=False)
    return _encode(figure)


def _find_pair(comparison: Comparison, opposite: str, toward: str) -> tuple[ExperimentResult, ExperimentResult] | None:
    one, other = comparison.find(opposite), comparison.find(toward)
    return None if one is None or other is None else (one, other)


def _split(result: ExperimentResult, plan: _Plan) -> Iterator[_Panel]:
    points = result.experiment.points
    if result.experiment.measure is not ErrorMeasure.ABSOLUTE:
        raise ValueError(f"{result.experiment.name}: only single values can be drawn over a condition")
    if not plan.split:
        title = result.experiment.title.split(", ")[-1] if len(plan.experiments) > 1 else ""
        yield _Panel(title, result, np.ones(len(points), dtype=bool))
        return
    for value in dict.fromkeys(points[plan.split]):
        yield _Panel(_name_panel(plan.split, value), result, (points[plan.split] == value).to_numpy())


def _name_panel(column: str, value: float | str) -> str:
    if isinstance(value, str):
        feed, pressure = value.split("_")
        return f"{feed.upper()}, {pressure} kPa"
    if column == "load":
        return f"{value / GRAM_FORCE:.0f} g"
    return f"feed {value / MM:g} mm/s"


def _draw_panel(axes: Axes, panel: _Panel, axis: _Axis) -> None:
    experiment, rows = panel.result.experiment, panel.rows
    x = ((experiment.points[axis.column].to_numpy(dtype=float) + axis.offset) / axis.scale)[rows]
    order = np.argsort(x, kind="stable")
    x, measured = x[order], experiment.measured[rows][order]
    half = np.full(len(x), experiment.resolution)
    if "uncertainty" in experiment.points:
        half = (experiment.points.uncertainty.to_numpy(dtype=float) / MM)[rows][order]
    axes.errorbar(
        x,
        measured,
        yerr=half,
        fmt="o",
        markersize=3.0,
        color="black",
        elinewidth=3.0,
        ecolor="#ced4da",
        label="measured",
    )
    if experiment.paper_simulated is not None:
        _draw_line(axes, x, experiment.paper_simulated[rows][order], _PAPER)
    for column, line in _LINES.items():
        values = panel.result.values.get(column)
        if values is not None:
            _draw_line(axes, x, values[rows][order], line)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)


def _draw_line(axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64], line: _Line) -> None:
    axes.plot(x, y, line.style, color=line.colour, linewidth=1.6, markersize=3.5, label=line.label)


def _collect_legend(all_axes: Sequence[Axes]) -> tuple[list[Artist], list[str]]:
    """Every label once: a column may be missing in the first panel."""
    entries: dict[str, Artist] = {}
    for axes in all_axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    return list(entries.values()), list(entries)


def _encode(figure: Figure) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})  # no date: the same input gives the same file
    return f"data:image/svg+xml;base64,{base64.b64encode(buffer.getvalue()).decode()}"
