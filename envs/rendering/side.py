"""From which side a place is looked at: the insertion to the right, the branches as far apart as they go."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evergym.duct_models.duct import Duct
from evergym.duct_models.pegs import PegField
from evergym.units import MM

__all__ = ["PEG_REACH", "choose_side", "fit_scale", "list_corners"]

Array = NDArray[np.float64]

PEG_REACH = 6 * MM
"""How far pegs are drawn above and below the port [m]; they have no ends."""
_FREE = np.array([[-45.0, -45.0, -5.0], [45.0, 45.0, 110.0]]) * MM  # what the robot can reach


def choose_side(scene: Duct | PegField | None) -> Array:
    """Return the world directions that point right and down in a picture, shape (2, 3), unit."""
    if isinstance(scene, Duct):
        values, vectors = np.linalg.eigh(np.cov(scene.centreline.position[:, :2].T))
        wide = vectors[:, int(np.argmax(values))]
        down = wide if wide[1] <= 0.0 else -wide
        return np.array([(0.0, 0.0, 1.0), (down[0], down[1], 0.0)])
    # Pegs stand along y, so from above; in free space gravity shows the way down.
    return np.array([(0.0, 0.0, 1.0), (-1.0, 0.0, 0.0) if isinstance(scene, PegField) else (0.0, -1.0, 0.0)])


def list_corners(scene: Duct | PegField | None, margin: float = 0.0) -> Array:
    """Return points [m], shape (n, 3), that a picture of the whole place has to hold.

    Args:
        scene: The place.
        margin: Room around the way among pegs, which a robot needs [m].
    """
    if isinstance(scene, Duct):
        return np.asarray(scene.mesh.vertices, dtype=np.float64)
    if isinstance(scene, PegField):
        room = np.array((margin, PEG_REACH, margin))
        feet = scene.pegs[:, :3] * (1.0, 0.0, 1.0)
        reach = np.stack([scene.pegs[:, 6], np.full(len(feet), PEG_REACH), scene.pegs[:, 6]], axis=1)
        return np.concatenate([scene.way - room, scene.way + room, feet - reach, feet + reach])
    x, y, z = _FREE.T
    return np.stack(np.meshgrid(x, y, z), axis=-1).reshape(-1, 3)


def fit_scale(corners: Array, axes: Array, size: tuple[int, int], border: int) -> tuple[float, Array]:
    """Return pixels per metre, and the middle of the corners along the axes [m], shape (2,).

    Args:
        corners: What has to fit [m], shape (n, 3).
        axes: Right and down, shape (2, 3).
        size: Width and height in pixels.
        border: Pixels to leave free on every side.
    """
    flat = corners @ axes.T
    lower, upper = flat.min(axis=0), flat.max(axis=0)
    room = np.maximum(np.array(size) - 2 * border, 8)
    return float(np.min(room / (upper - lower))), 0.5 * (lower + upper)
