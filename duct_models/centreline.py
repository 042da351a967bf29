"""The lumen's centreline: a tree of nodes rooted at the port, with radius, station, generation and branch."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evergym.duct_models.centreline_search import (
    compute_common_ancestor,
    compute_nearest_anywhere,
    compute_nearest_nearby,
    update_way_ahead,
)
from evergym.errors import GeometryError
from evergym.units import MM

__all__ = ["Centreline", "Location"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# How far along the lumen `locate` looks from an earlier location: several control steps of travel (at most 3 mm each),
# yet less than the way round a bifurcation from behind one wall to behind the other.
NEIGHBOURHOOD = 8.0 * MM


class Location(NamedTuple):
    """A place on the centreline.

    Attributes:
        node: The node at the far end of the segment it lies on (the segment runs from this node's parent to it).
        fraction: Where on that segment, 0 at the parent, 1 at the node [-].
        station: Arclength from the port [m].
        offset: Distance of the located point from the centreline [m].
        branch: The segment's branch.
    """

    node: int
    fraction: float
    station: float
    offset: float
    branch: int


class HasNode(Protocol):
    """Anything that lies on a node, such as a ``Target`` or a ``Location``."""

    @property
    def node(self) -> int:
        """Index of the node."""


@dataclass(frozen=True, eq=False)
class Centreline:
    """A tree of centreline nodes; every parent comes before its children, the root (node 0) is the port.

    Attributes:
        position: Nodes [m], shape (n, 3).
        radius: Lumen radius [m], shape (n,).
        parent: Index of each node's parent, -1 for the root, shape (n,).
        station: Arclength from the port along the smooth curve [m], shape (n,).
        generation: Bifurcations passed since the port (trunk = 0), shape (n,).
        branch: Index of the branch each node (and the segment that ends in it) belongs to, shape (n,).
    """

    position: FloatArray
    radius: FloatArray
    parent: IntArray
    station: FloatArray
    generation: IntArray
    branch: IntArray

    def __post_init__(self) -> None:
        for name in ("position", "radius", "station"):
            self._freeze(name, np.float64)
        for name in ("parent", "generation", "branch"):
            self._freeze(name, np.int64)
        self._check()

    def _freeze(self, name: str, kind: type) -> None:
        array: NDArray[np.generic] = np.array(getattr(self, name), dtype=kind, order="C")
        array.flags.writeable = False
        object.__setattr__(self, name, array)

    def _check(self) -> None:
        count = len(self.position)
        if count < 2 or self.position.shape != (count, 3):
            raise GeometryError(
                f"A centreline needs at least 2 nodes with 3 coordinates each: got shape {self.position.shape}."
            )
        for name in ("radius", "parent", "station", "generation", "branch"):
            shape = getattr(self, name).shape
            if shape != (count,):
                raise GeometryError(f"The centreline has {count} nodes, but its {name} has shape {shape}.")
        bad = ~(np.isfinite(self.position).all(axis=1) & np.isfinite(self.station) & (self.radius > 0.0))
        if bad.any():
            node = int(np.argmax(bad))
            raise GeometryError(
                f"Centreline node {node} is not usable: position {self.position[node]} m, station "
                f"{self.station[node] / MM:.2f} mm, radius {self.radius[node] / MM:.2f} mm. All must be finite, and "
                "the radius positive."
            )
        if self.parent[0] != -1 or (self.parent[1:] < 0).any() or (self.parent[1:] >= np.arange(1, count)).any():
            raise GeometryError(
                "A centreline's node 0 must be its only root (-1), and parents must come before children."
            )
        step = self.station[1:] - self.station[self.parent[1:]]
        if not (step > 0.0).all():
            node = int(np.argmin(step)) + 1
            raise GeometryError(
                f"The station must grow along the centreline: it goes from "
                f"{self.station[self.parent[node]] / MM:.3f} to {self.station[node] / MM:.3f} mm at node {node}."
            )

    @cached_property
    def _children(self) -> tuple[IntArray, IntArray]:
        """Children of all nodes in one array, and where each node's begin."""
        order = np.argsort(self.parent[1:], kind="stable") + 1
        count = np.bincount(self.parent[1:], minlength=len(self.parent))
        return order.astype(np.int64), np.concatenate([[0], np.cumsum(count)]).astype(np.int64)

    @cached_property
    def _paths(self) -> dict[int, IntArray]:
        return {}

    @cached_property
    def leaves(self) -> IntArray:
        """Nodes without children, shape (k,)."""
        count = np.bincount(self.parent[1:], minlength=len(self.parent))
        return np.flatnonzero(count == 0)

    @cached_property
    def bifurcations(self) -> IntArray:
        """Nodes with more than one child, shape (k,)."""
        count = np.bincount(self.parent[1:], minlength=len(self.parent))
        return np.flatnonzero(count > 1)

    @cached_property
    def turn_angle(self) -> FloatArray:
        """Summed change of direction from the port (+z) to each node [rad], shape (n,)."""
        segment = self.position[1:] - self.position[self.parent[1:]]
        direction = np.empty_like(self.position)
        direction[0] = (0.0, 0.0, 1.0)
        direction[1:] = segment / np.linalg.norm(segment, axis=1, keepdims=True)
        before = direction[self.parent]
        bend = np.arctan2(np.linalg.norm(np.cross(before, direction), axis=1), np.sum(before * direction, axis=1))
        bend[0] = 0.0
        for node in range(1, len(bend)):  # parents come before children
            bend[node] += bend[self.parent[node]]
        return np.asarray(bend)

    def path_to(self, node: int) -> IntArray:
        """The nodes from the root to ``node``, both included, shape (k,)."""
        path = self._paths.get(node)
        if path is None:
            if not 0 <= node < len(self.parent):
                raise GeometryError(f"There is no centreline node {node}: this one has {len(self.parent)} nodes.")
            nodes = [node]
            while self.parent[nodes[-1]] >= 0:
                nodes.append(int(self.parent[nodes[-1]]))
            path = np.array(nodes[::-1], dtype=np.int64)
            path.flags.writeable = False
            self._paths[node] = path
        return path

    def at(self, target: int | HasNode) -> Location:
        """The location of a node, or of a target that lies on one."""
        node = _node_of(target)
        return Location(node, 1.0, float(self.station[node]), 0.0, int(self.branch[node]))

    def locate(self, point: ArrayLike, near: Location | None = None) -> Location:
        """The place on the centreline that is nearest to a point.

        Args:
            point: Position [m], shape (3,).
            near: An earlier location of the same moving point. The search then keeps to its neighbourhood along the
                lumen (8 mm), so that a point is never reported on a branch behind a wall.
        """
        place = np.ascontiguousarray(point, dtype=np.float64)
        if near is None:
            node, fraction, square = compute_nearest_anywhere(self.position, self.parent, place)
        else:
            children, first_child = self._children
            node, fraction, square = compute_nearest_nearby(
                self.position, self.parent, self.station, children, first_child, place, near.node, near.station,
                NEIGHBOURHOOD,
            )  # fmt: skip
        start = self.station[self.parent[node]]
        station = float(start + fraction * (self.station[node] - start))
        return Location(node, fraction, station, square**0.5, int(self.branch[node]))

    def position_at(self, location: Location) -> FloatArray:
        """The point of the centreline at a location [m], shape (3,)."""
        return self._interpolate(self.position, location)

    def radius_at(self, location: Location) -> float:
        """The lumen radius at a location [m]."""
        return float(self._interpolate(self.radius, location))

    def direction_at(self, location: Location) -> FloatArray:
        """The unit tangent at a location, away from the port, shape (3,)."""
        node = max(location.node, 1)
        segment = self.position[node] - self.position[self.parent[node]]
        return np.asarray(segment / np.linalg.norm(segment))

    def _interpolate(self, values: FloatArray, location: Location) -> FloatArray:
        end = values[location.node]
        if location.node == 0:
            return np.array(end)
        start = values[self.parent[location.node]]
        return np.asarray(start + location.fraction * (end - start))

    def distance_along(self, location_a: Location, location_b: Location) -> float:
        """Length of the way from one location to another along the tree [m]."""
        node = compute_common_ancestor(self.parent, location_a.node, location_b.node)
        if node in (location_a.node, location_b.node):  # one lies on the other's way to the port
            return abs(location_a.station - location_b.station)
        return location_a.station + location_b.station - 2.0 * float(self.station[node])

    def ahead(self, location: Location, target: int | HasNode, distances: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Points of the way from a location to a target, back out of a wrong branch where necessary.

        Args:
            location: Where the way begins.
            target: The node, or target on a node, where it ends.
            distances: How far ahead along the way [m], shape (k,); beyond the target, the target itself is given.

        Returns:
            Points [m], shape (k, 3), and lumen radii there [m], shape (k,).
        """
        wanted = np.ascontiguousarray(distances, dtype=np.float64).reshape(-1)
        points = np.empty((len(wanted), 3))
        radii = np.empty(len(wanted))
        update_way_ahead(
            self.position, self.radius, self.parent, self.station, self.path_to(_node_of(target)), location.node,
            location.station, wanted, points, radii,
        )  # fmt: skip
        return points, radii


def _node_of(target: int | HasNode) -> int:
    return int(target) if isinstance(target, int | np.integer) else int(target.node)
