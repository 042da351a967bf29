"""A picture of a dataset: commands and channels of every run over time, and what a model predicts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import CHANNELS, COMMANDS
from evergym.discrepancy.data.dataset import Dataset, Run

__all__ = ["draw_dataset"]

Array = NDArray[np.float64]

COMMAND_COLOUR = "#d9480f"
MEASURED_COLOUR = "#0b7285"
PREDICTED_COLOUR = "#343a40"
PANEL_SIZE = (2.1, 1.25)
"""Width and height of a panel [inch]."""
PANEL_SHARE = (0.76, 0.7)
"""Share of a panel that its axes take; the rest is for their numbers."""
MARGIN = (1.2, 0.1, 0.15, 0.65)
"""Left, right, below and above the panels [inch]."""
MANY_SAMPLES = 60
"""Above this, samples are drawn as a line, else as points."""


def draw_dataset(
    dataset: Dataset, path: Path, predictions: Sequence[Array] | None = None, runs: Sequence[Run] | None = None
) -> None:
    """Draw one row of panels per run: first what was commanded, then what was measured.

    Args:
        dataset: The runs.
        path: The PNG file.
        predictions: For each drawn run its predicted channels, shape (k, 9), or None.
        runs: Some of the dataset's runs; None: all.
    """
    drawn = dataset.runs if runs is None else runs
    commands = [i for i in range(len(COMMANDS)) if any(_is_used(run.commands[:, i]) for run in drawn)]
    channels = [i for i in range(len(CHANNELS)) if any(_is_measured(run, i) for run in drawn)]
    figure = _Sheet(len(drawn), len(commands) + len(channels))
    for row, run in enumerate(drawn):
        for column, i in enumerate(commands):
            if _is_used(run.commands[:, i]):
                _draw_command(figure.add_panel(row, column), run, i)
        for column, i in enumerate(channels, start=len(commands)):
            if _is_measured(run, i):
                axes = figure.add_panel(row, column)
                _draw_channel(axes, run, i, dataset.noise.get(CHANNELS[i], 0.0))
                if predictions is not None:
                    axes.plot(run.time_s, predictions[row][:, i], color=PREDICTED_COLOUR, linewidth=0.8)
        figure.name_row(row, f"{run.id}\n({run.setup})")
    for column, name in enumerate([*(COMMANDS[i] for i in commands), *(CHANNELS[i] for i in channels)]):
        figure.finish_column(column, name)
    model = "; black: predicted by the model" if predictions is not None else ""
    title = f"{dataset.name}: commands (orange) and measurements (blue, with one sigma) over time [s]{model}"
    figure.save(path, title)


class _Sheet:
    """A grid of panels, of which only those that show something are made: each costs 30 ms."""

    def __init__(self, rows: int, columns: int) -> None:
        left, right, below, above = MARGIN
        self.width = PANEL_SIZE[0] * columns + left + right
        self.height = PANEL_SIZE[1] * rows + below + above
        self.figure = Figure(figsize=(self.width, self.height))
        self.panels: dict[tuple[int, int], Axes] = {}

    def add_panel(self, row: int, column: int) -> Axes:
        x, y = self._find_corner(row, column)
        size = (PANEL_SIZE[0] * PANEL_SHARE[0] / self.width, PANEL_SIZE[1] * PANEL_SHARE[1] / self.height)
        axes = self.figure.add_axes((x / self.width, y / self.height, *size))
        axes.tick_params(labelsize=7)
        axes.margins(x=0.02)
        self.panels[row, column] = axes
        return axes

    def name_row(self, row: int, text: str) -> None:
        y = self._find_corner(row, 0)[1] + 0.5 * PANEL_SIZE[1] * PANEL_SHARE[1]
        self.figure.text(0.1 / self.width, y / self.height, text, fontsize=8, va="center")

    def finish_column(self, column: int, title: str) -> None:
        """Give the panels of a column one scale, and the column its title."""
        panels = [axes for (_, other), axes in self.panels.items() if other == column]
        low, high = min(axes.get_ylim()[0] for axes in panels), max(axes.get_ylim()[1] for axes in panels)
        for axes in panels:
            axes.set_ylim(low, high)
        x, y = self._find_corner(0, column)
        y += PANEL_SIZE[1] * PANEL_SHARE[1] + 0.08
        self.figure.text((x - 0.2) / self.width, y / self.height, title, fontsize=8, fontweight="bold")

    def save(self, path: Path, title: str) -> None:
        self.figure.text(0.1 / self.width, 1.0 - 0.1 / self.height, title, fontsize=10, va="top")
        self.figure.savefig(path, dpi=110)

    def _find_corner(self, row: int, column: int) -> tuple[float, float]:
        """Return where the lower left corner of a panel is [inch]."""
        left, _, _, above = MARGIN
        return left + PANEL_SIZE[0] * column, self.height - above - PANEL_SIZE[1] * (row + PANEL_SHARE[1])


def _is_used(values: Array) -> bool:
    return bool(np.any(np.isfinite(values) & (values != 0.0)))


def _is_measured(run: Run, channel: int) -> bool:
    return bool(np.isfinite(run.measured[:, channel]).any())


def _draw_command(axes: Axes, run: Run, index: int) -> None:
    axes.step(run.time_s, run.commands[:, index], where="post", color=COMMAND_COLOUR, linewidth=1.0)


def _draw_channel(axes: Axes, run: Run, index: int, sigma: float) -> None:
    seen = np.isfinite(run.measured[:, index])
    time, values = run.time_s[seen], run.measured[seen, index]
    if len(time) > MANY_SAMPLES:
        axes.fill_between(time, values - sigma, values + sigma, color=MEASURED_COLOUR, alpha=0.25, linewidth=0.0)
        axes.plot(time, values, color=MEASURED_COLOUR, linewidth=0.7)
    else:
        axes.errorbar(time, values, yerr=sigma, fmt=".", markersize=3.0, color=MEASURED_COLOUR, elinewidth=0.8)
