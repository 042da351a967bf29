"""Make a wall field from python-fcl's answers, in a fraction of a second.

fcl is asked on every second grid node near the wall; the nodes between take the best of their neighbours' triangles and
walk on to the nearest one, which is exact wherever the nearest point is not far from the neighbours' (a test holds the
field to fcl at random points). Far from the wall only the sign and the trend matter, and no walk is made.
"""

from __future__ import annotations

import numpy as np
import scipy.ndimage
import scipy.spatial
import trimesh
from numpy.typing import NDArray

from evergym.duct_models.field import WallField
from evergym.duct_models.scene import WallScene
from evergym.duct_models.surface import (
    Surface,
    compute_descended_triangle,
    compute_signed_distance,
    compute_square_distance,
)
from evergym.errors import GeometryError
from evergym.jit import njit
from evergym.units import MM

__all__ = ["FIELD_SPACING", "build_wall_field"]

FIELD_SPACING = 0.5 * MM  # a quadratic spline on 0.5 mm was within the tolerance of contact in the trial
FCL_BAND = 2.5 * MM  # fcl is asked this near the wall on either side: deeper than any penetration a tissue allows
MARGIN = 2.5 * MM  # grid beyond the mesh's box
MAX_NODES = 40_000_000  # 320 MB of coefficients: a mesh that needs more has the wrong scale

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def build_wall_field(mesh: trimesh.Trimesh, spacing: float = FIELD_SPACING) -> WallField:
    """Sample the signed distance to a closed mesh and fit the spline that passes through the samples.

    Args:
        mesh: Watertight mesh with outward winding [m].
        spacing: Distance between grid nodes [m].

    Returns:
        The field; its coefficients are rounded to single precision (below 1 nm), so that a stored field has the same
        bits as a fresh one.

    Raises:
        GeometryError: The mesh is not closed, or too large for the spacing.
    """
    if not mesh.is_watertight:
        raise GeometryError(
            f"A wall field needs a closed mesh, but this one of {len(mesh.faces)} triangles has open edges. "
            "Repair it first (evergym duct check names the holes)."
        )
    lower, upper = mesh.bounds
    # Coarse nodes (every second one) must end the grid on both sides: odd counts.
    cells = np.ceil((upper - lower + 2.0 * MARGIN) / (2.0 * spacing)).astype(int)
    count = 2 * cells + 1
    if np.prod(count.astype(float)) > MAX_NODES:
        size = (upper - lower) / MM
        raise GeometryError(
            f"The wall of {size[0]:.0f} x {size[1]:.0f} x {size[2]:.0f} mm needs {np.prod(count.astype(float)):.2g} grid "
            f"nodes at {spacing / MM:.2f} mm, the limit is {MAX_NODES:.2g}. Check the mesh's unit (scale=...)."
        )
    origin = 0.5 * (lower + upper) - spacing * (count - 1) / 2.0

    scene = WallScene(mesh)
    coarse = _find_coarse_triangles(scene, origin, cells + 1, 2.0 * spacing)
    distance = np.empty(count)
    _update_grid_distances(scene.surface, origin, spacing, FCL_BAND + spacing, coarse, distance)
    coefficient = scipy.ndimage.spline_filter(distance, order=2, output=np.float64, mode="mirror")
    rounded = np.ascontiguousarray(coefficient.astype(np.float32).astype(np.float64))
    return WallField(rounded, np.ascontiguousarray(origin, dtype=np.float64), np.array([spacing]))


def _find_coarse_triangles(scene: WallScene, origin: FloatArray, shape: IntArray, spacing: float) -> IntArray:
    """The nearest triangle at each coarse node: from fcl near the wall, by the nearest corner beyond."""
    axes = [origin[axis] + spacing * np.arange(shape[axis]) for axis in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    tree = scipy.spatial.cKDTree(scene.surface.vertex)
    gap, vertex = tree.query(points)
    triangles = scene.surface.ring[scene.surface.ring_start[vertex]]
    near = gap <= FCL_BAND
    triangles[near] = scene.find_triangles(points[near])
    return triangles.reshape(tuple(shape))


@njit
def _update_grid_distances(
    surface: Surface, origin: FloatArray, spacing: float, band: float, coarse: IntArray, distance: FloatArray
) -> None:
    """Distance at every fine node: the best of its coarse neighbours' triangles, improved by a walk within the band."""
    point = np.empty(3)
    nearest = np.empty(3)
    normal = np.empty(3)
    nx, ny, nz = distance.shape
    for i in range(nx):
        point[0] = origin[0] + spacing * i
        for j in range(ny):
            point[1] = origin[1] + spacing * j
            for k in range(nz):
                point[2] = origin[2] + spacing * k
                best = -1
                best_square = np.inf
                previous = -1
                # an even index has one coarse neighbour (itself), an odd one two
                for a in range(i // 2, (i + 1) // 2 + 1):
                    for b in range(j // 2, (j + 1) // 2 + 1):
                        for c in range(k // 2, (k + 1) // 2 + 1):
                            triangle = coarse[a, b, c]
                            if triangle != previous:
                                previous = triangle
                                square = compute_square_distance(surface, triangle, point, nearest)
                                if square < best_square:
                                    best, best_square = triangle, square
                if best_square < band * band:
                    best = compute_descended_triangle(surface, best, point, nearest)
                distance[i, j, k] = compute_signed_distance(surface, best, point, nearest, normal)
