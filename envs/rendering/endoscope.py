"""The view from the tip: what a tiny camera with a lamp beside its lens sees of the lumen ahead."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evergym.duct_models.duct import Duct
from evergym.duct_models.field import WallField
from evergym.duct_models.pegs import PegField
from evergym.envs.rendering.pose import Pose, read_pose
from evergym.envs.rendering.ray_kernel import draw_endoscope, trace_rays
from evergym.simulator import Simulator
from evergym.units import DEG, MM

__all__ = ["ENDOSCOPE_SIZE", "FIELD_OF_VIEW", "TARGET_RADIUS", "EndoscopeView"]

Array = NDArray[np.float64]

ENDOSCOPE_SIZE = (64, 64)
"""Width and height of the picture in pixels, as in the environments' image observation."""
FIELD_OF_VIEW = 100.0 * DEG
"""Angle across the picture's shorter side; prior: 90 to 120 degrees are usual for endoscopes of this size."""
TARGET_RADIUS = 1.5 * MM
"""Radius of the target's marker [m]."""

_REACH = 200.0 * MM
_LAMP_DUCT = 3.6 * MM  # about a lumen's radius: the wall beside the tip is bright, the lumen ahead dark
_LAMP_PEGS = 12.0 * MM  # the pegs stand that far apart
_PALETTE = np.array(  # linear RGB of nothing, wall, peg, target
    [[0.002, 0.003, 0.006], [0.78, 0.27, 0.20], [0.42, 0.47, 0.56], [0.02, 0.75, 0.10]]
)


class EndoscopeView:
    """The camera sits at the tip and looks where the tip grows; the tendon's side is up in the picture.

    Args:
        scene: The duct or the pegs; None: free space.
        target: Marked by a green ball [m]; None: no marker.
        size: Width and height in pixels.
        samples: Rays per pixel along each side; 3 smooths the edges of a figure.
    """

    def __init__(
        self,
        scene: Duct | PegField | None,
        target: tuple[float, float, float] | None = None,
        size: tuple[int, int] = ENDOSCOPE_SIZE,
        samples: int = 1,
    ) -> None:
        self.size = size
        self._samples = samples
        self._half_width = math.tan(0.5 * FIELD_OF_VIEW)
        self.place(scene, target)

    def place(self, scene: Duct | PegField | None, target: tuple[float, float, float] | None) -> None:
        """Show another place, or another target [m] in it."""
        self._has_wall = isinstance(scene, Duct)
        self._field = (
            scene.field if isinstance(scene, Duct) else WallField(np.zeros((3, 3, 3)), np.zeros(3), np.ones(1))
        )
        pegs = scene.pegs if isinstance(scene, PegField) else np.zeros((0, 7))
        self._pegs = np.array(pegs, dtype=np.float64, order="C")
        self._lamp = _LAMP_DUCT if self._has_wall else _LAMP_PEGS
        self._ball = np.zeros(4)
        if target is not None:
            self._ball[:] = (*target, TARGET_RADIUS)

    def frame(self, robot: Simulator | Pose, caption: str = "") -> NDArray[np.uint8]:
        """Return a fresh picture, shape (height, width, 3); a caption is not written: the picture is all data."""
        del caption
        image = np.empty((self.size[1], self.size[0], 3), dtype=np.uint8)
        draw_endoscope(
            self._field,
            self._has_wall,
            self._pegs,
            self._ball,
            compute_camera(robot),
            self._half_width,
            _REACH,
            self._lamp,
            _PALETTE,
            self._samples,
            image,
        )
        return image

    def trace(self, origin: ArrayLike, directions: ArrayLike) -> tuple[Array, NDArray[np.int64]]:
        """Return how far the first thing along each ray is, and what it is.

        Args:
            origin: Where the rays begin [m], shape (3,).
            directions: Unit vectors, shape (n, 3).

        Returns:
            Depths [m], shape (n,), 0.2 m where there is nothing, and the kinds of ``ray_kernel``, shape (n,).
        """
        rays = np.ascontiguousarray(directions, dtype=np.float64).reshape(-1, 3)
        depth, kind = np.empty(len(rays)), np.empty(len(rays), dtype=np.int64)
        begin = np.array(origin, dtype=np.float64)
        trace_rays(self._field, self._has_wall, self._pegs, self._ball, begin, rays, _REACH, depth, kind)
        return depth, kind

    def close(self) -> None:
        """Nothing is held."""


def compute_camera(robot: Simulator | Pose) -> Array:
    """Return position [m], right, up and forward of the camera at the tip, shape (4, 3)."""
    shape = read_pose(robot).shape
    camera = np.empty((4, 3))
    camera[0] = shape.position[-1]
    forward = shape.tangent[-1] / np.linalg.norm(shape.tangent[-1])
    up = shape.catheter_direction[-1] - (shape.catheter_direction[-1] @ forward) * forward
    up /= np.linalg.norm(up)
    camera[1], camera[2], camera[3] = np.cross(forward, up), up, forward
    return camera
