"""The solids of a picture as vertices, normals and triangles: tubes along a curve, arrows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evergym.units import MM

__all__ = ["Solid", "make_arrows", "sweep_tube"]

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SIDES = 24
_CAP_RINGS = 4
_ANGLE = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
_ARROW_SIDES = 10
_HEAD_LENGTH, _HEAD_RADIUS, _SHAFT_RADIUS = 1.0 * MM, 0.42 * MM, 0.15 * MM


class Solid(NamedTuple):
    """A surface."""

    vertex: Array
    """(n, 3) [m]."""
    normal: Array
    """(n, 3), unit, outwards."""
    face: IntArray
    """(m, 3) indices of vertices."""


def sweep_tube(points: Array, radius: float, *, capped: bool = False) -> Solid:
    """Return a tube along a curve, open at its ends or with a round cap at the last.

    Args:
        points: The curve [m], shape (n, 3).
        radius: Of the tube [m].
        capped: Whether a half ball closes the last end.
    """
    count = len(points)
    if count < 2:
        return Solid(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))
    tangent = np.gradient(points, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    # The frame of least twist: each normal is the last one made perpendicular to the next tangent.
    across = np.empty_like(points)
    last = np.array((1.0, 0.0, 0.0)) if abs(tangent[0, 0]) < 0.9 else np.array((0.0, 1.0, 0.0))
    for index in range(count):
        last = last - (last @ tangent[index]) * tangent[index]
        last = last / np.linalg.norm(last)
        across[index] = last
    beside = np.cross(tangent, across)
    normal = np.cos(_ANGLE)[None, :, None] * across[:, None, :] + np.sin(_ANGLE)[None, :, None] * beside[:, None, :]
    vertex = points[:, None, :] + radius * normal
    if capped:
        # Rings of a half ball; the last has no width and closes it.
        latitude = np.linspace(0.0, 0.5 * np.pi, _CAP_RINGS + 1)[1:, None, None]
        cap = np.cos(latitude) * normal[-1] + np.sin(latitude) * tangent[-1]
        normal, vertex = np.concatenate([normal, cap]), np.concatenate([vertex, points[-1] + radius * cap])
    return Solid(vertex.reshape(-1, 3), normal.reshape(-1, 3), _join_rings(len(vertex), _SIDES))


def make_arrows(start: Array, direction: Array, length: Array) -> Solid:
    """Return arrows from ``start`` [m], shape (k, 3), along unit directions, shape (k, 3), of a length [m], shape (k,).

    A short arrow is all head, and a smaller one.
    """
    if len(start) == 0:
        return Solid(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))
    angle = np.linspace(0.0, 2.0 * np.pi, _ARROW_SIDES, endpoint=False)
    vertices: list[Array] = []
    normals: list[Array] = []
    faces: list[IntArray] = []
    count = 0
    ring_faces = _join_rings(2, _ARROW_SIDES)
    for foot, ahead, size in zip(start, direction, length, strict=True):
        other = np.array((1.0, 0.0, 0.0)) if abs(ahead[0]) < 0.9 else np.array((0.0, 1.0, 0.0))
        across = np.cross(ahead, other)
        across /= np.linalg.norm(across)
        around = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * np.cross(ahead, across)
        head = min(_HEAD_LENGTH, 0.7 * size)
        thin, thick = (radius * head / _HEAD_LENGTH for radius in (_SHAFT_RADIUS, _HEAD_RADIUS))
        neck, tip = foot + (size - head) * ahead, foot + size * ahead
        slope = around + thick / head * ahead
        slope /= np.linalg.norm(slope, axis=1, keepdims=True)
        back = np.broadcast_to(-ahead, around.shape)
        for first, second, outwards in (
            (foot + thin * around, neck + thin * around, around),
            (neck + 0.0 * around, neck + thick * around, back),
            (neck + thick * around, tip + 0.0 * around, slope),
        ):
            faces.append(ring_faces + count)
            count += 2 * _ARROW_SIDES
            vertices.append(np.concatenate([first, second]))
            normals.append(np.concatenate([outwards, outwards]))
    return Solid(np.concatenate(vertices), np.concatenate(normals), np.concatenate(faces))


def _join_rings(count: int, sides: int) -> IntArray:
    """Return the triangles between each of ``count`` rings of vertices and the next, wound outwards."""
    around = np.arange(sides)
    beside = (around + 1) % sides
    start = (np.arange(count - 1) * sides)[:, None]
    first = np.stack([start + around, start + beside, start + beside + sides], axis=-1)
    second = np.stack([start + around, start + beside + sides, start + around + sides], axis=-1)
    return np.concatenate([first, second], axis=1).reshape(-1, 3)
