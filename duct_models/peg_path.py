"""Shortest clear ways among vertical pegs, exact: straight tangents and arcs around discs in the x-z plane.

Every peg is a disc widened by the robot's radius and a clearance. A shortest way then consists of straight pieces that
touch the
discs and of arcs on them, so a finite graph holds all of them: its nodes are the *departures*, the points where a way
leaves a disc along a tangent towards another disc or the target. The graph is built once per field; a query joins the
point to it and costs a few microseconds. Height is exact too: vertical walls unroll, so the length in space is the
hypotenuse of length in plan and height.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evergym.jit import njit

__all__ = ["TangentGraph", "build_tangent_graph", "compute_way_length", "sample_way"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_TOUCH = 1e-9
"""Slack of every clearance check [m], far below a robot's dimension and far above rounding."""
_TURN = 2.0 * math.pi


class TangentGraph(NamedTuple):
    """All departures of shortest ways to one target, in plan (x, z).

    Rows of ``first`` are (disc, spin) pairs, spin 0 for clockwise and 1 for counter-clockwise (from x towards z).
    """

    centre: Array
    """Disc centres [m], shape (k, 2)."""
    radius: Array
    """Disc radii: peg, robot and clearance together [m], shape (k,)."""
    target: Array
    """Target in plan [m], shape (2,)."""
    first: Indices
    """Departures of row r are first[r] to first[r + 1], shape (2 k + 1,)."""
    angle: Array
    """Angle on the disc at which a departure leaves [rad], shape (d,)."""
    length: Array
    """Length of its straight piece [m], shape (d,)."""
    arrival: Array
    """Angle at which it reaches the next disc [rad], shape (d,)."""
    row: Indices
    """Row of the next disc and spin, -1 for the target, shape (d,)."""
    value: Array
    """Shortest length from the departure to the target [m], shape (d,)."""
    barrier: Array
    """Angles where an overlapping disc covers disc i from, per row [rad], shape (2 k, k); NaN where none."""


@njit
def _is_clear(ax: float, az: float, bx: float, bz: float, centre: Any, radius: Any, skip: int, other: int) -> bool:
    """Tell whether the straight piece from a to b stays out of all discs but the two that it touches."""
    ux = bx - ax
    uz = bz - az
    square = ux * ux + uz * uz
    for i in range(radius.shape[0]):
        if i == skip or i == other:
            continue
        cx = centre[i, 0] - ax
        cz = centre[i, 1] - az
        t = 0.0
        if square > 0.0:
            t = min(max((cx * ux + cz * uz) / square, 0.0), 1.0)
        dx = cx - t * ux
        dz = cz - t * uz
        if math.sqrt(dx * dx + dz * dz) < radius[i] - _TOUCH:
            return False
    return True


@njit
def _measure_arc(start: float, end: float, spin: int) -> float:
    """Compute the angle from start to end in the direction of spin, in [0, 2 pi)."""
    swept = end - start if spin == 1 else start - end
    swept = swept % _TURN
    # a full turn that rounding makes of nothing would send the way once around the peg
    return 0.0 if swept > _TURN - 1e-9 else swept


@njit
def _choose_departure(graph: Any, row: int, start: float) -> tuple[int, float]:
    """Find the best departure for a way that runs on a disc from an angle on; -1 and infinity where there is none."""
    disc = row // 2
    spin = row % 2
    limit = _TURN
    for k in range(graph.barrier.shape[1]):
        if not math.isnan(graph.barrier[row, k]):
            limit = min(limit, _measure_arc(start, graph.barrier[row, k], spin))
    best = -1
    cost = np.inf
    for d in range(graph.first[row], graph.first[row + 1]):
        swept = _measure_arc(start, graph.angle[d], spin)
        if swept <= limit:
            total = graph.radius[disc] * swept + graph.value[d]
            if total < cost:
                best = d
                cost = total
    return best, cost


@njit
def _relax(graph: Any) -> None:
    """Lower every departure's value until none changes (Bellman and Ford; all pieces have positive length)."""
    changed = True
    while changed:
        changed = False
        for d in range(graph.row.shape[0]):
            if graph.row[d] < 0:
                continue
            _, cost = _choose_departure(graph, graph.row[d], graph.arrival[d])
            cost += graph.length[d]
            if cost < graph.value[d] - 1e-15:
                graph.value[d] = cost
                changed = True


@njit
def _push_out(graph: Any, x: float, z: float) -> tuple[float, float]:
    """Move a point that lies inside discs onto their rims; in an overlap of two by alternating between them."""
    for _ in range(64):
        inside = False
        for i in range(graph.radius.shape[0]):
            dx = x - graph.centre[i, 0]
            dz = z - graph.centre[i, 1]
            r = math.sqrt(dx * dx + dz * dz)
            if r < graph.radius[i] - 0.5 * _TOUCH:
                if r < 1e-12:
                    dx, dz, r = 1.0, 0.0, 1.0
                inside = True
                x = graph.centre[i, 0] + dx / r * graph.radius[i]
                z = graph.centre[i, 1] + dz / r * graph.radius[i]
        if not inside:
            break
    return x, z


@njit
def _enter(graph: Any, x: float, z: float) -> tuple[int, float, float]:
    """Find the first piece of the shortest way from a point out of all discs.

    Returns (row, angle, cost): the disc and spin it joins and where; row -1 for straight to the target, -2 if no way
    exists.
    """
    tx = graph.target[0]
    tz = graph.target[1]
    if _is_clear(x, z, tx, tz, graph.centre, graph.radius, -1, -1):
        return -1, 0.0, math.sqrt((tx - x) ** 2 + (tz - z) ** 2)
    best = -2
    angle = 0.0
    cost = np.inf
    for i in range(graph.radius.shape[0]):
        dx = x - graph.centre[i, 0]
        dz = z - graph.centre[i, 1]
        r = math.sqrt(dx * dx + dz * dz)
        around = math.acos(min(graph.radius[i] / r, 1.0))
        straight = math.sqrt(max(r * r - graph.radius[i] ** 2, 0.0))
        if straight >= cost:
            continue
        bearing = math.atan2(dz, dx)
        for spin in range(2):
            joined = bearing + around if spin == 1 else bearing - around
            jx = graph.centre[i, 0] + graph.radius[i] * math.cos(joined)
            jz = graph.centre[i, 1] + graph.radius[i] * math.sin(joined)
            _, rest = _choose_departure(graph, 2 * i + spin, joined)
            if straight + rest < cost and _is_clear(x, z, jx, jz, graph.centre, graph.radius, i, -1):
                best = 2 * i + spin
                angle = joined
                cost = straight + rest
    return best, angle, cost


@njit
def compute_way_length(graph: Any, x: float, y: float, z: float, target_y: float) -> float:
    """Compute the length [m] of the shortest clear way from a point to the target; infinity where there is none.

    From inside a widened disc the way begins with the straight piece out of it, so the length is continuous there.
    """
    outside_x, outside_z = _push_out(graph, x, z)
    depth = math.sqrt((outside_x - x) ** 2 + (outside_z - z) ** 2)
    _, _, cost = _enter(graph, outside_x, outside_z)
    return math.sqrt((depth + cost) ** 2 + (target_y - y) ** 2)


@njit
def _place(piece: Any, share: float) -> tuple[float, float]:
    """Compute the point (x, z) at a share of a piece.

    A piece is straight (0, length, ax, az, bx, bz) or an arc (1, length, cx, cz, radius, start angle, swept angle).
    """
    if piece[0] == 0.0:
        return piece[2] + share * (piece[4] - piece[2]), piece[3] + share * (piece[5] - piece[3])
    angle = piece[5] + share * piece[6]
    return piece[2] + piece[4] * math.cos(angle), piece[3] + piece[4] * math.sin(angle)


@njit
def _put_straight(pieces: Any, k: int, ax: float, az: float, bx: float, bz: float) -> None:
    """Write a straight piece into row k."""
    pieces[k, 0] = 0.0
    pieces[k, 1] = math.sqrt((bx - ax) ** 2 + (bz - az) ** 2)
    pieces[k, 2] = ax
    pieces[k, 3] = az
    pieces[k, 4] = bx
    pieces[k, 5] = bz


@njit
def _trace(graph: Any, x: float, z: float, pieces: Any) -> int:
    """Fill pieces with the shortest way from a point; return their number, 0 if there is no way."""
    ox, oz = _push_out(graph, x, z)
    count = 0
    if ox != x or oz != z:
        _put_straight(pieces, 0, x, z, ox, oz)
        count = 1
    row, angle, cost = _enter(graph, ox, oz)
    if row == -2 or not math.isfinite(cost):
        return 0
    x, z = ox, oz
    while row >= 0:
        disc = row // 2
        cx = graph.centre[disc, 0]
        cz = graph.centre[disc, 1]
        radius = graph.radius[disc]
        jx = cx + radius * math.cos(angle)
        jz = cz + radius * math.sin(angle)
        _put_straight(pieces, count, x, z, jx, jz)
        departure, _ = _choose_departure(graph, row, angle)
        swept = _measure_arc(angle, graph.angle[departure], row % 2)
        pieces[count + 1, 0] = 1.0
        pieces[count + 1, 1] = radius * swept
        pieces[count + 1, 2] = cx
        pieces[count + 1, 3] = cz
        pieces[count + 1, 4] = radius
        pieces[count + 1, 5] = angle
        pieces[count + 1, 6] = swept if row % 2 == 1 else -swept
        count += 2
        x = cx + radius * math.cos(graph.angle[departure])
        z = cz + radius * math.sin(graph.angle[departure])
        row = graph.row[departure]
        angle = graph.arrival[departure]
    tx = graph.target[0]
    tz = graph.target[1]
    _put_straight(pieces, count, x, z, tx, tz)
    return count + 1


@njit
def sample_way(
    graph: Any, x: float, y: float, z: float, target_y: float, distances: Any, pieces: Any, points: Any
) -> int:
    """Overwrite ``points`` with the points of the shortest way that lie ``distances`` ahead of a point.

    Beyond the target the way stays at the target; height runs from y to target_y in proportion to the way in plan.

    Args:
        graph: Tangent graph of the field.
        x, y, z: Where the way begins [m].
        target_y: Height of the target [m].
        distances: Distances ahead [m], shape (n,).
        pieces: Work space, shape (2 k + 4, 7) with one row pair per disc and spin at least.
        points: Result [m], shape (n, 3); modified.

    Returns:
        1, or 0 if there is no clear way (points are then unchanged).
    """
    count = _trace(graph, x, z, pieces)
    if count == 0:
        return 0
    plan = 0.0
    for p in range(count):
        plan += pieces[p, 1]
    whole = math.sqrt(plan * plan + (target_y - y) ** 2)
    for k in range(distances.shape[0]):
        share = 1.0 if whole <= 0.0 else min(max(distances[k] / whole, 0.0), 1.0)
        ahead = share * plan
        p = 0
        while p < count - 1 and ahead > pieces[p, 1]:
            ahead -= pieces[p, 1]
            p += 1
        part = 0.0 if pieces[p, 1] <= 0.0 else min(ahead / pieces[p, 1], 1.0)
        px, pz = _place(pieces[p], part)
        points[k, 0] = px
        points[k, 1] = y + share * (target_y - y)
        points[k, 2] = pz
    return 1


def _is_covered(point: Array, centre: Array, radius: Array, skip: int) -> bool:
    """Tell whether a point of a disc's rim lies inside another disc."""
    gap = np.hypot(*(centre - point).T) - radius
    gap[skip] = np.inf
    return bool((gap < -_TOUCH).any())


def build_tangent_graph(centre: Array, radius: Array, target: Array) -> TangentGraph:
    """Build the graph of all tangents between discs and to the target, with every departure's shortest length.

    Args:
        centre: Disc centres (x, z) [m], shape (k, 2).
        radius: Disc radii [m], shape (k,).
        target: Target (x, z) [m], shape (2,), outside all discs.

    Returns:
        The graph; discs may overlap (the robot then does not fit between them).

    Source: this project; tangents of circles are elementary geometry.
    """
    count = len(radius)
    rows: list[list[tuple[float, float, float, int]]] = [[] for _ in range(2 * count)]
    barrier = np.full((2 * count, count), np.nan)
    for i in range(count):
        for spin in range(2):
            sign = 1.0 if spin == 1 else -1.0
            row = rows[2 * i + spin]
            step = target - centre[i]
            reach = math.hypot(step[0], step[1])
            if reach > radius[i]:
                angle = math.atan2(step[1], step[0]) - sign * math.acos(radius[i] / reach)
                leave = centre[i] + radius[i] * np.array([math.cos(angle), math.sin(angle)])
                if _is_clear(leave[0], leave[1], target[0], target[1], centre, radius, i, -1):
                    row.append((angle, math.sqrt(reach**2 - radius[i] ** 2), 0.0, -1))
            for j in range(count):
                if j == i:
                    continue
                step = centre[j] - centre[i]
                reach = math.hypot(step[0], step[1])
                bearing = math.atan2(step[1], step[0])
                if reach < radius[i] + radius[j] and reach > abs(radius[i] - radius[j]):
                    cosine = (reach**2 + radius[i] ** 2 - radius[j] ** 2) / (2.0 * reach * radius[i])
                    barrier[2 * i + spin, j] = bearing - sign * math.acos(min(max(cosine, -1.0), 1.0))
                for other in range(2):
                    turned = 1.0 if other == 1 else -1.0
                    offset = radius[i] * sign - radius[j] * turned
                    if abs(offset) >= reach:
                        continue
                    # the tangent's direction makes sin(angle) = offset / reach with the line of centres
                    heading = bearing + math.asin(offset / reach)
                    normal = np.array([math.sin(heading), -math.cos(heading)])
                    a = centre[i] + radius[i] * sign * normal
                    b = centre[j] + radius[j] * turned * normal
                    if _is_covered(a, centre, radius, i) or _is_covered(b, centre, radius, j):
                        continue
                    if _is_clear(a[0], a[1], b[0], b[1], centre, radius, i, j):
                        leave_angle = math.atan2(sign * normal[1], sign * normal[0])
                        reach_angle = math.atan2(turned * normal[1], turned * normal[0])
                        row.append((leave_angle, math.sqrt(reach**2 - offset**2), reach_angle, 2 * j + other))
    first = np.cumsum([0] + [len(row) for row in rows]).astype(np.int64)
    flat = [edge for row in rows for edge in row]
    table = np.array([edge[:3] for edge in flat], dtype=np.float64).reshape(-1, 3)
    to_row = np.array([edge[3] for edge in flat], dtype=np.int64)
    graph = TangentGraph(
        centre=np.ascontiguousarray(centre, dtype=np.float64),
        radius=np.ascontiguousarray(radius, dtype=np.float64),
        target=np.ascontiguousarray(target, dtype=np.float64),
        first=first,
        angle=np.ascontiguousarray(table[:, 0]),
        length=np.ascontiguousarray(table[:, 1]),
        arrival=np.ascontiguousarray(table[:, 2]),
        row=to_row,
        value=np.where(to_row < 0, table[:, 1], np.inf),
        barrier=barrier,
    )
    _relax(graph)
    return graph
