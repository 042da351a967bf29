"""How every figure looks, and how it is written: whole or not at all, as PNG, PDF or SVG."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, ListedColormap
from matplotlib.figure import Figure

from evergym.agents.plotting.target import check_target
from evergym.whole_file import whole_file

__all__ = ["COLOURS", "FULL_WIDTH_MM", "SINGLE_WIDTH_MM", "make_shades", "write_figure"]

SINGLE_WIDTH_MM = 89.0
"""One column of a journal's page."""
FULL_WIDTH_MM = 183.0
"""Both columns."""
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000", "#7a7a7a")
"""Colours that are told apart with any kind of colour vision.

Source: Okabe and Ito 2008, https://jfly.uni-koeln.de/color/ (their yellow, too light for lines, is grey here).
"""

_INCH_MM = 25.4
_STYLE: Any = {  # matplotlib types its keys one by one
    "font.family": "sans-serif",
    "font.sans-serif": ["Arial", "Helvetica", "Liberation Sans", "DejaVu Sans"],
    "font.size": 8.0,
    "axes.labelsize": 8.0,
    "axes.titlesize": 8.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "lines.linewidth": 1.2,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.5,
    "pdf.fonttype": 42,  # text stays text, which journals ask for
    "svg.fonttype": "none",
    "svg.hashsalt": "evergym",
    "figure.constrained_layout.use": True,
    "figure.constrained_layout.w_pad": 0.03,
    "figure.constrained_layout.h_pad": 0.03,
}


def make_shades() -> Colormap:
    """Return the colours of a quantity that goes from little to much; the lightest, lost on paper, are left out."""
    return ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0.0, 0.88, 256)))


def write_figure(
    path: Path, width_mm: float, height_mm: float, columns: int, rows: int, draw: Callable[[Figure, list[Axes]], None]
) -> Path:
    """Make a figure with a grid of axes, have it drawn on, and write it in the format of the file's ending.

    Args:
        path: The file; ``check_target`` says which endings there are.
        width_mm: Width of the figure.
        height_mm: Height of the figure.
        columns: Of axes.
        rows: Of axes.
        draw: Is given the figure and its axes, row by row.

    Raises:
        ConfigError: another ending.
        RunError: the file exists already.
    """
    check_target(path)
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(width_mm / _INCH_MM, height_mm / _INCH_MM))
        axes = figure.subplots(rows, columns, squeeze=False)
        draw(figure, list(axes.ravel()))
        if rows * columns > 1:
            for letter, axis in zip("abcdefgh", axes.ravel(), strict=False):
                axis.set_title(f"{letter}  {axis.get_title(loc='left')}".rstrip())
        kind = path.suffix[1:].lower()
        # Without a date the same input gives the same file.
        metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as draft:
            figure.savefig(draft, format=kind, dpi=300, metadata=metadata)
    return path
