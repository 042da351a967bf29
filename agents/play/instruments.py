"""The instruments beside the canvas: the endoscope's picture and the live plots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import viser
import viser.uplot
from numpy.typing import NDArray
from PIL import Image

from evergym.agents.play.episode import Frame
from evergym.duct_models.duct import Duct
from evergym.duct_models.pegs import PegField
from evergym.envs.rendering.endoscope import EndoscopeView

__all__ = ["Instruments"]

_PICTURE = 220
"""Side of the endoscope's picture on the page [pixels]; it is drawn smaller and enlarged."""
_POINTS = 240
"""Points of a plot at most."""
_TICK_SPACE = 16
"""Least height between two values on an axis [pixels]: the plots are low."""
_PLOTS = (
    ("pressure_kpa", "pressure [kPa]", "#1971c2", 20.0),
    ("everted_length_mm", "everted length [mm]", "#2f9e44", 10.0),
    ("tip_error_mm", "tip error [mm]", "#9c36b5", 10.0),
    ("wall_force_n", "wall force, sum [N]", "#e03131", 0.1),
)
"""Column, title, colour, and the least range of the axis."""


class Instruments:
    """A panel at the left edge.

    Args:
        server: The page's server.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self._view: EndoscopeView | None = None
        panel = server.gui.add_panel()
        panel.dock_left()
        panel.set_width(300)
        self._plots: dict[str, viser.GuiUplotHandle] = {}
        black = np.zeros((_PICTURE, _PICTURE, 3), dtype=np.uint8)
        with panel.add_tab("Instruments"):
            self._picture = server.gui.add_image(black, label="View from the tip (tendon side up)", jpeg_quality=80)
            for name, title, colour, _ in _PLOTS:
                self._plots[name] = server.gui.add_uplot(
                    (np.array([0.0, 1.0]), np.array([0.0, 0.0])),
                    (viser.uplot.Series(label="time"), viser.uplot.Series(label=title, stroke=colour, width=2)),
                    title=title,
                    scales={"x": viser.uplot.Scale(time=False)},
                    legend=viser.uplot.Legend(show=False),
                    axes=(viser.uplot.Axis(), viser.uplot.Axis(space=_TICK_SPACE, size=44)),
                    height=92,
                    padding=(8, 12, 0, 0),
                )

    def place(self, scene: Duct | PegField, target: tuple[float, float, float]) -> None:
        """Look at another place."""
        if self._view is None:
            self._view = EndoscopeView(scene, target)
        else:
            self._view.place(scene, target)

    def show_picture(self, frame: Frame) -> None:
        """Draw the view from the tip."""
        if self._view is not None:
            small = Image.fromarray(self._view.frame(frame.pose))
            self._picture.image = np.asarray(small.resize((_PICTURE, _PICTURE), Image.Resampling.BICUBIC))

    def show_plots(self, frames: Sequence[Frame], end_s: float | None = None) -> None:
        """Draw the plots of an episode up to now.

        Args:
            frames: From the start on.
            end_s: Right end of the time axis [s]; None: the latest frame.
        """
        chosen = frames[:: max(1, len(frames) // _POINTS)]
        if chosen[-1] is not frames[-1]:
            chosen = [*chosen, frames[-1]]
        times = _column(chosen, "time_s")
        right = max(end_s if end_s is not None else times[-1], 1.0)
        for name, _, _, least in _PLOTS:
            plot, values = self._plots[name], _column(chosen, name)
            top = max(least, 1.05 * float(np.max(values, initial=0.0)))
            plot.scales = {
                "x": viser.uplot.Scale(time=False, auto=False, range=(0.0, right)),
                "y": viser.uplot.Scale(auto=False, range=(0.0, top)),
            }
            plot.data = (times, values)

    def close(self) -> None:
        """Free the view."""
        if self._view is not None:
            self._view.close()


def _column(frames: Sequence[Frame], name: str) -> NDArray[np.float64]:
    return np.array([frame.values[name] for frame in frames])
