"""The wall mesh of a procedural duct: round tubes along the centreline, joined smoothly, as one closed surface."""

from __future__ import annotations

import math

import numpy as np
import skimage.measure
import trimesh
from numpy.typing import NDArray

from evergym.duct_models.centreline import Centreline
from evergym.errors import GeometryError
from evergym.jit import njit
from evergym.units import MM

__all__ = ["PORT_EXTENSION", "build_wall_mesh"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

PORT_EXTENSION = 3.0 * MM  # straight lumen below the port, so that a robot at the port is well inside
MESH_SPACING = 0.5 * MM
BLEND_LENGTH = 1.0 * MM  # how far the edge between two lumens is rounded (prior)
SMOOTHING_STEPS = 6
LEAST_CUT = 0.03  # of a cell: moves the wall by 15 um at most, before smoothing


def build_wall_mesh(centreline: Centreline, spacing: float = MESH_SPACING) -> trimesh.Trimesh:
    """The closed surface of the lumen around a centreline.

    Each branch is a chain of round cones; branches are joined by a smooth maximum, which rounds the divider of a
    bifurcation. Leaf ends and the end below the port are hemispheres.

    Args:
        centreline: The tree, with the port at the origin along +z.
        spacing: Of the grid that the surface is extracted from [m].

    Returns:
        Watertight mesh with outward winding [m].
    """
    start, end, radius, first = _tube_arrays(centreline)
    reach = float(radius.max()) + 3.0 * spacing
    origin = np.minimum(start, end).min(axis=0) - reach
    count = np.ceil((np.maximum(start, end).max(axis=0) + reach - origin) / spacing).astype(int) + 1
    depth = np.empty(count)
    _update_depth(start, end, radius, first, origin, spacing, BLEND_LENGTH, depth)
    # A wall that passes a grid node within a few hundredths of a cell makes slivers, or no triangle at all.
    least = LEAST_CUT * spacing
    depth[np.abs(depth) < least] = least
    vertices, faces, _, _ = skimage.measure.marching_cubes(  # type: ignore[no-untyped-call]
        depth, 0.0, spacing=(spacing,) * 3, gradient_direction="descent"
    )
    mesh = trimesh.Trimesh(vertices.astype(np.float64) + origin, faces, process=False)
    # Taubin's filter smooths the grid's pattern and the crease of each joint without shrinking the lumen.
    trimesh.smoothing.filter_taubin(mesh, lamb=0.5, nu=0.53, iterations=SMOOTHING_STEPS)  # type: ignore[no-untyped-call]
    mesh = trimesh.Trimesh(np.array(mesh.vertices), np.array(mesh.faces), process=False)
    if mesh.volume < 0.0:
        mesh.invert()
    if not mesh.is_watertight:
        raise GeometryError(
            f"The wall of {len(mesh.faces)} triangles is not closed: the lumen radius {radius.min() / MM:.2f} mm is "
            f"too small for a grid of {spacing / MM:.2f} mm. Choose a smaller spacing."
        )
    return mesh


def _tube_arrays(centreline: Centreline) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Segments in the order of their branches: starts, ends, radii at both, and each branch's first segment."""
    order = np.argsort(centreline.branch[1:], kind="stable") + 1
    above = centreline.parent[order]
    start = centreline.position[above]
    end = centreline.position[order]
    radius = np.stack([centreline.radius[above], centreline.radius[order]], axis=1)
    # The extension below the port belongs to the trunk, which comes first.
    port = centreline.position[0]
    start = np.concatenate([[port - [0.0, 0.0, PORT_EXTENSION]], start])
    end = np.concatenate([[port], end])
    radius = np.concatenate([np.full((1, 2), centreline.radius[0]), radius])
    label = np.concatenate([[centreline.branch[0]], centreline.branch[order]])
    first = np.concatenate([[0], np.flatnonzero(np.diff(label)) + 1, [len(label)]])
    return start, end, radius, first.astype(np.int64)


@njit
def _update_depth(
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    first: IntArray,
    origin: FloatArray,
    spacing: float,
    blend: float,
    depth: FloatArray,
) -> None:
    """Overwrite the depth below the wall [m], positive in the lumen, at every grid node."""
    branches = first.shape[0] - 1
    low = np.empty((branches, 3))
    high = np.empty((branches, 3))
    for branch in range(branches):
        for axis in range(3):
            low[branch, axis] = np.inf
            high[branch, axis] = -np.inf
            for segment in range(first[branch], first[branch + 1]):
                widest = max(radius[segment, 0], radius[segment, 1]) + blend + 2.0 * spacing
                low[branch, axis] = min(low[branch, axis], start[segment, axis] - widest, end[segment, axis] - widest)
                high[branch, axis] = max(high[branch, axis], start[segment, axis] + widest, end[segment, axis] + widest)
    point = np.empty(3)
    axis_point = np.empty(3)  # where the winning branch's axis is nearest
    candidate = np.empty(3)
    nx, ny, nz = depth.shape
    for i in range(nx):
        point[0] = origin[0] + i * spacing
        for j in range(ny):
            point[1] = origin[1] + j * spacing
            for k in range(nz):
                point[2] = origin[2] + k * spacing
                total = -4.0 * blend  # far outside every tube
                found = False
                for branch in range(branches):
                    inside = True
                    for axis in range(3):
                        if point[axis] < low[branch, axis] or point[axis] > high[branch, axis]:
                            inside = False
                    if not inside:
                        continue
                    value, width = _compute_tube_depth(
                        start, end, radius, first[branch], first[branch + 1], point, candidate
                    )
                    if not found:
                        found = True
                        total = max(total, value)
                        axis_point[:] = candidate
                        continue
                    # Blend only as far as the two axes are apart: where a daughter still runs in its parent or beside
                    # its sibling on the same axis there is no edge to round, and a blend would only swell the lumen.
                    apart = 0.0
                    for axis in range(3):
                        apart += (candidate[axis] - axis_point[axis]) ** 2
                    x = min(math.sqrt(apart) / width, 1.0)
                    length = blend * x * x * (3.0 - 2.0 * x)
                    overlap = max(length - abs(value - total), 0.0)
                    if value > total:
                        axis_point[:] = candidate
                    total = max(value, total)
                    if overlap > 0.0:
                        total += overlap * overlap / (4.0 * length)
                depth[i, j, k] = total


@njit
def _compute_tube_depth(
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    first: int,
    last: int,
    point: FloatArray,
    nearest: FloatArray,
) -> tuple[float, float]:
    """Depth [m] of a point in one branch's chain of round cones, and the lumen radius there [m]."""
    best = -np.inf
    width = 1.0
    for segment in range(first, last):
        along = length = 0.0
        for axis in range(3):
            part = end[segment, axis] - start[segment, axis]
            along += part * (point[axis] - start[segment, axis])
            length += part * part
        fraction = min(max(along / length, 0.0), 1.0)
        square = 0.0
        for axis in range(3):
            gap = point[axis] - start[segment, axis] - fraction * (end[segment, axis] - start[segment, axis])
            square += gap * gap
        wide = radius[segment, 0] + fraction * (radius[segment, 1] - radius[segment, 0])
        value = wide - math.sqrt(square)
        if value > best:
            best, width = value, wide
            for axis in range(3):
                nearest[axis] = start[segment, axis] + fraction * (end[segment, axis] - start[segment, axis])
    return best, width
