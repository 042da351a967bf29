"""What a surgeon's map gives: where the tip is on the way to the target, what lies ahead and how far it still is."""

from __future__ import annotations

import math
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from evergym.duct_models.centreline import Centreline, Location
from evergym.duct_models.pegs import PegField
from evergym.units import MM

__all__ = ["WAY_DISTANCES", "LumenRoute", "PegRoute", "Route"]

WAY_DISTANCES = (3 * MM, 6 * MM, 10 * MM, 15 * MM, 20 * MM)
"""How far ahead of the tip the way is shown [m]."""

_AHEAD = np.array(WAY_DISTANCES)
_FAR = 1.0  # the distance of the nearest peg [m] where there is none: finite, beyond every scale
_HERE_AND_AHEAD = np.array((0.0, *WAY_DISTANCES))


class Route(Protocol):
    """The way from the tip to one target.

    Attributes:
        target: The target [m].
        distance_to_go: Way to go from the tip to the target [m].
        tip_error: Distance between tip and target in the task's metric [m].
        way_ahead: Points of the way, ``WAY_DISTANCES`` ahead [m].
        width_ahead: Room for the robot's axis at these points, as a radius [m].
        beside: The centreline's point nearest to the tip; among pegs the nearest peg's axis at the tip's height [m].
        warning: 1 if the tip is off the way, else 0; among pegs the distance to the nearest peg's surface [m].
    """

    target: tuple[float, float, float]
    distance_to_go: float
    tip_error: float
    way_ahead: list[list[float]]
    width_ahead: list[float]
    beside: list[float]
    warning: float

    def locate(self, point: NDArray[np.float64]) -> None:
        """Update all attributes for a tip at ``point`` [m], near the place of the last call."""

    def copy(self) -> Self:
        """Return an independent route at the same place."""
        ...


class LumenRoute:
    """The way along a duct's centreline: all distances are along the lumen, so a wall is never crossed."""

    def __init__(self, centreline: Centreline, target_node: int, start: NDArray[np.float64]) -> None:
        self.centreline = centreline
        point = centreline.position[target_node]
        self.target: tuple[float, float, float] = (float(point[0]), float(point[1]), float(point[2]))
        self.target_location: Location = centreline.at(target_node)
        self._branches = frozenset(centreline.branch[centreline.path_to(target_node)].tolist())
        self.location: Location = centreline.locate(start)
        self.locate(start)

    def locate(self, point: NDArray[np.float64]) -> None:
        """Update all attributes for a tip at ``point`` [m], near the place of the last call."""
        centreline = self.centreline
        self.location = location = centreline.locate(point, near=self.location)
        self.distance_to_go = float(centreline.distance_along(location, self.target_location))
        # The part across the lumen counts too: the tip error is the distance in the unrolled duct.
        self.tip_error = math.hypot(self.distance_to_go, location.offset)
        points, radii = centreline.ahead(location, self.target_location, _HERE_AND_AHEAD)
        ahead: list[list[float]] = points.tolist()
        self.beside = ahead[0]
        self.way_ahead = ahead[1:]
        self.width_ahead: list[float] = radii[1:].tolist()
        self.warning = 0.0 if location.branch in self._branches else 1.0

    def copy(self) -> Self:
        """Return an independent route at the same place."""
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        return twin


class PegRoute:
    """The shortest clear way among pegs from wherever the tip is to the target point."""

    def __init__(self, peg_field: PegField, start: NDArray[np.float64]) -> None:
        self.peg_field = peg_field
        x, y, z = peg_field.target.tolist()
        self.target: tuple[float, float, float] = (x, y, z)
        self._pegs: list[list[float]] = peg_field.pegs.tolist()
        self.locate(start)

    def locate(self, point: NDArray[np.float64]) -> None:
        """Update all attributes for a tip at ``point`` [m]."""
        self.distance_to_go = self.peg_field.distance_to_go(point)
        position: list[float] = point.tolist()
        self.tip_error = math.dist(position, self.target)
        self.way_ahead: list[list[float]] = self.peg_field.ahead(point, _AHEAD).tolist()
        self.width_ahead = [self._find_peg(x, z)[0] for x, _, z in self.way_ahead]
        self.warning, peg = self._find_peg(position[0], position[2])
        self.beside = [peg[0], position[1], peg[2]] if peg else position

    def _find_peg(self, x: float, z: float) -> tuple[float, list[float]]:
        """Return the nearest peg's distance [m] and its row; pegs stand along y."""
        nearest: tuple[float, list[float]] = (_FAR, [])
        for peg in self._pegs:
            distance = math.hypot(x - peg[0], z - peg[2]) - peg[6]
            if distance < nearest[0]:
                nearest = (distance, peg)
        return nearest

    def copy(self) -> Self:
        """Return an independent route at the same place."""
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        return twin
