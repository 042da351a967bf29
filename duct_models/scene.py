"""python-fcl's view of a wall: the geometric authority that fields are made from and held to."""

from __future__ import annotations

import fcl
import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from evergym.duct_models.surface import (
    Surface,
    build_surface,
    compute_descended_triangle,
    compute_signed_distance,
)
from evergym.jit import njit
from evergym.units import MM

__all__ = ["WallScene"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# fcl's distance solver stops at an absolute tolerance made for bodies of size one, so the scene is in millimetres.
PROBE_RADIUS_MM = 1e-3


class WallScene:
    """A closed wall mesh as a bounding-volume hierarchy of python-fcl.

    fcl names the nearest triangle; the distance to it is then computed exactly, since fcl's own is only good to some
    hundredths of a millimetre and its signed distance against a hierarchy is not usable.

    Args:
        mesh: Watertight mesh with outward winding [m].
    """

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self.surface: Surface = build_surface(mesh)
        model = fcl.BVHModel()
        model.beginModel(len(self.surface.vertex), len(self.surface.face))
        model.addSubModel(self.surface.vertex / MM, self.surface.face)
        model.endModel()
        self._wall = fcl.CollisionObject(model)
        self._probe = fcl.CollisionObject(fcl.Sphere(PROBE_RADIUS_MM))

    def find_triangles(self, points: ArrayLike) -> IntArray:
        """The nearest triangle of each point as fcl sees it.

        Args:
            points: Positions [m], shape (k, 3).

        Returns:
            Face indices, shape (k,).
        """
        array = np.asarray(points, dtype=np.float64).reshape(-1, 3) / MM
        request = fcl.DistanceRequest(enable_nearest_points=False)
        found = np.empty(len(array), dtype=np.int64)
        wall, probe, distance = self._wall, self._probe, fcl.distance
        for index, point in enumerate(array):
            probe.setTranslation(point)
            result = fcl.DistanceResult()
            distance(wall, probe, request, result)
            found[index] = result.b1  # the mesh's triangle, whichever of the two bodies the mesh is
        return found

    def distance(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Signed distances to the wall and the directions in which they grow.

        Args:
            points: Positions [m], shape (k, 3).

        Returns:
            Distances [m], shape (k,), positive inside the lumen, and unit normals into the lumen, shape (k, 3).
        """
        array = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
        distances = np.empty(len(array))
        normals = np.empty((len(array), 3))
        _update_exact_distances(self.surface, array, self.find_triangles(array), distances, normals)
        return distances, normals


@njit
def _update_exact_distances(
    surface: Surface, points: FloatArray, triangles: IntArray, distances: FloatArray, normals: FloatArray
) -> None:
    for index in range(points.shape[0]):
        x, y, z = points[index, 0], points[index, 1], points[index, 2]
        triangle = compute_descended_triangle(surface, triangles[index], x, y, z)
        distances[index] = compute_signed_distance(surface, triangle, x, y, z, normals[index])
