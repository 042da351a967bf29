"""Peg fields: rigid vertical pegs, a target point and the shortest clear way to it."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evergym.duct_models.peg_path import TangentGraph, build_tangent_graph, compute_way_length, sample_way
from evergym.errors import GeometryError
from evergym.jit import njit
from evergym.units import MM

__all__ = [
    "CLEARANCE",
    "PAPER_PEG_RADIUS",
    "PAPER_PLAN",
    "PAPER_TARGETS",
    "ROBOT_DIAMETER",
    "PegField",
    "compute_peg_distance",
    "make_pegs",
    "paper_pegs",
    "read_pegs",
]

Array = NDArray[np.float64]

ROBOT_DIAMETER = 3.0 * MM
"""Outer diameter of the sheath [m]. Source: Wu 2023, Table I."""
CLEARANCE = 0.25 * MM
"""Room kept between robot and pegs along the way [m]. Prior: half of the sheath's inner play of 0.55 mm, rounded."""
PAPER_PEG_RADIUS = 2.5 * MM
"""Radius of the paper's pegs [m]. Source: Wu 2023, Fig. 12 and text (diameter 5 mm)."""
BOUNDS = np.array([[-30.0, -20.0, -10.0], [30.0, 20.0, 90.0]]) * MM
"""Corners of the working space [m], shape (2, 3). Prior: what a robot with 80 mm grown can touch, and a margin."""
_WAY_SPACING = 0.5 * MM


@njit
def compute_peg_distance(peg: Any, point: Any, gradient: Any, hessian: Any) -> float:
    """Compute the distance from a point to a peg, an infinite cylinder, with its derivatives.

    Args:
        peg: Axis point xyz [m], unit axis xyz, radius [m], shape (7,).
        point: Where [m], shape (3,).
        gradient: Gradient of the distance, shape (3,); overwritten. Points away from the peg; some direction across on
            the axis.
        hessian: Second derivatives [1/m], shape (3, 3); overwritten. Zero on the axis, where they do not exist.

    Returns:
        Distance to the surface [m], positive outside the peg.

    Source: this project; with r the distance to the axis u and n = grad r, the Hessian of r is (I - u u^T - n n^T) / r.
    """
    dx = point[0] - peg[0]
    dy = point[1] - peg[1]
    dz = point[2] - peg[2]
    along = dx * peg[3] + dy * peg[4] + dz * peg[5]
    dx -= along * peg[3]
    dy -= along * peg[4]
    dz -= along * peg[5]
    r = math.sqrt(dx * dx + dy * dy + dz * dz)
    if r < 1e-12:
        # across the axis: away from its largest component, made perpendicular
        k = 0
        for i in range(1, 3):
            if abs(peg[3 + i]) < abs(peg[3 + k]):
                k = i
        norm = math.sqrt(max(1.0 - peg[3 + k] * peg[3 + k], 1e-30))
        for i in range(3):
            gradient[i] = ((1.0 if i == k else 0.0) - peg[3 + k] * peg[3 + i]) / norm
            for j in range(3):
                hessian[i, j] = 0.0
        return float(r - peg[6])
    gradient[0] = dx / r
    gradient[1] = dy / r
    gradient[2] = dz / r
    for i in range(3):
        for j in range(3):
            unit = 1.0 if i == j else 0.0
            hessian[i, j] = (unit - peg[3 + i] * peg[3 + j] - gradient[i] * gradient[j]) / r
    return float(r - peg[6])


@dataclass(frozen=True, eq=False)
class PegField:
    """Rigid vertical pegs, a target, and the shortest way to it that clears the pegs.

    The robot starts at the origin along +z; pegs stand along y (up, against gravity), so ways are found in the x-z
    plane and heights unroll. ``robot_diameter`` and ``clearance`` widen the pegs for the way only, not for contact.

    Raises:
        GeometryError: If a value is impossible, the port or the target is covered, or no clear way joins them.
    """

    pegs: Array
    """Axis point xyz [m], unit axis xyz (along y), radius [m], shape (k, 7), read-only."""
    target: Array
    """Target [m], shape (3,), read-only."""
    name: str = "pegs"
    bounds: Array = field(default_factory=BOUNDS.copy)
    """Lower and upper corner of the working space [m], shape (2, 3)."""
    robot_diameter: float = ROBOT_DIAMETER
    """Outer diameter of the robot that the way has room for [m]."""
    clearance: float = CLEARANCE
    """Further room between robot and peg along the way [m]."""
    metadata: dict[str, Any] = field(default_factory=dict)
    """Where the field comes from: family, index, certificate."""
    way: Array = field(init=False)
    """The shortest clear way from the port to the target [m], shape (m, 3), one point every 0.5 mm, read-only."""
    way_length: float = field(init=False)
    """Its length [m]."""
    graph: TangentGraph = field(init=False, repr=False)
    """The tangent graph that answers ``distance_to_go`` and ``ahead``."""
    _pieces: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the field, freeze the arrays and find the way."""
        pegs = np.array(self.pegs, dtype=np.float64).reshape(-1, 7)
        target = np.array(self.target, dtype=np.float64).reshape(-1)
        bounds = np.array(self.bounds, dtype=np.float64).reshape(2, 3)
        self._check(pegs, target)
        centre = np.ascontiguousarray(pegs[:, [0, 2]])
        radius = pegs[:, 6] + 0.5 * self.robot_diameter + self.clearance
        self._check_uncovered(np.zeros(2), "The port", centre, radius)
        self._check_uncovered(target[[0, 2]], "The target", centre, radius)
        graph = build_tangent_graph(centre, radius, target[[0, 2]])
        pieces = np.zeros((4 * len(pegs) + 8, 7))
        length = float(compute_way_length(graph, 0.0, 0.0, 0.0, target[1]))
        if not math.isfinite(length):
            raise GeometryError(
                f"No clear way leads from the port to the target at {_text(target)} mm in peg field '{self.name}': "
                f"pegs less than "
                f"{(self.robot_diameter + 2 * self.clearance) / MM:.2f} mm apart enclose one of them. Move the target "
                f"or a peg, or "
                "choose a smaller clearance."
            )
        count = max(2, math.ceil(length / _WAY_SPACING) + 1)
        way = np.zeros((count, 3))
        sample_way(graph, 0.0, 0.0, 0.0, target[1], np.linspace(0.0, length, count), pieces, way)
        for array in (pegs, target, bounds, way):
            array.setflags(write=False)
        values = {"pegs": pegs, "target": target, "bounds": bounds, "way": way, "way_length": length, "graph": graph}
        for key, value in {**values, "_pieces": pieces}.items():
            object.__setattr__(self, key, value)

    def _check(self, pegs: Array, target: Array) -> None:
        if target.shape != (3,) or not np.isfinite(target).all():
            raise GeometryError(
                f"The target of peg field '{self.name}' must be three finite numbers in metres: got {self.target}."
            )
        if not np.isfinite(pegs).all():
            raise GeometryError(
                f"Peg {int(np.argwhere(~np.isfinite(pegs))[0, 0])} of '{self.name}' has a value that is not finite."
            )
        for k, peg in enumerate(pegs):
            if abs(abs(peg[4]) - 1.0) > 1e-9 or abs(peg[3]) + abs(peg[5]) > 1e-9:
                raise GeometryError(f"Peg {k} of '{self.name}' must stand along y: its axis is {peg[3:6].tolist()}.")
            if peg[6] <= 0.0:
                raise GeometryError(
                    f"Peg {k} of '{self.name}' has a radius of {peg[6] / MM:.2f} mm: it must be positive."
                )
        if self.robot_diameter < 0.0 or self.clearance < 0.0:
            raise GeometryError(f"Robot diameter and clearance of '{self.name}' must not be negative.")

    def _check_uncovered(self, plan: Array, what: str, centre: Array, radius: Array) -> None:
        for k in range(len(radius)):
            gap = math.hypot(*(plan - centre[k]))
            if gap < radius[k]:
                raise GeometryError(
                    f"{what} at x = {plan[0] / MM:.2f}, z = {plan[1] / MM:.2f} mm of peg field '{self.name}' is "
                    f"{gap / MM:.2f} mm "
                    f"from the axis of peg {k}: a robot of {self.robot_diameter / MM:.2f} mm needs "
                    f"{radius[k] / MM:.2f} mm there. "
                    "Move the peg or the target."
                )

    def distance_to_go(self, point: ArrayLike) -> float:
        """Compute the length of the shortest clear way from a point to the target.

        Continuous in the point. Inside a widened peg (where the robot presses on it) the way first leaves it; in a
        pocket that no way leaves, it goes straight to the best point of the field's own way.

        Args:
            point: Where [m], shape (3,).

        Returns:
            Length [m], finite.
        """
        x, y, z = (float(value) for value in np.asarray(point, dtype=np.float64))
        length = float(compute_way_length(self.graph, x, y, z, float(self.target[1])))
        if math.isfinite(length):
            return length
        return float(self._join_way(np.array([x, y, z]))[1])

    def ahead(self, point: ArrayLike, distances: ArrayLike) -> Array:
        """Find the points of the shortest clear way from a point that lie given distances ahead.

        Args:
            point: Where the way begins [m], shape (3,).
            distances: Distances ahead [m], shape (k,); beyond the target the way stays at the target.

        Returns:
            Points [m], shape (k, 3), a fresh array.
        """
        x, y, z = (float(value) for value in np.asarray(point, dtype=np.float64))
        steps = np.atleast_1d(np.asarray(distances, dtype=np.float64))
        points = np.empty((len(steps), 3))
        if sample_way(self.graph, x, y, z, float(self.target[1]), steps, self._pieces, points):
            return points
        best, _ = self._join_way(np.array([x, y, z]))
        rest = np.vstack([[x, y, z], self.way[best:]])
        station = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(rest, axis=0), axis=1))])
        return np.stack([np.interp(steps, station, rest[:, k]) for k in range(3)], axis=1)

    def _join_way(self, point: Array) -> tuple[int, float]:
        """Find the point of the field's way over which the detour is shortest: its index and the length over it."""
        rest = self.way_length * (1.0 - np.linspace(0.0, 1.0, len(self.way)))
        total = np.linalg.norm(self.way - point, axis=1) + rest
        best = int(np.argmin(total))
        return best, float(total[best])

    def distance(self, point: ArrayLike) -> float:
        """Compute the distance [m] from a point to the nearest peg, negative inside it; infinity without pegs."""
        where = np.asarray(point, dtype=np.float64)
        gap = np.hypot(self.pegs[:, 0] - where[0], self.pegs[:, 2] - where[2]) - self.pegs[:, 6]
        return float(gap.min()) if len(gap) else math.inf


def make_pegs(plan: ArrayLike, radius: float | Sequence[float] = PAPER_PEG_RADIUS) -> Array:
    """Make the peg array of vertical pegs.

    Args:
        plan: Where the axes stand, x and z [m], shape (k, 2).
        radius: Radius of all or of each [m].

    Returns:
        Axis point, unit axis (0, 1, 0) and radius, shape (k, 7).
    """
    where = np.asarray(plan, dtype=np.float64).reshape(-1, 2)
    pegs = np.zeros((len(where), 7))
    pegs[:, 0] = where[:, 0]
    pegs[:, 2] = where[:, 1]
    pegs[:, 4] = 1.0
    pegs[:, 6] = radius
    return pegs


def _text(point: Array) -> str:
    return "(" + ", ".join(f"{value / MM:.2f}" for value in point) + ")"


PAPER_PLAN = np.array([[-6.0, 15.0], [-1.0, 34.5], [-12.0, 51.0], [-2.0, 52.0]]) * MM
"""Where the four pegs of the paper's field stand, x and z [m], shape (4, 2).

Prior. The number and the diameter of the pegs are the paper's (Wu 2023, Fig. 12); their places are not given in numbers
and were not measured from its pictures. They are chosen so that the robot weaves as it does there: the shortest way to
the first target is about 60 mm long, bends around the first peg to one side and around the second to the other and ends
through the gap between the last two, and a path of three arcs with a radius of 95 mm (the robot's limit is about 90 mm)
clears every peg. The targets lie away from where the pre-curvature and the pegs take an unsteered robot.
"""
PAPER_TARGETS = np.array([[-9.0, 0.0, 61.0], [-6.5, 0.0, 44.5], [11.0, 0.0, 46.0]]) * MM
"""Targets in the paper's field [m], shape (3, 3): beyond the last gap, beyond the second peg, and on the other side.

Prior, as above.
"""


def paper_pegs(target_index: int = 0) -> PegField:
    """Make the field of the paper's Fig. 12: four rigid vertical pegs of 5 mm diameter.

    The arrangement is a prior (see ``PAPER_PLAN``).

    Args:
        target_index: Row of ``PAPER_TARGETS``: 0 for the whole slalom, 1 and 2 for shorter ways to either side.

    Raises:
        GeometryError: If there is no such target.
    """
    if not 0 <= target_index < len(PAPER_TARGETS):
        raise GeometryError(
            f"The paper's peg field has no target {target_index}: choose 0 to {len(PAPER_TARGETS) - 1}."
        )
    metadata = {"family": "paper", "index": target_index}
    return PegField(make_pegs(PAPER_PLAN), PAPER_TARGETS[target_index], name=f"paper-{target_index}", metadata=metadata)


def read_pegs(path: str | Path, target: ArrayLike, *, name: str | None = None) -> PegField:
    """Read a peg field from a CSV file with the columns x_mm, z_mm, diameter_mm; axes along y.

    Args:
        path: The file; further columns are an error, since they would be ignored silently.
        target: Target [m], shape (3,).
        name: Name of the field, the file's name by default.

    Returns:
        The field.

    Raises:
        GeometryError: If the file cannot be read; with its name, row (counted from 1, the header) and column.
    """
    file = Path(path)
    columns = ["x_mm", "z_mm", "diameter_mm"]
    try:
        text = file.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise GeometryError(
            f"Peg file '{file}' does not exist. Give a CSV file with the columns {', '.join(columns)}."
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise GeometryError(f"Peg file '{file}' cannot be read as text: {error}. Save it as UTF-8 CSV.") from None
    lines = [
        (number, row)
        for number, row in enumerate(csv.reader(text.splitlines()), start=1)
        if any(cell.strip() for cell in row)
    ]
    if not lines:
        raise GeometryError(f"Peg file '{file}' is empty. It needs the header {','.join(columns)} and one row per peg.")
    header = [cell.strip() for cell in lines[0][1]]
    for column in columns:
        if column not in header:
            raise GeometryError(
                f"Peg file '{file}', row {lines[0][0]}: column '{column}' is missing. Found: {', '.join(header)}."
            )
    for column in header:
        if column not in columns or header.count(column) > 1:
            raise GeometryError(
                f"Peg file '{file}', row {lines[0][0]}: unexpected column '{column}'. Allowed: {', '.join(columns)}."
            )
    if len(lines) == 1:
        raise GeometryError(f"Peg file '{file}' has a header but no peg. Add one row per peg: {','.join(columns)}.")
    values = np.empty((len(lines) - 1, 3))
    for k, (number, row) in enumerate(lines[1:]):
        if len(row) != len(header):
            raise GeometryError(
                f"Peg file '{file}', row {number}: {len(row)} values, but the header has {len(header)} columns."
            )
        for column, cell in zip(header, row, strict=True):
            values[k, columns.index(column)] = _read_number(cell, file, number, column)
    pegs = make_pegs(values[:, :2] * MM, (0.5 * values[:, 2] * MM).tolist())
    return PegField(
        pegs=pegs, target=np.asarray(target, dtype=np.float64), name=name or file.stem, metadata={"file": str(file)}
    )


def _read_number(cell: str, file: Path, row: int, column: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise GeometryError(
            f"Peg file '{file}', row {row}, column '{column}': '{cell.strip()}' is not a finite number (in mm)."
        )
    if column == "diameter_mm" and value <= 0.0:
        raise GeometryError(f"Peg file '{file}', row {row}, column '{column}': {value:g} mm must be positive.")
    return value
