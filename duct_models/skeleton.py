"""Find the centreline of a lumen: central ways from the port to every end, smoothed, centred and resampled as a tree.

The ways are found as in TEASER (Sato 2000, doi 10.1109/PCCGA.2000.883951): again and again the central way to the
farthest voxel that no earlier way explains. A central way is a shortest one with steps weighed by 1/depth^2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.spatial
from numpy.typing import NDArray

from evergym.duct_models.centreline import Centreline
from evergym.duct_models.lumen_voxels import LumenVoxels
from evergym.errors import GeometryError
from evergym.units import MM

__all__ = ["Skeleton", "find_forward", "find_skeleton", "make_centreline"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NODE_SPACING = 1.0 * MM
EXPLAINED = 1.2
"""A way explains the voxels within this many depths of it (and two voxels more)."""
SHORTEST_BRANCH = 3.0 * MM
"""A branch must protrude this far, and one depth of its parent, out of its parent's lumen [m]. Prior."""
SMOOTHING = 1.2 * MM
"""Length over which the voxels' staircase is smoothed [m]; in a bend of 30 mm radius it cuts the corner by 0.02 mm."""
CENTRING_STEPS = 16
JOINT = 1.5
"""How many depths of the parent a joint is moved back. Prior: generated ducts come back nearest with it."""
END_SHARE = 0.9
"""A branch ends at its farthest voxel with this share of the depth of the deepest one near by."""


@dataclass(frozen=True)
class Skeleton:
    """A fine tree of points along the lumen's axis, before resampling.

    Attributes:
        position: Points [m], shape (n, 3); the first is the port.
        parent: Parents, -1 for the port; they come before their children, shape (n,).
        depth: Distance to the wall on the voxel grid [m], shape (n,).
    """

    position: Array
    parent: Indices
    depth: Array

    @property
    def leaves(self) -> Indices:
        """Points without children, shape (k,)."""
        return np.flatnonzero(np.bincount(self.parent[1:], minlength=len(self.parent)) == 0)

    def path_to(self, point: int) -> Indices:
        """Points from the port to one, both included."""
        path = [point]
        while self.parent[path[-1]] >= 0:
            path.append(int(self.parent[path[-1]]))
        return np.array(path[::-1])

    def find_direction(self, length: float = 3.0 * MM) -> Array:
        """Compute the unit direction of the first few millimetres of the longest way, shape (3,)."""
        longest = max((self.path_to(int(leaf)) for leaf in self.leaves), key=len)
        points = self.position[longest]
        station = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        part = points[station <= max(length, station[min(2, len(station) - 1)])]
        # least squares: the line through the port that fits best
        arm = part - part[0]
        direction = np.linalg.svd(arm[1:], full_matrices=False)[2][0]
        return np.asarray(direction * np.sign(direction @ arm[-1]))


def find_forward(voxels: LumenVoxels, port: Array, direction: Array | None) -> NDArray[np.bool_]:
    """Find the part of the lumen that lies ahead of the port.

    Args:
        voxels: The lumen.
        port: Inside the lumen or at its end [m], shape (3,).
        direction: Of insertion; None for the side on which more of the lumen lies, shape (3,).

    Returns:
        Voxels to keep, shape (n,); the port's own voxel is among them.
    """
    arm = voxels.centre - port
    far = np.linalg.norm(arm, axis=1)
    root = voxels.find_nearest(port)
    ball = 1.5 * voxels.depth[root] + 2.0 * voxels.spacing
    if direction is None:
        label = voxels.find_components(far > ball)
        largest = int(np.argmax(np.bincount(label[label >= 0]))) if (label >= 0).any() else -1
        rim = (label == largest) & (far < ball + 2.0 * voxels.spacing)
        if not rim.any():
            return np.ones(len(far), dtype=bool)
        direction = arm[rim].mean(axis=0)
        direction /= np.linalg.norm(direction)
    ahead = arm @ direction
    plug = (ahead < -0.25 * voxels.spacing) & (ahead > -2.5 * voxels.spacing) & (far < 2.0 * ball)
    plug[root] = False
    label = voxels.find_components(~plug)
    return np.asarray(label == label[root])


def find_skeleton(voxels: LumenVoxels, port: Array, keep: NDArray[np.bool_]) -> Skeleton:
    """Find the tree of central ways from the port to every end of the lumen.

    Args:
        voxels: The lumen.
        port: Where the tree is rooted [m], shape (3,).
        keep: Voxels that may be used, shape (n,).

    Raises:
        GeometryError: If there is no way of useful length.
    """
    root = voxels.find_nearest(port, keep)
    length = voxels.measure_ways(root, keep)
    before = voxels.find_central_ways(root, keep)
    open_ends = keep & np.isfinite(length)
    growing = _GrowingTree(port, voxels, root)
    tree = scipy.spatial.cKDTree(voxels.centre)
    while open_ends.any():
        tip = int(np.argmax(np.where(open_ends, length, -1.0)))
        path = growing.trace(tip, before)
        reach = EXPLAINED * voxels.depth[path] + 2.0 * voxels.spacing
        for found in tree.query_ball_point(voxels.centre[path], reach):
            open_ends[found] = False
        open_ends[tip] = False
        path = growing.trace(_find_end(voxels, path, length, tree), before)
        if len(path) == 1:
            continue
        steps = np.linalg.norm(np.diff(voxels.centre[path], axis=0), axis=1)
        parent_depth = voxels.depth[path[0]]
        if path[0] == root or steps.sum() - parent_depth >= max(SHORTEST_BRANCH, parent_depth):
            growing.add(path)
    if len(growing.position) < 3:
        raise GeometryError(
            f"No way leads into the lumen from the port at {_text(port)} mm: the lumen there is "
            f"{2 * voxels.depth[root] / MM:.1f} mm wide and ends within a few millimetres. Choose another port."
        )
    position = np.array(growing.position)
    depth, _ = voxels.evaluate_depth(position)
    return _smooth(Skeleton(position, np.array(growing.parent), depth), voxels, np.array(growing.is_bridge))


class _GrowingTree:
    """Points found so far, and which of them stands for a voxel."""

    def __init__(self, port: Array, voxels: LumenVoxels, root: int) -> None:
        self.position = [np.array(port)]
        self.parent = [-1]
        self.is_bridge = [False]
        self.point_of = {root: 0}
        self._voxels = voxels

    def trace(self, voxel: int, before: Indices) -> list[int]:
        """Follow a voxel's predecessors to the tree: the voxels of that way, the tree's first."""
        path = [voxel]
        while path[-1] not in self.point_of:
            path.append(int(before[path[-1]]))
        return path[::-1]

    def add(self, path: list[int]) -> None:
        """Add a way that begins at a voxel of the tree.

        Central ways share the wider daughter's axis until the lumens have nearly parted, then one crosses over within
        the lumen. The joint is moved back, and both daughters run straight from there over twice that length, so that
        they part at a small angle.
        """
        start = self.point_of[path[0]]
        points = self._voxels.centre[path]
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        skipped = 0
        if start != 0:
            room = JOINT * float(self._voxels.depth[path[0]])
            joint = start
            start = self._go_back(joint, room)
            self._straighten(start, joint, room)
            skipped = min(int(np.searchsorted(along, room)), len(path) - 2)
        here = self.position[start]
        gap = points[skipped + 1] - here
        pieces = max(1, int(np.linalg.norm(gap) / self._voxels.spacing))
        for k in range(1, pieces):
            self._append(here + gap * (k / pieces), start if k == 1 else len(self.position) - 1, bridge=start != 0)
        for k in range(1, len(path)):
            if k > skipped:
                first = k == skipped + 1 and pieces == 1
                self._append(points[k], start if first else len(self.position) - 1, bridge=False)
            self.point_of[path[k]] = len(self.position) - 1

    def _append(self, point: Array, parent: int, *, bridge: bool) -> None:
        self.position.append(np.array(point))
        self.is_bridge.append(bridge)
        self.parent.append(parent)

    def _straighten(self, start: int, joint: int, room: float) -> None:
        """Draw the way that was there first straight, from the moved joint to as far behind the old one."""
        chain = [joint]
        while chain[-1] != start:
            chain.append(self.parent[chain[-1]])
        chain.reverse()
        gone = 0.0
        while gone < room:
            below = [point for point in range(chain[-1] + 1, len(self.parent)) if self.parent[point] == chain[-1]]
            if len(below) != 1:
                break
            gone += float(np.linalg.norm(self.position[below[0]] - self.position[chain[-1]]))
            chain.append(below[0])
        first, last = self.position[chain[0]], self.position[chain[-1]]
        for k, point in enumerate(chain[1:-1], start=1):
            self.position[point] = first + (last - first) * (k / (len(chain) - 1))
            self.is_bridge[point] = True

    def _go_back(self, start: int, room: float) -> int:
        """Find the ancestor that lies a length back, but never the port itself."""
        gone = 0.0
        while gone < room:
            above = self.parent[start]
            if above <= 0:
                break
            gone += float(np.linalg.norm(self.position[start] - self.position[above]))
            start = above
        return start


def _find_end(voxels: LumenVoxels, path: list[int], length: Array, tree: scipy.spatial.cKDTree) -> int:
    """Find the voxel at the centre of the last ball that fits into the end of the lumen.

    The farthest voxel lies at the wall, often in a corner, and the way to it leaves the axis before.
    """
    points = voxels.centre[path]
    rest = np.concatenate([np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)[::-1])[::-1], [0.0]])
    centre = path[int(np.flatnonzero(voxels.depth[path] + voxels.spacing >= rest)[0])]
    while True:
        near = np.array(tree.query_ball_point(voxels.centre[centre], voxels.depth[centre] + voxels.spacing))
        near = near[np.isfinite(length[near])]
        deepest = int(near[int(np.argmax(voxels.depth[near]))])
        # out of a corner the depth grows by 40 % a step, up a tapering branch by the sine of the taper only
        if voxels.depth[deepest] < 1.1 * voxels.depth[centre]:
            break
        centre = deepest
    deep = near[voxels.depth[near] >= END_SHARE * voxels.depth[near].max()]
    last = deep[length[deep] >= length[deep].max() - 0.75 * voxels.spacing]
    return int(last[int(np.argmax(voxels.depth[last]))])


def _smooth(skeleton: Skeleton, voxels: LumenVoxels, is_bridge: NDArray[np.bool_]) -> Skeleton:
    """Smooth the staircase of voxels, then move the points to the ridge of the depth, across the way only.

    Bridges between two axes are smoothed but not centred: the ridge would draw them back to the wider lumen.
    """
    position = skeleton.position.copy()
    parent = skeleton.parent
    count = len(parent)
    children = np.bincount(parent[1:], minlength=count)
    leaf = children == 0
    before = np.maximum(parent, 0)
    # a diffusion of n steps with half weights spreads over sqrt(n / 2) nodes
    steps = max(1, round(2.0 * (SMOOTHING / voxels.spacing) ** 2))
    for round_ in range(CENTRING_STEPS):
        for _ in range(steps if round_ == 0 else 3):
            below = np.zeros_like(position)
            np.add.at(below, parent[1:], position[1:])
            mean = 0.5 * (position[parent] + below / np.maximum(children, 1)[:, None])
            move = 0.5 * (mean - position)
            move[0] = 0.0
            move[leaf] = 0.0
            position += move
        _, slope = voxels.evaluate_depth(position)
        below = np.zeros_like(position)
        np.add.at(below, parent[1:], position[1:])
        end = np.where(leaf[:, None], position, below / np.maximum(children, 1)[:, None])
        along = end - position[before]
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
        across = slope - (slope * along).sum(axis=1, keepdims=True) * along
        move = (0.5 - 0.4 * round_ / CENTRING_STEPS) * voxels.spacing * across
        move[0] = 0.0
        move[is_bridge] = 0.0
        position += move
    depth, _ = voxels.evaluate_depth(position)
    return Skeleton(position, parent, depth)


def make_centreline(
    skeleton: Skeleton, radius_of: Callable[[Array], Array], spacing: float = NODE_SPACING
) -> Centreline:
    """Resample a skeleton as a centreline with evenly spaced nodes on each branch.

    Args:
        skeleton: The fine tree, with the port at the origin.
        radius_of: Function from points [m], shape (k, 3), to the distance to the wall [m], shape (k,).
        spacing: Of the nodes [m], nearly.

    Returns:
        The centreline; a bifurcation's node belongs to the branch that ends in it.
    """
    count = np.bincount(skeleton.parent[1:], minlength=len(skeleton.parent))
    children: list[list[int]] = [[] for _ in skeleton.parent]
    for point in range(1, len(skeleton.parent)):
        children[skeleton.parent[point]].append(point)
    position = [skeleton.position[0]]
    parent, station, generation, branch = [-1], [0.0], [0], [0]
    # (first point of the branch, node it starts from, generation); the port's own branch is number 0
    stack = [(child, 0, 0 if count[0] == 1 else 1) for child in reversed(children[0])]
    label = -1
    while stack:
        point, node, level = stack.pop()
        label += 1
        points = [position[node], skeleton.position[point]]
        while count[point] == 1:
            point = children[point][0]
            points.append(skeleton.position[point])
        fine = np.array(points)
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
        pieces = max(1, round(along[-1] / spacing))
        for s in np.linspace(0.0, along[-1], pieces + 1)[1:]:
            parent.append(node if s == along[-1] and pieces == 1 else len(position) - 1)
            position.append(np.array([np.interp(s, along, fine[:, axis]) for axis in range(3)]))
            station.append(0.0)
            generation.append(level)
            branch.append(label)
        first = len(position) - pieces
        parent[first] = node
        for k in range(first, len(position)):
            station[k] = station[parent[k]] + along[-1] / pieces
        stack += [(child, len(position) - 1, level + 1) for child in reversed(children[point])]
    nodes = np.array(position)
    return Centreline(
        position=nodes,
        radius=radius_of(nodes),
        parent=np.array(parent),
        station=np.array(station),
        generation=np.array(generation),
        branch=np.array(branch),
    )


def _text(point: Array) -> str:
    return "(" + ", ".join(f"{value / MM:.1f}" for value in point) + ")"
