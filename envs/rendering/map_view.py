"""A flat map: the lumen or the pegs seen from one side, the robot as two lines; for debugging at speed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from evergym.duct_models.duct import Duct
from evergym.duct_models.pegs import PegField
from evergym.envs.rendering.pose import Pose, read_pose
from evergym.envs.rendering.side import choose_side, fit_scale, list_corners
from evergym.envs.rendering.writing import INK, draw_scale_bar, find_font
from evergym.simulator import Simulator
from evergym.units import MM

__all__ = ["MAP_SIZE", "MapView"]

Array = NDArray[np.float64]

MAP_SIZE = (480, 360)
"""Width and height of the picture in pixels."""

_FORCE_LENGTH = 20 * MM  # drawn per newton [m/N]
_TOUCH_LENGTH = 1 * MM  # added to it, so that a light touch is seen as well
_FINE = 3  # the place is drawn that much larger and shrunk, for smooth edges
_COLOUR = {
    "background": "#ffffff",
    "lumen": "#f3d9d4",
    "way": "#d8a49b",
    "peg": "#9aa3b0",
    "sheath": "#4dabf7",
    "catheter": "#2b3038",
    "tendon": "#fab005",
    "target": "#2f9e44",
    "contact": "#e8590c",
}
_BORDER = 0.08


class MapView:
    """The place as seen along its narrowest side, the insertion to the right; pegs are seen from above.

    Args:
        scene: The duct or the pegs; None: free space.
        target: Marked by a green disc [m]; None: no marker.
        size: Width and height in pixels.
    """

    def __init__(
        self,
        scene: Duct | PegField | None,
        target: tuple[float, float, float] | None = None,
        size: tuple[int, int] = MAP_SIZE,
    ) -> None:
        self.size = size
        self._scene: object = self
        self._target: tuple[float, float, float] | None = None
        self._font = find_font(size)
        self.place(scene, target)

    def place(self, scene: Duct | PegField | None, target: tuple[float, float, float] | None) -> None:
        """Show another place, or another target [m] in it; costs nothing if both are those shown already."""
        if scene is self._scene and target == self._target:
            return
        self._scene, self._target = scene, target
        self._axes = choose_side(scene)
        corners = list_corners(scene, margin=5 * MM)
        self._scale, middle = fit_scale(corners, self._axes, self.size, round(_BORDER * min(self.size)))
        self._shift = 0.5 * np.array(self.size) - self._scale * middle
        width, height = self.size
        large = Image.new("RGB", (_FINE * width, _FINE * height), _COLOUR["background"])
        self._draw_place(ImageDraw.Draw(large), scene, target)
        small = large.resize(self.size, Image.Resampling.BOX)
        self._background = Image.fromarray(draw_scale_bar(np.array(small), self._scale))

    def frame(self, robot: Simulator | Pose, caption: str = "") -> NDArray[np.uint8]:
        """Return a fresh picture, shape (height, width, 3), with the caption in its upper left corner."""
        pose = read_pose(robot)
        image = self._background.copy()
        pen = ImageDraw.Draw(image)
        points = self._project(pose.shape.position)
        sheath = points[pose.shape.in_sheath]
        self._line(pen, sheath, 2.0 * pose.sheath_radius, "sheath")
        self._line(pen, points, 2.0 * pose.catheter_radius, "catheter")
        x, y = points[-1].tolist()
        end = self._scale * pose.catheter_radius
        pen.ellipse((x - end, y - end, x + end, y + end), fill=_COLOUR["catheter"])
        side = self._project(pose.shape.position + pose.catheter_radius * pose.shape.catheter_direction)
        self._line(pen, side, 0.0, "tendon")
        force = pose.contacts.force
        size = np.linalg.norm(force, axis=1, keepdims=True)
        # A force is drawn as it acts on the wall: outwards from where the robot's surface touches it.
        outwards = -force / np.maximum(size, 1e-12)
        foot = pose.contacts.position + pose.sheath_radius * outwards
        ends = self._project(foot + (_TOUCH_LENGTH + _FORCE_LENGTH * size) * outwards)
        for start, end in zip(self._project(foot).tolist(), ends.tolist(), strict=True):
            pen.line([*start, *end], fill=_COLOUR["contact"], width=2)
        if caption:
            pen.text((6, 4), caption, fill=INK, font=self._font)
        return np.array(image)

    def close(self) -> None:
        """Nothing is held."""

    def _project(self, points: Array) -> Array:
        """Return where points [m], shape (n, 3), are in the picture, shape (n, 2)."""
        flat: Array = self._scale * (points @ self._axes.T) + self._shift
        return flat

    def _line(self, pen: ImageDraw.ImageDraw, points: Array, width: float, colour: str) -> None:
        if len(points) > 1:
            thick = max(1, round(self._scale * width))
            pen.line(points.ravel().tolist(), fill=_COLOUR[colour], width=thick, joint="curve")

    def _draw_place(
        self, pen: ImageDraw.ImageDraw, scene: Duct | PegField | None, target: tuple[float, float, float] | None
    ) -> None:
        if isinstance(scene, Duct):
            line = scene.centreline
            parent = np.maximum(line.parent, 0)
            for share in np.linspace(0.0, 1.0, 5):
                centre = share * line.position + (1.0 - share) * line.position[parent]
                radius = share * line.radius + (1.0 - share) * line.radius[parent]
                self._discs(pen, centre, radius, "lumen")
            ends = _FINE * np.hstack([self._project(line.position), self._project(line.position[parent])])
            for row in ends.tolist():
                pen.line(row, fill=_COLOUR["way"], width=_FINE)
        elif isinstance(scene, PegField):
            pen.line((_FINE * self._project(scene.way)).ravel().tolist(), fill=_COLOUR["way"], width=_FINE)
            self._discs(pen, scene.pegs[:, :3] * (1.0, 0.0, 1.0), scene.pegs[:, 6], "peg")
        if target is not None:
            self._discs(pen, np.array([target]), np.array([1.5 * MM]), "target")

    def _discs(self, pen: ImageDraw.ImageDraw, centre: Array, radius: Array, colour: str) -> None:
        for (x, y), r in zip(
            (_FINE * self._project(centre)).tolist(), (_FINE * self._scale * radius).tolist(), strict=True
        ):
            pen.ellipse((x - r, y - r, x + r, y + r), fill=_COLOUR[colour])
