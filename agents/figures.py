"""The report's figures, as embedded images."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from evergym.agents.episodes import EpisodeRecord
from evergym.agents.learning_curve import CurvePoint
from evergym.agents.summary import Summary

__all__ = ["draw_curves", "draw_reached_over_time", "draw_success", "draw_wall_force", "encode_frame", "make_sheet"]

_COLOURS = ("#0b7285", "#d9480f", "#868e96", "#5f3dc4", "#2b8a3e", "#a61e4d", "#e67700", "#1864ab")


def assign_colours(arms: Sequence[str]) -> dict[str, str]:
    """One colour per arm, the same in every figure."""
    return {arm: _COLOURS[number % len(_COLOURS)] for number, arm in enumerate(arms)}


def draw_curves(curves: Mapping[str, Sequence[CurvePoint]]) -> str:
    """Return and success rate over the steps of training, one line per run."""
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    axes = figure.subplots(1, 2)
    for (name, points), colour in zip(curves.items(), _COLOURS, strict=False):
        for axis, attribute, factor in ((axes[0], "return_mean", 1.0), (axes[1], "success_rate", 100.0)):
            kept = [point for point in points if np.isfinite(getattr(point, attribute))]
            steps = [point.step for point in kept]
            values = [factor * getattr(point, attribute) for point in kept]
            axis.plot(steps, values, color=colour, alpha=0.35, linewidth=0.8)
            axis.plot(steps, _smooth(values, [point.episodes for point in kept]), color=colour, label=name)
    axes[0].set(xlabel="environment steps", ylabel="return of an episode")
    axes[1].set(xlabel="environment steps", ylabel="success in training [%]", ylim=(-3.0, 103.0))
    axes[0].legend(fontsize=8)
    return _encode(figure)


def _smooth(values: Sequence[float], weights: Sequence[int]) -> NDArray[np.float64]:
    """Mean over the last five points, weighted by their episodes."""
    table, weight = np.asarray(values), np.asarray(weights, dtype=float)
    spans = [slice(max(0, end - 5), end) for end in range(1, len(table) + 1)]
    return np.array([np.average(table[span], weights=weight[span]) for span in spans])


def draw_success(summary: Summary, colours: Mapping[str, str]) -> str:
    """Success rate of every arm on every split, with its interval."""
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    axis = figure.subplots()
    width = 0.8 / max(len(colours), 1)
    for position, split in enumerate(summary.splits):
        for arm in split.arms:
            number = list(colours).index(arm.arm)
            x = position + (number - 0.5 * (len(colours) - 1)) * width
            value, low, high = (100.0 * number for number in arm.success)
            axis.bar(x, value, 0.9 * width, color=colours[arm.arm], label=arm.arm if position == 0 else None)
            errors = [[max(0.0, value - low)], [max(0.0, high - value)]]
            axis.errorbar(x, value, yerr=errors, color="black", capsize=3, linewidth=1.0)
    axis.set_xticks(range(len(summary.splits)), [split.split for split in summary.splits])
    axis.set(ylabel="targets reached [%]", ylim=(0.0, 105.0))
    axis.legend(fontsize=8, ncols=4, loc="upper center", bbox_to_anchor=(0.5, 1.18))
    return _encode(figure)


def draw_reached_over_time(records: Sequence[EpisodeRecord], colours: Mapping[str, str]) -> str:
    """Share of the targets reached within a time, of one split."""
    figure = Figure(figsize=(4.4, 3.2), layout="constrained")
    axis = figure.subplots()
    end = max((record.time_s for record in records if np.isfinite(record.time_s)), default=1.0)
    for arm, colour in colours.items():
        own = [record for record in records if record.arm == arm]
        if own:
            times = sorted(record.time_s for record in own if record.success)
            share = [100.0 * (number + 1) / len(own) for number in range(len(times))]
            last = share[-1] if share else 0.0
            axis.step([0.0, *times, end], [0.0, *share, last], where="post", color=colour, label=arm)
    axis.set(xlabel="robot time [s]", ylabel="targets reached [%]", ylim=(-2.0, 102.0))
    axis.legend(fontsize=8)
    return _encode(figure)


def draw_wall_force(records: Sequence[EpisodeRecord], colours: Mapping[str, str]) -> str:
    """Distribution of the peak wall force over the episodes of one split."""
    figure = Figure(figsize=(4.4, 3.2), layout="constrained")
    axis = figure.subplots()
    for position, (arm, colour) in enumerate(colours.items()):
        forces = [r.wall_force_peak_n for r in records if r.arm == arm and np.isfinite(r.wall_force_peak_n)]
        if forces:
            parts = axis.boxplot([forces], positions=[position], widths=0.6, patch_artist=True, manage_ticks=False)
            parts["boxes"][0].set_facecolor(colour)
            parts["medians"][0].set_color("black")
    axis.set_xticks(range(len(colours)), list(colours), rotation=15, fontsize=8)
    axis.set(ylabel="peak wall force [N]")
    return _encode(figure)


def make_sheet(frames: Sequence[NDArray[np.uint8]], columns: int = 4) -> NDArray[np.uint8]:
    """Put frames of one size side by side, row by row; missing places are white."""
    height, width, _ = frames[0].shape
    rows = -(-len(frames) // columns)
    sheet = np.full((rows * height, min(columns, len(frames)) * width, 3), 255, dtype=np.uint8)
    for number, frame in enumerate(frames):
        row, column = divmod(number, columns)
        sheet[row * height : (row + 1) * height, column * width : (column + 1) * width] = frame
    return sheet


def encode_frame(frame: NDArray[np.uint8]) -> str:
    """Turn an RGB image into a data address for HTML."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(frame).save(buffer, format="JPEG", quality=85)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def _encode(figure: Any) -> str:
    for axis in figure.axes:
        axis.spines[["top", "right"]].set_visible(False)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})  # no date: the same input gives the same file
    return f"data:image/svg+xml;base64,{base64.b64encode(buffer.getvalue()).decode()}"
