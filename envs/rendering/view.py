"""The views by name, and what they have in common."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evergym.duct_models.duct import Duct
from evergym.duct_models.pegs import PegField
from evergym.envs.rendering.endoscope import EndoscopeView
from evergym.envs.rendering.map_view import MAP_SIZE, MapView
from evergym.envs.rendering.outside import OUTSIDE_SIZE, OutsideView
from evergym.envs.rendering.pose import Pose
from evergym.simulator import Simulator

__all__ = ["VIEWS", "Scene", "View", "make_view"]

Scene = Duct | PegField | None
"""A place to draw: a duct, a field of pegs, or None for free space."""


class View(Protocol):
    """A way to look at a robot in a place."""

    def place(self, scene: Scene, target: tuple[float, float, float] | None) -> None:
        """Show another place, or another target [m] in it; costs nothing if both are those shown already."""

    def frame(self, robot: Simulator | Pose, caption: str = "") -> NDArray[np.uint8]:
        """Return a fresh picture, shape (height, width, 3); a caption is written on it where the view has room."""
        ...

    def close(self) -> None:
        """Free what the view holds; it can be closed more than once."""


VIEWS: dict[str, tuple[type[OutsideView] | type[EndoscopeView] | type[MapView], tuple[int, int]]] = {
    "outside": (OutsideView, OUTSIDE_SIZE),
    "endoscope": (EndoscopeView, (240, 240)),
    "map": (MapView, MAP_SIZE),
}
"""Every view by its name, and the width and height in pixels of what people look at."""


def make_view(
    name: str,
    scene: Scene,
    target: tuple[float, float, float] | None,
    width: int | None = None,
    height: int | None = None,
) -> View:
    """Make a view of a place.

    Args:
        name: A key of ``VIEWS``.
        scene: The place.
        target: Where the robot is to go [m]; None: there is no target.
        width: In pixels; None: the view's own.
        height: The same.
    """
    kind, size = VIEWS[name]
    return kind(scene, target, size=(width or size[0], height or size[1]))
