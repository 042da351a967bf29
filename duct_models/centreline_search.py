"""Compiled searches on a centreline: they are asked in every control step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evergym.jit import njit

__all__ = ["compute_common_ancestor", "compute_nearest_anywhere", "compute_nearest_nearby", "update_way_ahead"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@njit
def _compute_nearest_on_segment(position: FloatArray, start: int, end: int, point: FloatArray) -> tuple[float, float]:
    """Fraction of the nearest point on the segment between two nodes, and its squared distance [m^2]."""
    along = length = 0.0
    for axis in range(3):
        part = position[end, axis] - position[start, axis]
        along += part * (point[axis] - position[start, axis])
        length += part * part
    fraction = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
    square = 0.0
    for axis in range(3):
        part = position[end, axis] - position[start, axis]
        gap = point[axis] - position[start, axis] - fraction * part
        square += gap * gap
    return fraction, square


@njit
def compute_nearest_anywhere(position: FloatArray, parent: IntArray, point: FloatArray) -> tuple[int, float, float]:
    """Nearest segment of the whole tree: its end node, the fraction on it, the squared distance [m^2]."""
    best = 1
    best_fraction = 0.0
    best_square = np.inf
    for node in range(1, position.shape[0]):
        fraction, square = _compute_nearest_on_segment(position, parent[node], node, point)
        if square < best_square:
            best, best_fraction, best_square = node, fraction, square
    return best, best_fraction, best_square


@njit
def compute_nearest_nearby(
    position: FloatArray,
    parent: IntArray,
    station: FloatArray,
    children: IntArray,
    first_child: IntArray,
    point: FloatArray,
    near_node: int,
    near_station: float,
    reach: float,
) -> tuple[int, float, float]:
    """Nearest segment among those within ``reach`` [m] along the tree of a place on the segment that ends in a node."""
    near_node = max(near_node, 1)
    fraction, square = _compute_nearest_on_segment(position, parent[near_node], near_node, point)
    best, best_fraction, best_square = near_node, fraction, square
    stack = np.empty(position.shape[0], dtype=np.int64)
    top = near_node  # the ancestor whose subtree is searched now
    done = -1  # its child through which we came: searched already
    while True:
        to_top = abs(near_station - station[top])
        if to_top <= reach:
            size = 1
            stack[0] = top
            while size > 0:
                size -= 1
                node = stack[size]
                if to_top + station[node] - station[top] <= reach:
                    for slot in range(first_child[node], first_child[node + 1]):
                        child = children[slot]
                        if child != done:
                            fraction, square = _compute_nearest_on_segment(position, node, child, point)
                            if square < best_square:
                                best, best_fraction, best_square = child, fraction, square
                            stack[size] = child
                            size += 1
        above = parent[top]
        if above < 0 or near_station - station[above] > reach:
            break
        if parent[above] >= 0:
            fraction, square = _compute_nearest_on_segment(position, parent[above], above, point)
            if square < best_square:
                best, best_fraction, best_square = above, fraction, square
        done, top = top, above
    return best, best_fraction, best_square


@njit
def compute_common_ancestor(parent: IntArray, a: int, b: int) -> int:
    """The last node that two nodes' ways from the port share."""
    while a != b:
        if a > b:  # parents come before children, so the larger index cannot be the other's ancestor
            a = parent[a]
        else:
            b = parent[b]
    return a


@njit
def update_way_ahead(
    position: FloatArray,
    radius: FloatArray,
    parent: IntArray,
    station: FloatArray,
    path: IntArray,
    node: int,
    start: float,
    distances: FloatArray,
    points: FloatArray,
    radii: FloatArray,
) -> None:
    """Overwrite points and radii with those found ``distances`` along the way from a place to the end of ``path``."""
    common = compute_common_ancestor(parent, node, path[-1])
    end = station[path[-1]]
    on_path = common == node or common == path[-1]
    back = max(start - end, 0.0) if on_path else start - station[common]  # length of the way towards the port
    turn = start - back
    for index in range(distances.shape[0]):
        distance = max(distances[index], 0.0)
        if distance < back:
            wanted = start - distance
            b = node
            while parent[b] > 0 and station[parent[b]] > wanted:
                b = parent[b]
        else:
            wanted = min(turn + distance - back, end)
            slot = np.searchsorted(station[path], wanted)
            b = path[min(max(slot, 1), path.shape[0] - 1)]
        a = parent[b] if b > 0 else 0
        length = station[b] - station[a]
        fraction = min(max((wanted - station[a]) / length, 0.0), 1.0) if length > 0.0 else 1.0
        for axis in range(3):
            points[index, axis] = position[a, axis] + fraction * (position[b, axis] - position[a, axis])
        radii[index] = radius[a] + fraction * (radius[b] - radius[a])
