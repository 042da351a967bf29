"""The pictures of a diagnosis's report."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import CHANNELS, COLUMNS, COMMANDS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.locate import SIGNIFICANCE, Cell
from evergym.discrepancy.regimes import REGIMES
from evergym.discrepancy.residual import Measurement

__all__ = ["draw_commands", "draw_held_out", "draw_map", "encode"]

Array = NDArray[np.float64]

BEFORE, AFTER, MEASURED = "#c0392b", "#1f6fb2", "#444444"
PANELS_MAX = 4


def encode(figure: Figure | None) -> str | None:
    """Return a figure as a data URI, so that the page needs no other file."""
    if figure is None:
        return None
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, bbox_inches="tight")
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def draw_map(cells: Sequence[Cell]) -> Figure | None:
    """Draw the map of disagreement: channels by regimes, the excess over the noise in each cell; None without cells."""
    if not cells:
        return None
    regimes = [name for name in REGIMES if any(cell.regime == name for cell in cells)]
    channels = [name for name in CHANNELS if any(cell.channel == name for cell in cells)]
    values = np.full((len(channels), len(regimes)), np.nan)
    for cell in cells:
        significant = cell.p_value <= SIGNIFICANCE
        values[channels.index(cell.channel), regimes.index(cell.regime)] = cell.excess if significant else 0.0
    figure = Figure(figsize=(1.6 + 0.62 * len(regimes), 1.5 + 0.42 * len(channels)))
    axes = figure.subplots()
    top = max(float(np.nanmax(values)) if values.size else 1.0, 1.0)
    image = axes.imshow(values, cmap="OrRd", vmin=0.0, vmax=top, aspect="auto")
    for row, column in np.ndindex(*values.shape):
        value = values[row, column]
        if np.isfinite(value) and value > 0.0:
            colour = "white" if value > 0.6 * top else "black"
            axes.text(column, row, f"{value:.1f}", ha="center", va="center", fontsize=8, color=colour)
    axes.set_xticks(range(len(regimes)), regimes, rotation=40, ha="right", fontsize=8)
    axes.set_yticks(range(len(channels)), channels, fontsize=8)
    figure.colorbar(image, ax=axes, label="excess over the noise [sigma]")
    return figure


def draw_held_out(
    dataset: Dataset, measurement: Measurement, runs: Sequence[int], before: Array, after: Array | None
) -> Figure | None:
    """Draw measured and predicted curves of the runs and channels where the recalibrated model is farthest off.

    Args:
        dataset: The runs.
        measurement: The samples.
        runs: Indices of the runs to choose from.
        before: Predicted by the recalibrated model [channel's unit], (n,).
        after: Predicted with the effects in; None: no effect is named.
    """
    panels = []
    scaled = (measurement.value - before) / measurement.sigma
    for run in runs:
        for channel in range(len(CHANNELS)):
            mask = (measurement.run == run) & (measurement.channel == channel) & np.isfinite(scaled)
            if mask.sum() > 2:
                panels.append((float(np.sqrt(np.mean(scaled[mask] ** 2))), run, channel, mask))
    panels.sort(key=lambda panel: -panel[0])
    panels = panels[:PANELS_MAX]
    if not panels:
        return None
    figure = Figure(figsize=(11.0, 2.6 * ((len(panels) + 1) // 2)))
    grid = figure.subplots((len(panels) + 1) // 2, 2, squeeze=False).ravel()
    for axes in grid[len(panels) :]:
        axes.set_visible(False)
    for axes, (_, run, channel, mask) in zip(grid, panels, strict=False):
        time = dataset.runs[run].time_s[measurement.row[mask]]
        axes.plot(time, measurement.value[mask], ".", ms=3, color=MEASURED, label="measured")
        axes.plot(time, before[mask], "-", lw=1.3, color=BEFORE, label="recalibrated model")
        if after is not None:
            axes.plot(time, after[mask], "-", lw=1.3, color=AFTER, label="corrected model")
        axes.set_title(f"run {dataset.runs[run].id}", fontsize=9)
        axes.set_ylabel(CHANNELS[channel], fontsize=8)
        axes.set_xlabel("time [s]", fontsize=8)
        axes.tick_params(labelsize=8)
    grid[0].legend(fontsize=8)
    figure.tight_layout()
    return figure


def draw_commands(run: Run) -> Figure:
    """Draw the commands of a run that change."""
    active = [i for i in range(len(COMMANDS)) if np.nanmax(np.abs(run.commands[:, i]), initial=0.0) > 0.0]
    figure = Figure(figsize=(8.0, 1.3 * max(len(active), 1)))
    grid = figure.subplots(max(len(active), 1), 1, sharex=True, squeeze=False).ravel()
    for axes, index in zip(grid, active, strict=False):
        axes.step(run.time_s, run.commands[:, index], where="post", color=AFTER, lw=1.3)
        axes.set_ylabel(f"{COMMANDS[index]}\n[{COLUMNS[COMMANDS[index]].unit}]", fontsize=7)
        axes.tick_params(labelsize=8)
    grid[-1].set_xlabel("time [s]", fontsize=8)
    figure.tight_layout()
    return figure
