"""Arms against each other, from an evaluation folder: targets reached, time to target, wall force."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from evergym.agents.episodes import EpisodeRecord
from evergym.agents.evaluation import open_evaluation, summarise_folder
from evergym.agents.plotting.style import COLOURS, FULL_WIDTH_MM, write_figure
from evergym.agents.summary import Summary

__all__ = ["draw_comparison"]

_GROUP_WIDTH = 0.8
_BAR_WIDTH = 0.25
_FEW = 6


def draw_comparison(folder: Path, path: Path) -> Path:
    """Draw the evaluation in a folder; returns the file.

    Raises:
        RunError: the folder holds no evaluation, or none of its episodes is finished.
    """
    plan, records = open_evaluation(folder)
    summary = summarise_folder(folder)
    arms = [arm.name for arm in plan.arms if any(record.arm == arm.name for record in records)]
    splits = [split.split for split in summary.splits]
    counts = sorted({arm.episode_count for split in summary.splits for arm in split.arms})
    episodes = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"

    def draw(figure: Figure, axes: list[Axes]) -> None:
        _draw_success(axes[0], summary, arms)
        _draw_boxes(axes[1], records, arms, splits, lambda r: r.time_s if r.success else np.nan, counted=True)
        _draw_boxes(axes[2], records, arms, splits, lambda r: r.wall_force_peak_n)
        axes[0].set(ylabel="targets reached [%]", ylim=(0.0, 105.0), title=f"Success in {episodes} episodes")
        axes[1].set(ylabel="time to target [s]", title="Time (number: reached)", ylim=(0.0, None))
        axes[2].set(ylabel="peak wall force [N]", title="Largest force on one section", ylim=(0.0, None))
        axes[1].set_ylim(top=1.06 * axes[1].get_ylim()[1])  # room for the numbers
        for axis in axes:
            axis.set_xticks(range(len(splits)), [split.replace("_", " ") for split in splits])
            axis.set_xlim(-0.5, len(splits) - 0.5)
            axis.tick_params(axis="x", length=0.0)
            axis.grid(visible=True, axis="y")
        handles = [Patch(color=COLOURS[k % len(COLOURS)], label=arm.replace("_", " ")) for k, arm in enumerate(arms)]
        figure.legend(handles=handles, loc="outside lower center", ncols=min(len(arms), 6))

    # A few bars stand side by side in a strip; many need the width of the page.
    if len(splits) * len(arms) <= _FEW:
        return write_figure(path, FULL_WIDTH_MM, 66.0, 3, 1, draw)
    return write_figure(path, FULL_WIDTH_MM, 165.0, 1, 3, draw)


def _place(number: int, count: int) -> tuple[float, float]:
    """Return where an arm stands beside the middle of its split, and its width."""
    width = min(_GROUP_WIDTH / count, _BAR_WIDTH)
    return (number - 0.5 * (count - 1)) * width, 0.86 * width


def _draw_success(axes: Axes, summary: Summary, arms: Sequence[str]) -> None:
    for position, split in enumerate(summary.splits):
        for arm in split.arms:
            number = arms.index(arm.arm)
            shift, width = _place(number, len(arms))
            value, low, high = (100.0 * share for share in arm.success)
            axes.bar(position + shift, value, width, color=COLOURS[number % len(COLOURS)])
            errors = [[max(0.0, value - low)], [max(0.0, high - value)]]
            axes.errorbar(position + shift, value, yerr=errors, color="black", capsize=2.0, linewidth=0.8)


def _draw_boxes(
    axes: Axes,
    records: Sequence[EpisodeRecord],
    arms: Sequence[str],
    splits: Sequence[str],
    read: Callable[[EpisodeRecord], float],
    *,
    counted: bool = False,
) -> None:
    """Draw medians, quartiles and outliers; ``counted`` says of how many episodes."""
    for position, split in enumerate(splits):
        for number, arm in enumerate(arms):
            values = [value for r in records if (r.arm, r.split) == (arm, split) and np.isfinite(value := read(r))]
            if not values:
                continue
            shift, width = _place(number, len(arms))
            drawn = axes.boxplot(
                [values], positions=[position + shift], widths=width, patch_artist=True, manage_ticks=False,
                medianprops={"color": "black", "linewidth": 1.0}, whiskerprops={"linewidth": 0.7},
                boxprops={"linewidth": 0.6}, capprops={"linewidth": 0.7},
                flierprops={"marker": ".", "markersize": 2.5, "markeredgewidth": 0.0, "markerfacecolor": "#555555"},
            )  # fmt: skip
            drawn["boxes"][0].set_facecolor(COLOURS[number % len(COLOURS)])
            drawn["boxes"][0].set_alpha(0.85)
            if counted:
                top = (position + shift, max(values))
                axes.annotate(f"{len(values)}", top, xytext=(0, 3), textcoords="offset points", ha="center", fontsize=6)
