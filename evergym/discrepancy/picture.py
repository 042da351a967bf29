"""A picture of a dataset: commands and channels of every run over time, and what a model predicts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from evergym.discrepancy.columns import CHANNELS, COLUMNS, COMMANDS
from evergym.discrepancy.dataset import Dataset, Run

__all__ = ["draw_dataset"]

Array = NDArray[np.float64]

COMMAND_COLOUR = "#d9480f"
MEASURED_COLOUR = "#0b7285"
PREDICTED_COLOUR = "#343a40"
PANEL_SIZE = (2.1, 1.25)
"""Width and height of a panel [inch]."""
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
    channels = [i for i, name in enumerate(CHANNELS) if name in dataset.channels]
    columns = len(commands) + len(channels)
    size = (PANEL_SIZE[0] * columns + 0.6, PANEL_SIZE[1] * len(drawn) + 0.9)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(len(drawn), columns, squeeze=False, sharex="row", sharey="col")
    for number, (run, row) in enumerate(zip(drawn, grid, strict=True)):
        for axes, i in zip(row, commands, strict=False):
            _draw_command(axes, run, i)
        for axes, i in zip(row[len(commands) :], channels, strict=True):
            _draw_channel(axes, run, i, dataset.noise.get(CHANNELS[i], 0.0))
            if predictions is not None:
                axes.plot(run.time_s, predictions[number][:, i], color=PREDICTED_COLOUR, linewidth=0.8)
        row[0].set_ylabel(f"{run.id}\n({run.setup})", fontsize=8)
    for axes, i in zip(grid[0], [*commands, *(len(COMMANDS) + i for i in channels)], strict=True):
        axes.set_title(tuple(COLUMNS)[i], fontsize=8)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]", fontsize=8)
    for axes in grid.flat:
        axes.tick_params(labelsize=7)
        axes.margins(x=0.02)
    model = "; black: predicted by the model" if predictions is not None else ""
    figure.suptitle(f"{dataset.name}: commands (orange) and measurements (blue, band: 1 sigma){model}", fontsize=10)
    figure.savefig(path, dpi=110)


def _is_used(values: Array) -> bool:
    return bool(np.any(np.isfinite(values) & (values != 0.0)))


def _draw_command(axes: Axes, run: Run, index: int) -> None:
    values = run.commands[:, index]
    axes.step(run.time_s, values, where="post", color=COMMAND_COLOUR, linewidth=1.0)
    if not np.isfinite(values).any():
        axes.text(0.5, 0.5, "coupled", transform=axes.transAxes, ha="center", va="center", fontsize=7, color="grey")


def _draw_channel(axes: Axes, run: Run, index: int, sigma: float) -> None:
    seen = np.isfinite(run.measured[:, index])
    time, values = run.time_s[seen], run.measured[seen, index]
    if len(time) > MANY_SAMPLES:
        axes.fill_between(time, values - sigma, values + sigma, color=MEASURED_COLOUR, alpha=0.25, linewidth=0.0)
        axes.plot(time, values, color=MEASURED_COLOUR, linewidth=0.7)
    else:
        axes.errorbar(time, values, yerr=sigma, fmt=".", markersize=3.0, color=MEASURED_COLOUR, elinewidth=0.8)
