"""A seeded generator of duct trees: smooth curves grown from the port, redrawn until they are a usable anatomy."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evergym.duct_models.centreline import Centreline
from evergym.duct_models.family import DuctFamily
from evergym.errors import GeometryError
from evergym.jit import njit
from evergym.units import DEG, MM

__all__ = ["DuctTree", "TreeGenerator"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NODE_SPACING = 1.0 * MM
SUBSTEPS = 8  # curve steps per node: chords follow a 15 mm bend within 0.2 um
TAPER_LENGTH = 11.0 * MM  # over which a daughter narrows from its parent's radius to its own (prior)
TAPER_SHARE = 0.75  # and the largest share of its length (prior)
PLANE_JITTER = 12.0 * DEG  # daughters lie in one plane only nearly (prior)
LEAST_RATIO, MOST_RATIO = 0.65, 0.99  # of a daughter's radius to its parent's: VICTRE phantom
MOST_TRIES = 4000
TARGET_CLEARANCE = 2.0 * MM  # lumens have parted this far before a target


@dataclass(frozen=True)
class DuctTree:
    """A drawn tree.

    Attributes:
        centreline: Nodes about 1 mm apart.
        targets: Nodes the robot can be sent to, shape (k,).
        branch_parent: Parent of each branch, -1 for the trunk, shape (b,).
        tries: How many trees were drawn until this one met the family's conditions.
    """

    centreline: Centreline
    targets: IntArray
    branch_parent: IntArray
    tries: int


@dataclass(frozen=True)
class _Branch:
    parent: int
    generation: int
    position: FloatArray  # nodes, the first one is the parent's last
    frame: FloatArray  # at the end: two normals and the tangent, shape (3, 3)
    station: FloatArray
    radius: FloatArray
    azimuth: float  # of the bifurcation plane it came from, in its own parallel-transported frame
    target: int  # node within the branch, -1 if it is no leaf


@njit
def _update_curve(curvature: FloatArray, step: float, frame: FloatArray, position: FloatArray) -> None:
    """Follow a curve from its curvatures along two normals, transported in parallel (Bishop 1975, 10.2307/2319846).

    Args:
        curvature: Along the first and second normal at each step [1/m], shape (m, 2).
        step: Arclength of one step [m].
        frame: First normal, second normal, tangent at the start, shape (3, 3); overwritten with those at the end.
        position: Points [m], shape (m + 1, 3); the first is given, the others are overwritten.
    """
    for index in range(curvature.shape[0]):
        k1, k2 = curvature[index, 0], curvature[index, 1]
        bend = math.sqrt(k1 * k1 + k2 * k2)
        half = 0.5 * bend * step
        chord = step * (math.sin(half) / half if half > 1e-12 else 1.0)
        # The tangent turns by bend * step in the plane of t and m = (k1 n1 + k2 n2) / bend.
        c1, c2 = (k1 / bend, k2 / bend) if bend > 0.0 else (1.0, 0.0)
        cos_half, sin_half = math.cos(half), math.sin(half)
        cos_full, sin_full = math.cos(2.0 * half), math.sin(2.0 * half)
        for axis in range(3):
            n1, n2, t = frame[0, axis], frame[1, axis], frame[2, axis]
            m = c1 * n1 + c2 * n2
            position[index + 1, axis] = position[index, axis] + chord * (cos_half * t + sin_half * m)
            change = (cos_full - 1.0) * m - sin_full * t  # of m
            frame[0, axis] = n1 + c1 * change
            frame[1, axis] = n2 + c2 * change
            frame[2, axis] = cos_full * t + sin_full * m


class TreeGenerator:
    """Draws the tree of one family and index; the same pair gives the same bits.

    Args:
        family: The distributions.
        index: Which duct of the family, 0 or more.
    """

    def __init__(self, family: DuctFamily, index: int) -> None:
        if index < 0:
            raise GeometryError(f"A duct's index must be 0 or more: got {index} for family '{family.name}'.")
        self.family = family
        self.index = index
        self._random = np.random.default_rng(family.make_seed(index))

    def generate(self) -> DuctTree:
        """Draw trees until one meets the family's conditions on turn, stations and separation.

        Raises:
            GeometryError: The family's conditions contradict each other.
        """
        for attempt in range(1, MOST_TRIES + 1):
            branches = self._draw_branches()
            if self._turn_is_plausible(branches):
                tree = _join(branches, attempt)
                if self._is_usable(tree):
                    return tree
        raise GeometryError(
            f"No duct {self.index} of family '{self.family.name}' met its own conditions in {MOST_TRIES} draws. "
            "Widen target_station or turn_limit, or lower target_separation or wall_gap."
        )

    def _draw_branches(self) -> list[_Branch]:
        family, random = self.family, self._random
        frame = np.eye(3)  # rows: x, y and the tangent +z
        trunk_radius = family.trunk_radius.draw(random)
        trunk = self._draw_branch(
            None,
            -1,
            frame,
            family.trunk_length.draw(random),
            0.0,
            0.0,
            trunk_radius,
            random.uniform(0.0, 2.0 * math.pi),
        )
        branches = [trunk]
        growing = [0]
        early = 1 + int(random.integers(2)) if random.uniform() < family.early_leaf else -1
        while growing:
            number = growing.pop(0)
            parent = branches[number]
            twist = family.twist.draw(random) * (1.0 if random.uniform() < 0.5 else -1.0)
            plane = parent.azimuth + (twist if number else 0.0)
            level = parent.generation
            deviation = family.deviation[level].draw(random)
            ratio = family.child_ratio[level].draw(random)
            skew = family.asymmetry.draw(random)
            narrowing = family.asymmetry.draw(random)
            for side in (1.0, -1.0):
                is_leaf = level + 1 == family.generations or len(branches) == early
                length = (family.leaf_length if is_leaf else family.branch_length).draw(random)
                if len(branches) == early:  # it makes up for the branches it does not have
                    length += 0.8 * family.branch_length.draw(random)
                azimuth = plane + (0.0 if side > 0.0 else math.pi) + random.uniform(-PLANE_JITTER, PLANE_JITTER)
                share = min(max(ratio * (1.0 + 0.5 * side * narrowing), LEAST_RATIO), MOST_RATIO)
                radius = max(parent.radius[-1] * share, family.least_radius)
                margin = family.end_margin.draw(random) if is_leaf else 0.0
                child = self._draw_branch(
                    parent, number, parent.frame, length, margin, deviation * (1.0 + side * skew), radius, azimuth
                )
                if not is_leaf:
                    growing.append(len(branches))
                branches.append(child)
        return branches

    def _draw_branch(
        self,
        parent: _Branch | None,
        number: int,
        frame: FloatArray,
        length: float,
        margin: float,
        deviation: float,
        radius: float,
        azimuth: float,
    ) -> _Branch:
        """One branch: a bend away from its parent, then nearly straight, with gentle waves all along."""
        family, random = self.family, self._random
        count = max(round(length / NODE_SPACING), 2)
        extra = round(margin / NODE_SPACING)
        spacing = length / count
        step = spacing / SUBSTEPS
        s = step * (np.arange((count + extra) * SUBSTEPS) + 0.5)
        bend_length = deviation * family.bend_radius.draw(random)
        bend_length = min(bend_length, 0.8 * length)
        # The share of each step that lies in the bend, so that the total is the deviation exactly.
        share = np.clip((bend_length - (s - 0.5 * step)) / step, 0.0, 1.0) if deviation > 0.0 else np.zeros_like(s)
        bend = deviation / bend_length * share if deviation > 0.0 else share
        wave = family.tortuosity.draw(random) * np.sin(
            2.0 * math.pi * s / family.wave_length.draw(random) + random.uniform(0.0, 2.0 * math.pi)
        )
        direction = random.uniform(0.0, 2.0 * math.pi)
        curvature = np.stack(
            [
                bend * math.cos(azimuth) + wave * math.cos(direction),
                bend * math.sin(azimuth) + wave * math.sin(direction),
            ],
            axis=1,
        )
        position = np.zeros((len(s) + 1, 3))
        if parent is not None:
            position[0] = parent.position[-1]
        end = frame.copy()
        _update_curve(curvature, step, end, position)

        along = np.arange(count + extra + 1, dtype=np.float64) * spacing
        first = parent.radius[-1] if parent is not None else radius
        x = np.clip(along / min(TAPER_LENGTH, TAPER_SHARE * length), 0.0, 1.0)
        profile = first + (radius - first) * x * x * (3.0 - 2.0 * x)
        start = parent.station[-1] if parent is not None else 0.0
        generation = parent.generation + 1 if parent is not None else 0
        nodes = position[::SUBSTEPS]
        return _Branch(
            number, generation, nodes, end, np.asarray(start + along), profile, azimuth, count if margin > 0.0 else -1
        )

    def _turn_is_plausible(self, branches: list[_Branch]) -> bool:
        """Cheap first look: stations of the targets."""
        window = self.family.target_station
        return all(b.target < 0 or window.low <= b.station[b.target] <= window.high for b in branches)

    def _is_usable(self, tree: DuctTree) -> bool:
        family, line = self.family, tree.centreline
        if (line.turn_angle[tree.targets] > family.turn_limit).any():
            return False
        common = _common_stations(tree)
        apart = np.linalg.norm(line.position[:, None] - line.position[None], axis=2)
        lower = np.minimum(line.station[:, None], line.station[None])
        divided = common < lower - 1e-9  # on two branches, neither of which leads to the other
        if (apart[tree.targets] < family.target_separation)[divided[tree.targets]].any():
            return False
        gap = apart - line.radius[:, None] - line.radius[None]
        # Lumens that part at a bifurcation must have done so before either branches again and before a target.
        target = np.full(len(line.position), np.inf)
        for node in tree.targets:
            target[line.branch == line.branch[node]] = line.station[node] - TARGET_CLEARANCE
        own_end = np.array([line.station[line.branch == b].max() for b in range(len(tree.branch_parent))])[line.branch]
        start = np.array([line.station[line.branch == b].min() for b in range(len(tree.branch_parent))])[line.branch]
        latest = np.minimum(target, own_end)
        siblings = tree.branch_parent[line.branch][:, None] == tree.branch_parent[line.branch][None]
        must = divided & np.where(
            siblings,
            lower >= np.minimum(latest[:, None], latest[None]) - 0.5 * NODE_SPACING,
            (line.station[:, None] >= start[:, None]) & (line.station[None] >= start[None]),
        )
        return not (gap < family.wall_gap)[must].any()


def _common_stations(tree: DuctTree) -> FloatArray:
    """Station up to which the ways from the port to two nodes are the same [m], shape (n, n)."""
    line = tree.centreline
    count = len(tree.branch_parent)
    ends = np.array([line.station[line.branch == b].max() for b in range(count)])
    ways: list[list[int]] = []
    for b in range(count):
        way = [b]
        while tree.branch_parent[way[0]] >= 0:
            way.insert(0, int(tree.branch_parent[way[0]]))
        ways.append(way)
    limit = np.empty((count, count))
    for a in range(count):
        for b in range(count):
            if a in ways[b] or b in ways[a]:
                limit[a, b] = np.inf
            else:
                limit[a, b] = max(ends[c] for c in ways[a] if c in ways[b])
    lower = np.minimum(line.station[:, None], line.station[None])
    return np.minimum(limit[line.branch[:, None], line.branch[None]], lower)


def _join(branches: list[_Branch], tries: int) -> DuctTree:
    """One centreline of all branches; a branch's first node is its parent's last and is not repeated."""
    position: list[FloatArray] = []
    radius: list[FloatArray] = []
    station: list[FloatArray] = []
    parent: list[IntArray] = []
    generation: list[IntArray] = []
    label: list[IntArray] = []
    last: list[int] = []
    targets: list[int] = []
    total = 0
    for number, branch in enumerate(branches):
        first = 0 if branch.parent < 0 else 1
        count = len(branch.position) - first
        position.append(branch.position[first:])
        radius.append(branch.radius[first:])
        station.append(branch.station[first:])
        above = np.arange(total - 1, total + count - 1)
        above[0] = -1 if branch.parent < 0 else last[branch.parent]
        parent.append(above)
        generation.append(np.full(count, branch.generation))
        label.append(np.full(count, number))
        if branch.target >= 0:
            targets.append(total + branch.target - first)
        total += count
        last.append(total - 1)
    centreline = Centreline(
        np.concatenate(position),
        np.concatenate(radius),
        np.concatenate(parent),
        np.concatenate(station),
        np.concatenate(generation),
        np.concatenate(label),
    )
    return DuctTree(centreline, np.array(targets), np.array([b.parent for b in branches]), tries)
