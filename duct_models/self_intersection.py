"""Find the triangles of a mesh that cut through others."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import NDArray

from evergym.jit import njit

__all__ = ["find_self_intersections"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST_CELLS = 128
"""Most grid cells along an axis."""
TOUCH = 1e-9
"""A crossing counts if it exceeds this share of the typical triangle: below it two triangles only touch."""


def find_self_intersections(mesh: trimesh.Trimesh) -> Indices:
    """Find the triangles that properly cut others of the same mesh.

    Triangles that touch, share an edge or overlap within one plane are not found; a fold that turns a wall onto itself
    cuts the neighbours of its edge and is.

    Args:
        mesh: Any mesh.

    Returns:
        Face indices, ascending, shape (k,).

    Source: this project; two triangles cut each other where an edge of one passes through the other (signs of four
    volumes each).
    """
    corner = np.ascontiguousarray(mesh.vertices[mesh.faces], dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int64)
    low, high = corner.min(axis=1), corner.max(axis=1)
    origin = low.min(axis=0)
    size = float(np.median((high - low).max(axis=1)))
    box = high.max(axis=0) - origin
    cell = max(2.0 * size, float(box.max()) / MOST_CELLS)
    count = np.floor(box / cell).astype(np.int64) + 1
    first = np.floor((low - origin) / cell).astype(np.int64)
    last = np.floor((high - origin) / cell).astype(np.int64)
    start, member = _sort_into_cells(first, last, count)
    found = np.zeros(len(faces), dtype=np.bool_)
    _mark_cutting(corner, faces, low, high, start, member, TOUCH * size**3, found)
    return np.flatnonzero(found)


@njit
def _sort_into_cells(first: Indices, last: Indices, count: Indices) -> tuple[Indices, Indices]:
    """List the triangles of each grid cell: members of cell c are member[start[c]] to member[start[c + 1]]."""
    start = np.zeros(count[0] * count[1] * count[2] + 1, dtype=np.int64)
    for t in range(first.shape[0]):
        for i in range(first[t, 0], last[t, 0] + 1):
            for j in range(first[t, 1], last[t, 1] + 1):
                for k in range(first[t, 2], last[t, 2] + 1):
                    start[(i * count[1] + j) * count[2] + k + 1] += 1
    for c in range(1, start.shape[0]):
        start[c] += start[c - 1]
    filled = start[:-1].copy()
    member = np.empty(start[-1], dtype=np.int64)
    for t in range(first.shape[0]):
        for i in range(first[t, 0], last[t, 0] + 1):
            for j in range(first[t, 1], last[t, 1] + 1):
                for k in range(first[t, 2], last[t, 2] + 1):
                    c = (i * count[1] + j) * count[2] + k
                    member[filled[c]] = t
                    filled[c] += 1
    return start, member


@njit
def _mark_cutting(
    corner: Array,
    faces: Indices,
    low: Array,
    high: Array,
    start: Indices,
    member: Indices,
    touch: float,
    found: NDArray[np.bool_],
) -> None:
    """Set found for both triangles of every pair in a cell that cut each other."""
    for c in range(start.shape[0] - 1):
        for p in range(start[c], start[c + 1]):
            s = member[p]
            for q in range(p + 1, start[c + 1]):
                t = member[q]
                if found[s] and found[t]:
                    continue
                apart = False
                for axis in range(3):
                    if low[s, axis] > high[t, axis] or low[t, axis] > high[s, axis]:
                        apart = True
                if apart:
                    continue
                shared = 0
                for a in range(3):
                    for b in range(3):
                        if faces[s, a] == faces[t, b]:
                            shared += 1
                if shared >= 2:
                    continue
                if _has_edge_through(corner[s], corner[t], touch) or _has_edge_through(corner[t], corner[s], touch):
                    found[s] = True
                    found[t] = True


@njit
def _has_edge_through(a: Array, b: Array, touch: float) -> bool:
    """Tell whether an edge of triangle a passes through the inside of triangle b."""
    for k in range(3):
        p = a[k]
        q = a[(k + 1) % 3]
        before = _compute_volume(b[0], b[1], b[2], p)
        after = _compute_volume(b[0], b[1], b[2], q)
        if not ((before > touch and after < -touch) or (before < -touch and after > touch)):
            continue
        u = _compute_volume(p, q, b[0], b[1])
        v = _compute_volume(p, q, b[1], b[2])
        w = _compute_volume(p, q, b[2], b[0])
        if (u > touch and v > touch and w > touch) or (u < -touch and v < -touch and w < -touch):
            return True
    return False


@njit
def _compute_volume(a: Array, b: Array, c: Array, d: Array) -> float:
    """Compute six times the signed volume of a tetrahedron."""
    bx, by, bz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    cx, cy, cz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    dx, dy, dz = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    return float(dx * (by * cz - bz * cy) + dy * (bz * cx - bx * cz) + dz * (bx * cy - by * cx))
