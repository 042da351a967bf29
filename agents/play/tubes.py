"""Triangles for the robot: tubes along its shape that keep their topology from frame to frame, so only points move."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evergym.simulator import Shape

__all__ = ["Axis", "sample_axis", "sweep_rolled_tip", "sweep_round_tip", "tube_faces"]

Array = NDArray[np.float64]

SIDES = 20
"""Points around a tube."""
RINGS = 56
"""Rings along a tube, its tip included."""
_TIP_RINGS = 8
_ANGLE = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)


class Axis(NamedTuple):
    """The robot's axis at chosen stations."""

    position: Array
    """(n, 3) [m]."""
    tangent: Array
    """(n, 3), unit."""
    side: Array
    """(n, 3) the tendon's side, unit and across the tangent."""


def sample_axis(shape: Shape, station: Array) -> Axis:
    """Return the axis at stations [m], shape (n,), by cubic Hermite interpolation; straight on beyond the ends."""
    last = len(shape.station) - 1
    if last < 1:
        ahead = station[:, None] - shape.station[0]
        count = len(station)
        tangent = np.repeat(shape.tangent[:1], count, axis=0)
        return Axis(
            shape.position[0] + ahead * tangent, tangent, np.repeat(shape.catheter_direction[:1], count, axis=0)
        )
    index = np.clip(np.searchsorted(shape.station, station, side="right") - 1, 0, last - 1)
    length = np.maximum(shape.station[index + 1] - shape.station[index], 1e-9)
    whole = (station - shape.station[index]) / length
    t = np.clip(whole, 0.0, 1.0)[:, None]
    start, end = shape.position[index], shape.position[index + 1]
    reach = length[:, None]
    leave, arrive = shape.tangent[index] * reach, shape.tangent[index + 1] * reach
    position = (
        (1.0 + 2.0 * t) * (1.0 - t) ** 2 * start
        + t * (1.0 - t) ** 2 * leave
        + t**2 * (3.0 - 2.0 * t) * end
        + t**2 * (t - 1.0) * arrive
    )
    tangent = (1.0 - t) * shape.tangent[index] + t * shape.tangent[index + 1]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    position += (whole[:, None] - t) * reach * tangent
    side = (1.0 - t) * shape.catheter_direction[index] + t * shape.catheter_direction[index + 1]
    side -= np.sum(side * tangent, axis=1, keepdims=True) * tangent
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
    return Axis(position, tangent, side)


def sweep_rolled_tip(shape: Shape, length: float, radius: float, bore: float) -> Array:
    """Return the vertices of the sheath: a tube whose wall rolls inwards at its tip, where the tail becomes wall.

    Args:
        shape: The robot's shape.
        length: Everted length [m].
        radius: Outer radius [m].
        bore: Radius that the tail comes out of [m].
    """
    fold = min(0.5 * (radius - bore), 0.45 * max(length, 1e-6))
    angle = np.linspace(0.0, np.pi, _TIP_RINGS)
    body = np.linspace(0.0, max(length - fold, 0.0), RINGS - _TIP_RINGS, endpoint=False)
    station = np.concatenate([body, length - fold + fold * np.sin(angle)])
    width = np.concatenate([np.full(len(body), radius), radius - fold + fold * np.cos(angle)])
    return _sweep(sample_axis(shape, station), width)


def sweep_round_tip(shape: Shape, length: float, radius: float, offset: float = 0.0, thickness: float = 1.0) -> Array:
    """Return the vertices of a rod with a round tip: the catheter, or the tendon beside its axis.

    Args:
        shape: The robot's shape.
        length: [m].
        radius: [m].
        offset: How far the rod lies towards the tendon's side [m].
        thickness: Part of the radius that is drawn.
    """
    width = radius * thickness
    angle = np.linspace(0.0, 0.5 * np.pi, _TIP_RINGS)
    body = np.linspace(0.0, max(length - width, 0.0), RINGS - _TIP_RINGS, endpoint=False)
    station = np.concatenate([body, max(length - width, 0.0) + width * np.sin(angle)])
    axis = sample_axis(shape, station)
    axis = axis._replace(position=axis.position + offset * axis.side)
    return _sweep(axis, np.concatenate([np.full(len(body), width), width * np.cos(angle)]))


def tube_faces() -> NDArray[np.int64]:
    """Return the triangles of every tube, shape (k, 3), seen from outside."""
    around = np.arange(SIDES)
    beside = (around + 1) % SIDES
    ring = (np.arange(RINGS - 1) * SIDES)[:, None]
    here, next_, above, above_next = ring + around, ring + beside, ring + SIDES + around, ring + SIDES + beside
    one = np.stack([here, next_, above_next], axis=-1).reshape(-1, 3)
    other = np.stack([here, above_next, above], axis=-1).reshape(-1, 3)
    return np.concatenate([one, other])


def _sweep(axis: Axis, width: Array) -> Array:
    across = np.cross(axis.tangent, axis.side)
    ring = np.cos(_ANGLE)[None, :, None] * axis.side[:, None, :] + np.sin(_ANGLE)[None, :, None] * across[:, None, :]
    vertices: Array = (axis.position[:, None, :] + width[:, None, None] * ring).reshape(-1, 3)
    return vertices
