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
def _compute_nearest_on_triangle(
    vertex: FloatArray, face: IntArray, triangle: int, x: float, y: float, z: float
) -> tuple[float, float, float, float, int]:
    """Nearest point of a triangle to (x, y, z), by the regions of Ericson 2005, Real-Time Collision Detection, 5.1.5.

    Scalars throughout: this is called some ten million times per field.

    Returns:
        The squared distance [m^2], the nearest point's coordinates [m], and the feature it lies on: 0 to 2 a corner,
        3 to 5 the edge from corner k to k + 1, 6 the face.
    """
    ia, ib, ic = face[triangle, 0], face[triangle, 1], face[triangle, 2]
    ax, ay, az = vertex[ia, 0], vertex[ia, 1], vertex[ia, 2]
    ux, uy, uz = vertex[ib, 0] - ax, vertex[ib, 1] - ay, vertex[ib, 2] - az
    wx, wy, wz = vertex[ic, 0] - ax, vertex[ic, 1] - ay, vertex[ic, 2] - az
    px, py, pz = x - ax, y - ay, z - az
    d1 = ux * px + uy * py + uz * pz
    d2 = wx * px + wy * py + wz * pz
    uu = ux * ux + uy * uy + uz * uz
    uw = ux * wx + uy * wy + uz * wz
    ww = wx * wx + wy * wy + wz * wz
    d3, d4 = d1 - uu, d2 - uw  # the same products seen from corner b, and then from corner c
    d5, d6 = d1 - uw, d2 - ww
    v = w = 0.0
    feature = 6
    if d1 <= 0.0 and d2 <= 0.0:
        feature = 0
    elif d3 >= 0.0 and d4 <= d3:
        feature, v = 1, 1.0
    elif d6 >= 0.0 and d5 <= d6:
        feature, w = 2, 1.0
    else:
        vc = d1 * d4 - d3 * d2
        vb = d5 * d2 - d1 * d6
        va = d3 * d6 - d5 * d4
        if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
            feature, v = 3, d1 / (d1 - d3)
        elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
            feature, w = 5, d2 / (d2 - d6)
        elif va <= 0.0 and d4 >= d3 and d5 >= d6:
            w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
            feature, v = 4, 1.0 - w
        else:
            total = va + vb + vc
            v, w = vb / total, vc / total
    gx, gy, gz = v * ux + w * wx, v * uy + w * wy, v * uz + w * wz
    square = (px - gx) ** 2 + (py - gy) ** 2 + (pz - gz) ** 2
    return square, ax + gx, ay + gy, az + gz, feature


@njit
def compute_square_distance(surface: Surface, triangle: int, x: float, y: float, z: float) -> float:
    """Squared distance [m^2] of the point (x, y, z) to one triangle."""
    return _compute_nearest_on_triangle(surface.vertex, surface.face, triangle, x, y, z)[0]


@njit
def compute_descended_triangle(surface: Surface, start: int, x: float, y: float, z: float) -> int:
    """Walk from a triangle to the neighbour nearest to a point, until no neighbour is nearer.

    Args:
        surface: The mesh.
        start: Where to begin: a triangle that is nearest or nearly so.
        x: Of the point [m].
        y: Of the point [m].
        z: Of the point [m].

    Returns:
        The triangle at which the walk ends.
    """
    best = start
    best_square = compute_square_distance(surface, best, x, y, z)
    centre = -1
    while centre != best:
        centre = best
        for corner in range(3):
            vertex = surface.face[centre, corner]
            for slot in range(surface.ring_start[vertex], surface.ring_start[vertex + 1]):
                triangle = surface.ring[slot]
                if triangle != centre:
                    square = compute_square_distance(surface, triangle, x, y, z)
                    if square < best_square:
                        best, best_square = triangle, square
    return best


@njit
def compute_signed_distance(surface: Surface, triangle: int, x: float, y: float, z: float, normal: FloatArray) -> float:
    """Signed distance [m] to a triangle that is the nearest one, positive inside the mesh.

    Args:
        surface: The mesh.
        triangle: The nearest face.
        x: Of the point [m].
        y: Of the point [m].
        z: Of the point [m].
        normal: Overwritten with the direction in which the distance grows (unit), shape (3,): into the lumen.
    """
    square, near_x, near_y, near_z, feature = _compute_nearest_on_triangle(
        surface.vertex, surface.face, triangle, x, y, z
    )
    gap_x, gap_y, gap_z = x - near_x, y - near_y, z - near_z
    for axis in range(3):
        if feature == 6:
            normal[axis] = -surface.face_normal[triangle, axis]
        elif feature >= 3:
            normal[axis] = -surface.edge_normal[triangle, feature - 3, axis]
        else:
            normal[axis] = -surface.vertex_normal[surface.face[triangle, feature], axis]
    side = normal[0] * gap_x + normal[1] * gap_y + normal[2] * gap_z
    sign = 1.0 if side >= 0.0 else -1.0
    distance = math.sqrt(square)
    if distance > 1e-9:  # nearer than a nanometre the pseudo-normal itself is the direction
        normal[0] = sign * gap_x / distance
        normal[1] = sign * gap_y / distance
        normal[2] = sign * gap_z / distance
    else:
        size = math.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2])
        if size > 0.0:
            for axis in range(3):
                normal[axis] /= size
    return sign * distance
