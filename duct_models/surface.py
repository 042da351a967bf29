"""Exact distances to a triangle mesh: nearest point on a triangle, its sign, and the descent over neighbours.

The sign comes from angle-weighted pseudo-normals, which is right at faces, edges and corners of any closed,
consistently wound mesh (Baerentzen & Aanaes 2005, doi 10.1109/TVCG.2005.49).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray

from evergym.jit import njit

__all__ = [
    "Surface",
    "build_surface",
    "compute_descended_triangle",
    "compute_signed_distance",
    "compute_square_distance",
]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Surface(NamedTuple):
    """A closed triangle mesh as kernels read it.

    Attributes:
        vertex: Corners [m], shape (n, 3).
        face: Corner indices, shape (m, 3).
        face_normal: Outward unit normals, shape (m, 3).
        edge_normal: Sum of the two face normals at the edge from corner k to corner k + 1, shape (m, 3, 3).
        vertex_normal: Angle-weighted sum of face normals, shape (n, 3).
        ring_start: Where each vertex's faces begin in ``ring``, shape (n + 1,).
        ring: Faces around each vertex, shape (3 m,).
    """

    vertex: FloatArray
    face: IntArray
    face_normal: FloatArray
    edge_normal: FloatArray
    vertex_normal: FloatArray
    ring_start: IntArray
    ring: IntArray


def build_surface(mesh: trimesh.Trimesh) -> Surface:
    """Arrays of a closed mesh for the distance kernels.

    Args:
        mesh: Watertight mesh with outward winding [m].
    """
    vertex = np.array(mesh.vertices, dtype=np.float64, order="C")
    face = np.array(mesh.faces, dtype=np.int64, order="C")
    corner = vertex[face]
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    face_normal = np.divide(cross, length, out=np.zeros_like(cross), where=length > 0.0)

    # The two faces at an edge share its sorted pair of corners.
    edge = np.stack([face, np.roll(face, -1, axis=1)], axis=2).reshape(-1, 2)
    edge.sort(axis=1)
    key = edge[:, 0] * len(vertex) + edge[:, 1]
    _, group = np.unique(key, return_inverse=True)
    owner = np.repeat(np.arange(len(face)), 3)
    total = np.zeros((int(group.max()) + 1, 3))
    np.add.at(total, group, face_normal[owner])
    edge_normal = total[group].reshape(len(face), 3, 3)

    before = np.roll(corner, 1, axis=1) - corner
    after = np.roll(corner, -1, axis=1) - corner
    angle = np.arctan2(np.linalg.norm(np.cross(before, after), axis=2), np.sum(before * after, axis=2))
    vertex_normal = np.zeros_like(vertex)
    for index in range(3):
        np.add.at(vertex_normal, face[:, index], angle[:, index, None] * face_normal)

    order = np.argsort(face.ravel(), kind="stable")
    count = np.bincount(face.ravel(), minlength=len(vertex))
    ring_start = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    return Surface(vertex, face, face_normal, edge_normal, vertex_normal, ring_start, owner[order].astype(np.int64))


@njit
def compute_nearest_on_triangle(surface: Surface, triangle: int, point: FloatArray, nearest: FloatArray) -> int:
    """Nearest point of a triangle, by the region tests of Ericson 2005, Real-Time Collision Detection, 5.1.5.

    Args:
        surface: The mesh.
        triangle: Which face.
        point: Position [m], shape (3,).
        nearest: Overwritten with the nearest point [m], shape (3,).

    Returns:
        The feature it lies on: 0 to 2 a corner, 3 to 5 the edge from corner k to k + 1, 6 the face.
    """
    ia, ib, ic = surface.face[triangle, 0], surface.face[triangle, 1], surface.face[triangle, 2]
    a, b, c = surface.vertex[ia], surface.vertex[ib], surface.vertex[ic]
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for axis in range(3):
        ab = b[axis] - a[axis]
        ac = c[axis] - a[axis]
        d1 += ab * (point[axis] - a[axis])
        d2 += ac * (point[axis] - a[axis])
        d3 += ab * (point[axis] - b[axis])
        d4 += ac * (point[axis] - b[axis])
        d5 += ab * (point[axis] - c[axis])
        d6 += ac * (point[axis] - c[axis])
    feature = 6
    v = w = 0.0
    vc = d1 * d4 - d3 * d2
    vb = d5 * d2 - d1 * d6
    va = d3 * d6 - d5 * d4
    if d1 <= 0.0 and d2 <= 0.0:
        feature = 0
    elif d3 >= 0.0 and d4 <= d3:
        feature, v = 1, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        feature, v = 3, d1 / (d1 - d3)
    elif d6 >= 0.0 and d5 <= d6:
        feature, w = 2, 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        feature, w = 5, d2 / (d2 - d6)
    elif va <= 0.0 and (d4 - d3) >= 0.0 and (d5 - d6) >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        feature, v = 4, 1.0 - w
    else:
        total = va + vb + vc
        v, w = vb / total, vc / total
    for axis in range(3):
        nearest[axis] = a[axis] + v * (b[axis] - a[axis]) + w * (c[axis] - a[axis])
    return feature


@njit
def compute_square_distance(surface: Surface, triangle: int, point: FloatArray, nearest: FloatArray) -> float:
    """Squared distance [m^2] of a point to one triangle; ``nearest`` is workspace, shape (3,)."""
    compute_nearest_on_triangle(surface, triangle, point, nearest)
    x, y, z = point[0] - nearest[0], point[1] - nearest[1], point[2] - nearest[2]
    return x * x + y * y + z * z


@njit
def compute_descended_triangle(surface: Surface, start: int, point: FloatArray, nearest: FloatArray) -> int:
    """Walk from a triangle to the neighbour nearest to the point, until no neighbour is nearer.

    Args:
        surface: The mesh.
        start: Where to begin: a triangle that is nearest or nearly so.
        point: Position [m], shape (3,).
        nearest: Workspace, shape (3,).

    Returns:
        The triangle at which the walk ends.
    """
    best = start
    best_square = compute_square_distance(surface, best, point, nearest)
    centre = -1
    while centre != best:
        centre = best
        for corner in range(3):
            vertex = surface.face[centre, corner]
            for slot in range(surface.ring_start[vertex], surface.ring_start[vertex + 1]):
                triangle = surface.ring[slot]
                if triangle != centre:
                    square = compute_square_distance(surface, triangle, point, nearest)
                    if square < best_square:
                        best, best_square = triangle, square
    return best


@njit
def compute_signed_distance(
    surface: Surface, triangle: int, point: FloatArray, nearest: FloatArray, normal: FloatArray
) -> float:
    """Signed distance [m] to a triangle that is the nearest one, positive inside the mesh.

    Args:
        surface: The mesh.
        triangle: The nearest face.
        point: Position [m], shape (3,).
        nearest: Overwritten with the nearest point [m], shape (3,).
        normal: Overwritten with the direction in which the distance grows (unit), shape (3,): into the lumen.
    """
    feature = compute_nearest_on_triangle(surface, triangle, point, nearest)
    side = 0.0
    for axis in range(3):
        if feature == 6:
            outward = surface.face_normal[triangle, axis]
        elif feature >= 3:
            outward = surface.edge_normal[triangle, feature - 3, axis]
        else:
            outward = surface.vertex_normal[surface.face[triangle, feature], axis]
        normal[axis] = -outward
        side -= outward * (point[axis] - nearest[axis])
    x, y, z = point[0] - nearest[0], point[1] - nearest[1], point[2] - nearest[2]
    distance = math.sqrt(x * x + y * y + z * z)
    sign = 1.0 if side >= 0.0 else -1.0
    if distance > 1e-9:  # nearer than a nanometre the pseudo-normal itself is the direction
        for axis in range(3):
            normal[axis] = sign * (point[axis] - nearest[axis]) / distance
    else:
        size = math.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2])
        if size > 0.0:
            for axis in range(3):
                normal[axis] /= size
    return sign * distance
