"""Learning curves of runs: return and success over the steps of training."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray

from evergym.agents.learning_curve import CurvePoint, read_curve
from evergym.agents.plotting.style import COLOURS, FULL_WIDTH_MM, write_figure
from evergym.agents.run_folder import RunFolder
from evergym.agents.settings import TrainSettings
from evergym.errors import RunError

__all__ = ["LearningGroup", "draw_learning", "read_learning"]

Array = NDArray[np.float64]

_SPAN = 5
_GRID = 200


class LearningGroup(NamedTuple):
    """Runs that differ in nothing but their seed."""

    label: str
    curves: tuple[tuple[CurvePoint, ...], ...]


def read_learning(paths: Sequence[Path]) -> tuple[LearningGroup, ...]:
    """Read runs and group them.

    Raises:
        RunError: a folder holds no run, or no point of a curve yet.
    """
    groups: dict[str, list[tuple[str, tuple[CurvePoint, ...]]]] = {}
    for path in paths:
        run = RunFolder.open(path)
        points = read_curve(run.curve)
        if not points:
            raise RunError(f"Run '{path}' has no point of a learning curve yet: train it for longer.")
        # What does not change what is learned must not part the seeds of one method.
        neutral = dataclasses.replace(run.settings, seed=0, folder=None, resume=None)
        groups.setdefault(repr(neutral), []).append((_name(run.settings, run.name), points))
    found = []
    for members in groups.values():
        names = [name for name, _ in members]
        label = names[0] if len(names) == 1 else f"{_strip_seed(names[0])}, {len(names)} seeds"
        found.append(LearningGroup(label, tuple(points for _, points in members)))
    return tuple(found)


def _name(settings: TrainSettings, folder: str) -> str:
    return folder or settings.algorithm.value


def _strip_seed(name: str) -> str:
    head, _, tail = name.rpartition("seed")
    return head.rstrip("-_ ") if head and tail.isdigit() else name.rstrip("0123456789-_ ") or name


def draw_learning(groups: Sequence[LearningGroup], path: Path) -> Path:
    """Draw the curves, smoothed over five points; returns the file."""

    def draw(figure: Figure, axes: list[Axes]) -> None:
        for axis, attribute, factor in ((axes[0], "return_mean", 1.0), (axes[1], "success_rate", 100.0)):
            for number, group in enumerate(groups):
                _draw_group(axis, group, attribute, factor, COLOURS[number % len(COLOURS)])
            axis.xaxis.set_major_formatter(EngFormatter(sep=""))
            axis.set_xlabel("environment steps")
            axis.set_xlim(left=0.0)
            axis.grid(visible=True)
        axes[0].set(ylabel="return of an episode", title="Return")
        axes[1].set(ylabel="targets reached [%]", title="Success in training", ylim=(-3.0, 103.0))
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 3))

    return write_figure(path, FULL_WIDTH_MM, 70.0 + 4.0 * ((len(groups) - 1) // 3), 2, 1, draw)


def _draw_group(axes: Axes, group: LearningGroup, attribute: str, factor: float, colour: str) -> None:
    lines = [line for points in group.curves if len((line := _smooth(points, attribute))[0])]
    if not lines:
        return  # runs whose environment reports no success
    if len(lines) == 1:
        marker = "o" if len(lines[0][0]) == 1 else ""
        axes.plot(
            lines[0][0], factor * lines[0][1], marker, color=colour, linestyle="-", markersize=3.0, label=group.label
        )
        return
    # Where all of them have been: the mean of fewer would jump.
    grid = np.linspace(max(line[0][0] for line in lines), min(line[0][-1] for line in lines), _GRID)
    values = factor * np.array([np.interp(grid, steps, line) for steps, line in lines])
    axes.fill_between(grid, values.min(axis=0), values.max(axis=0), color=colour, alpha=0.2, linewidth=0.0)
    axes.plot(grid, values.mean(axis=0), color=colour, label=f"{group.label} (mean and range)")


def _smooth(points: Sequence[CurvePoint], attribute: str) -> tuple[Array, Array]:
    """Return steps and the mean over the last five points, weighted by their episodes."""
    kept = [point for point in points if np.isfinite(getattr(point, attribute)) and point.episodes > 0]
    values = np.array([getattr(point, attribute) for point in kept])
    weights = np.array([point.episodes for point in kept], dtype=np.float64)
    spans = [slice(max(0, end - _SPAN), end) for end in range(1, len(kept) + 1)]
    means = np.array([np.average(values[span], weights=weights[span]) for span in spans])
    return np.array([float(point.step) for point in kept]), means
