"""The lumen on a grid: which voxels lie inside, how deep, and the shortest ways through them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.ndimage
import scipy.sparse
import scipy.sparse.csgraph
import trimesh
from numpy.typing import NDArray

from evergym.errors import GeometryError
from evergym.jit import njit
from evergym.units import MM

__all__ = ["LumenVoxels", "voxelise"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

VOXEL = 0.4 * MM
"""Edge of a voxel [m]: seven across the narrowest lumen that a 3 mm robot fits in."""
MAX_GRID = 40_000_000
"""Most voxels of the whole box."""
MAX_INSIDE = 400_000
"""Most voxels inside the lumen; a shortest-way search then takes about a second."""


@dataclass(frozen=True, eq=False)
class LumenVoxels:
    """Voxels inside a lumen, as a graph of neighbours (26 each).

    Attributes:
        centre: Voxel centres [m], shape (n, 3).
        depth: Distance to the wall, to about a third of a voxel [m], shape (n,).
        cell: Grid indices, shape (n, 3).
        number: Voxel at each grid cell, -1 outside, shape (nx, ny, nz).
        origin: Centre of grid cell (0, 0, 0) [m], shape (3,).
        spacing: Edge of a voxel [m].
    """

    centre: Array
    depth: Array
    cell: Indices
    number: Indices
    origin: Array
    spacing: float

    @cached_property
    def neighbours(self) -> tuple[Indices, Indices, Array]:
        """Pairs of neighbouring voxels and their distance [m], each pair once."""
        first, second, length = [], [], []
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                for dz in (-1, 0, 1):
                    if (dx, dy, dz) <= (0, 0, 0):
                        continue
                    # the grid has an empty margin, so neighbours never leave it
                    other = self.number[self.cell[:, 0] + dx, self.cell[:, 1] + dy, self.cell[:, 2] + dz]
                    here = np.flatnonzero(other >= 0)
                    first.append(here)
                    second.append(other[here])
                    length.append(np.full(len(here), self.spacing * float(np.sqrt(dx * dx + dy * dy + dz * dz))))
        return np.concatenate(first), np.concatenate(second), np.concatenate(length)

    def make_graph(self, keep: NDArray[np.bool_], *, central: bool) -> scipy.sparse.csr_array:
        """Make the graph of voxels to keep.

        Args:
            keep: Voxels that may be used, shape (n,).
            central: Weigh each step by 1/depth^2, which keeps shortest ways in the middle of the lumen at any width;
                else by length.

        Returns:
            Upper half of the weights, shape (n, n).
        """
        a, b, length = self.neighbours
        use = keep[a] & keep[b]
        a, b, length = a[use], b[use], length[use]
        if central:
            deep = np.maximum(self.depth, 0.25 * self.spacing) / MM
            length = length / MM * 0.5 * (deep[a] ** -2 + deep[b] ** -2)
        count = len(self.depth)
        return scipy.sparse.csr_array((length, (a, b)), shape=(count, count))

    def find_nearest(self, point: Array, keep: NDArray[np.bool_] | None = None) -> int:
        """Find the voxel nearest to a point, among those to keep."""
        square = ((self.centre - point) ** 2).sum(axis=1)
        if keep is not None:
            square = np.where(keep, square, np.inf)
        return int(np.argmin(square))

    def find_components(self, keep: NDArray[np.bool_]) -> Indices:
        """Label connected voxels among those to keep: -1 for the others, shape (n,)."""
        grid = np.zeros(self.number.shape, dtype=bool)
        grid[tuple(self.cell[keep].T)] = True
        label, _ = scipy.ndimage.label(grid, structure=np.ones((3, 3, 3)))
        found = label[tuple(self.cell.T)].astype(np.int64) - 1
        return np.where(keep, found, -1)

    def measure_ways(self, start: int, keep: NDArray[np.bool_]) -> Array:
        """Compute the length of the shortest way from a voxel to every voxel.

        Returns:
            Lengths [m], infinity where there is no way, shape (n,).
        """
        graph = self.make_graph(keep, central=False)
        found = scipy.sparse.csgraph.dijkstra(graph, directed=False, indices=np.array([start]))
        return np.asarray(found[0], dtype=np.float64)

    def find_central_ways(self, start: int, keep: NDArray[np.bool_]) -> Indices:
        """Find the predecessor of every voxel on its central way from one.

        Returns:
            Voxels, negative for the start and where there is no way, shape (n,).
        """
        graph = self.make_graph(keep, central=True)
        found = scipy.sparse.csgraph.dijkstra(
            graph, directed=False, indices=np.array([start]), return_predecessors=True
        )
        return np.asarray(found[1][0], dtype=np.int64)

    @cached_property
    def _field(self) -> Array:
        """Depth on the whole grid, smoothed over a voxel so that its ridge has a gradient."""
        grid = np.full(self.number.shape, -0.5 * self.spacing)
        grid[tuple(self.cell.T)] = self.depth
        return np.asarray(scipy.ndimage.gaussian_filter(grid, 1.0))

    @cached_property
    def _slope(self) -> list[Array]:
        return list(np.gradient(self._field, self.spacing))

    def evaluate_depth(self, points: Array) -> tuple[Array, Array]:
        """Interpolate the smoothed depth at points [m], shape (k, 3).

        Returns:
            Depth [m], shape (k,), and its gradient, shape (k, 3).
        """
        place = ((points - self.origin) / self.spacing).T
        depth = scipy.ndimage.map_coordinates(self._field, place, order=1, mode="nearest")
        slope = [scipy.ndimage.map_coordinates(part, place, order=1, mode="nearest") for part in self._slope]
        return np.asarray(depth), np.stack(slope, axis=1)


def voxelise(mesh: trimesh.Trimesh, spacing: float = VOXEL) -> LumenVoxels:
    """Find the voxels inside a closed mesh, those of the largest connected part.

    A voxel is inside where the surface winds around its centre a positive number of times, so small overlaps do no
    harm.

    Args:
        mesh: Closed, outward winding [m].
        spacing: Edge of a voxel [m]; enlarged where the lumen would have more voxels than can be searched.

    Raises:
        GeometryError: If no voxel lies inside.
    """
    lower, upper = np.asarray(mesh.bounds)
    spacing = max(spacing, float(np.prod(upper - lower + 6 * spacing) / MAX_GRID) ** (1 / 3))
    spacing = max(spacing, float(abs(mesh.volume) / MAX_INSIDE) ** (1 / 3))
    # an odd fraction of a voxel keeps grid lines off vertices and edges of meshes drawn on round numbers
    origin = lower - spacing * np.array([2.0 + 0.3819, 2.0 + 0.4142, 2.0 + 0.4472])
    count = np.ceil((upper - origin) / spacing).astype(np.int64) + 3
    turns = np.zeros(tuple(count), dtype=np.int16)
    corner = np.ascontiguousarray((mesh.vertices[mesh.faces] - origin) / spacing)
    _add_crossings(corner, turns)
    inside = np.cumsum(turns, axis=2) > 0
    label, parts = scipy.ndimage.label(inside)
    if parts == 0:
        raise GeometryError(
            f"The mesh encloses no lumen wider than {spacing / MM:.2f} mm. Check its unit and that it is the lumen's "
            f"surface."
        )
    inside = label == 1 + int(np.argmax(np.bincount(label.ravel())[1:]))
    depth = np.asarray(scipy.ndimage.distance_transform_edt(inside), dtype=np.float64) * spacing - 0.5 * spacing
    cell = np.argwhere(inside)
    number = np.full(tuple(count), -1, dtype=np.int64)
    number[tuple(cell.T)] = np.arange(len(cell))
    return LumenVoxels(origin + cell * spacing, depth[inside], cell, number, origin, spacing)


@njit
def _add_crossings(corner: Array, turns: NDArray[np.int16]) -> None:
    """Add the change of the winding number at the first voxel above each crossing of a column with a triangle.

    Args:
        corner: Triangles in grid units, shape (m, 3, 3).
        turns: Shape (nx, ny, nz); modified. Its running sum along z is the winding number.
    """
    nx, ny, nz = turns.shape
    for t in range(corner.shape[0]):
        ax, ay, az = corner[t, 0, 0], corner[t, 0, 1], corner[t, 0, 2]
        bx, by, bz = corner[t, 1, 0], corner[t, 1, 1], corner[t, 1, 2]
        cx, cy, cz = corner[t, 2, 0], corner[t, 2, 1], corner[t, 2, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        first_x = max(int(np.ceil(min(ax, bx, cx))), 0)
        last_x = min(int(np.floor(max(ax, bx, cx))), nx - 1)
        first_y = max(int(np.ceil(min(ay, by, cy))), 0)
        last_y = min(int(np.floor(max(ay, by, cy))), ny - 1)
        for i in range(first_x, last_x + 1):
            for j in range(first_y, last_y + 1):
                u = ((bx - i) * (cy - j) - (by - j) * (cx - i)) / area
                v = ((cx - i) * (ay - j) - (cy - j) * (ax - i)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                height = u * az + v * bz + w * cz
                k = min(max(int(np.ceil(height)), 0), nz - 1)
                # a face that looks down is where a way up enters the body
                turns[i, j, k] += -1 if area > 0.0 else 1
