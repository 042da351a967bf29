"""Make a wall field from python-fcl's answers, in a fraction of a second.

fcl is asked on every second grid node near the wall; the nodes between take the best of their neighbours' triangles and
walk on to the nearest one, which is exact wherever the nearest point is not far from the neighbours' (a test holds the
field to fcl at random points). Farther from the wall a mean of neighbours will do.
"""

from __future__ import annotations

import numpy as np
import scipy.ndimage
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
            f"The wall of {size[0]:.0f} x {size[1]:.0f} x {size[2]:.0f} mm needs {np.prod(count.astype(float)):.2g} "
            f"grid nodes at {spacing / MM:.2f} mm, the limit is {MAX_NODES:.2g}. Check the mesh's unit (scale=...)."
        )
    origin = 0.5 * (lower + upper) - spacing * (count - 1) / 2.0

    scene = WallScene(mesh)
    coarse = _find_coarse_triangles(scene, origin, cells + 1, 2.0 * spacing)
    rough = np.empty(tuple(cells + 1))
    _update_coarse_distances(scene.surface, origin, 2.0 * spacing, coarse, rough)
    distance = np.empty(tuple(count))
    _update_fine_distances(scene.surface, origin, spacing, FCL_BAND, coarse, rough, distance)
    coefficient = scipy.ndimage.spline_filter(distance, order=2, output=np.float64, mode="mirror")
    rounded = np.ascontiguousarray(coefficient.astype(np.float32).astype(np.float64))
    return WallField(rounded, np.ascontiguousarray(origin, dtype=np.float64), np.array([spacing]))


def _find_coarse_triangles(scene: WallScene, origin: FloatArray, shape: IntArray, spacing: float) -> IntArray:
    """A triangle for each coarse node: the nearest from fcl near the wall, beyond it that of the nearest such node."""
    # Nodes next to a corner of the mesh or to a triangle's centre, then all nodes within the band of those.
    surface = scene.surface
    centre = surface.vertex[surface.face].mean(axis=1)
    touched = np.zeros(tuple(shape), dtype=bool)
    for points in (surface.vertex, centre):
        touched[tuple(np.rint((points - origin) / spacing).astype(int).T)] = True
    gap = scipy.ndimage.distance_transform_edt(~touched, sampling=spacing)
    near = gap <= FCL_BAND + spacing
    triangles = np.zeros(tuple(shape), dtype=np.int64)
    triangles[near] = scene.find_triangles(origin + spacing * np.argwhere(near))
    source = scipy.ndimage.distance_transform_edt(~near, return_distances=False, return_indices=True)
    return np.ascontiguousarray(triangles[tuple(source)])


@njit
def _update_coarse_distances(
    surface: Surface, origin: FloatArray, spacing: float, triangles: IntArray, distance: FloatArray
) -> None:
    """Signed distance at every coarse node; the triangles are replaced by those at which the walks end."""
    normal = np.empty(3)
    nx, ny, nz = distance.shape
    for i in range(nx):
        x = origin[0] + spacing * i
        for j in range(ny):
            y = origin[1] + spacing * j
            for k in range(nz):
                z = origin[2] + spacing * k
                triangle = compute_descended_triangle(surface, triangles[i, j, k], x, y, z)
                triangles[i, j, k] = triangle
                distance[i, j, k] = compute_signed_distance(surface, triangle, x, y, z, normal)


@njit
def _update_fine_distances(
    surface: Surface,
    origin: FloatArray,
    spacing: float,
    band: float,
    coarse: IntArray,
    rough: FloatArray,
    distance: FloatArray,
) -> None:
    """Signed distance at every fine node: exact within the band, the mean of its coarse neighbours beyond it."""
    normal = np.empty(3)
    nx, ny, nz = distance.shape
    for i in range(nx):
        x = origin[0] + spacing * i
        for j in range(ny):
            y = origin[1] + spacing * j
            for k in range(nz):
                z = origin[2] + spacing * k
                best = -1
                best_square = np.inf
                previous = -1
                total = 0.0
                count = 0
                # an even index has one coarse neighbour (itself), an odd one two
                for a in range(i // 2, (i + 1) // 2 + 1):
                    for b in range(j // 2, (j + 1) // 2 + 1):
                        for c in range(k // 2, (k + 1) // 2 + 1):
                            total += rough[a, b, c]
                            count += 1
                if count == 1 or abs(total) > (band + spacing) * count:
                    distance[i, j, k] = total / count
                    continue
                for a in range(i // 2, (i + 1) // 2 + 1):
                    for b in range(j // 2, (j + 1) // 2 + 1):
                        for c in range(k // 2, (k + 1) // 2 + 1):
                            triangle = coarse[a, b, c]
                            if triangle != previous:
                                previous = triangle
                                square = compute_square_distance(surface, triangle, x, y, z)
                                if square < best_square:
                                    best, best_square = triangle, square
                best = compute_descended_triangle(surface, best, x, y, z)
                distance[i, j, k] = compute_signed_distance(surface, best, x, y, z, normal)
