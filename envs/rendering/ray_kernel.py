"""Rays from the robot's tip: where they meet the wall, a peg or the target, and the picture that a lamp there gives.

The wall is found by sphere tracing: the signed distance says how far a ray can go without meeting anything (Hart 1996,
doi:10.1007/s003710050084). Near the wall a ray goes on by a small step until it has crossed; the secant then finds the
place. Longer steps that are taken back where they may have jumped over something (Keinert 2014,
doi:10.2312/stag.20141233) were slower here: a quarter more at 1.3, since ducts are narrow and rays end soon.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from evergym.duct_models.field import WallField, compute_wall_distance
from evergym.jit import njit

__all__ = ["NOTHING", "PEG", "TARGET", "WALL", "draw_endoscope", "trace_rays"]

FloatArray = NDArray[np.float64]

NOTHING, WALL, PEG, TARGET = 0, 1, 2, 3
"""What a ray meets."""

_STEP_MIN = 1e-4  # m; near the wall a ray goes on by this much until it has crossed it
_CLOSE = 5e-7  # m; near enough to the wall for the secant to end
_STEP_COUNT = 400
_SECANTS = 4


@njit
def _compute_distance(field: WallField, x: float, y: float, z: float) -> float:
    """Signed distance [m] as ``compute_wall_distance`` has it, without derivatives, for points inside the grid."""
    coefficient = field.coefficient
    nx, ny, nz = coefficient.shape
    inverse = 1.0 / field.spacing[0]
    u = min(max((x - field.origin[0]) * inverse, 1.0), nx - 2.0)
    v = min(max((y - field.origin[1]) * inverse, 1.0), ny - 2.0)
    w = min(max((z - field.origin[2]) * inverse, 1.0), nz - 2.0)
    i, j, k = int(u + 0.5), int(v + 0.5), int(w + 0.5)
    t = u - i
    x0, x1, x2 = 0.5 * (0.5 - t) ** 2, 0.75 - t * t, 0.5 * (0.5 + t) ** 2
    t = v - j
    y0, y1, y2 = 0.5 * (0.5 - t) ** 2, 0.75 - t * t, 0.5 * (0.5 + t) ** 2
    t = w - k
    z0, z1, z2 = 0.5 * (0.5 - t) ** 2, 0.75 - t * t, 0.5 * (0.5 + t) ** 2
    value = 0.0
    for a in range(3):
        weight = x0 if a == 0 else (x1 if a == 1 else x2)
        p = i + a - 1
        line0 = z0 * coefficient[p, j - 1, k - 1] + z1 * coefficient[p, j - 1, k] + z2 * coefficient[p, j - 1, k + 1]
        line1 = z0 * coefficient[p, j, k - 1] + z1 * coefficient[p, j, k] + z2 * coefficient[p, j, k + 1]
        line2 = z0 * coefficient[p, j + 1, k - 1] + z1 * coefficient[p, j + 1, k] + z2 * coefficient[p, j + 1, k + 1]
        value += weight * (y0 * line0 + y1 * line1 + y2 * line2)
    return value


@njit
def _trace_wall(field: WallField, origin: FloatArray, dx: float, dy: float, dz: float, reach: float) -> float:
    """Return how far along a ray the wall is [m]; ``reach`` where it is farther, 0 where the ray begins outside."""
    distance = _compute_distance(field, origin[0], origin[1], origin[2])
    if distance <= 0.0:
        return 0.0
    t = 0.0
    for _ in range(_STEP_COUNT):
        ahead = t + max(distance, _STEP_MIN)
        found = _compute_distance(field, origin[0] + ahead * dx, origin[1] + ahead * dy, origin[2] + ahead * dz)
        if found <= 0.0:
            low, high, at_low, at_high = t, ahead, distance, found
            for _ in range(_SECANTS):
                t = low + (high - low) * at_low / (at_low - at_high)
                found = _compute_distance(field, origin[0] + t * dx, origin[1] + t * dy, origin[2] + t * dz)
                if abs(found) < _CLOSE:
                    return t
                if found > 0.0:
                    low, at_low = t, found
                else:
                    high, at_high = t, found
            return low + (high - low) * at_low / (at_low - at_high)
        if ahead >= reach:
            return reach
        t, distance = ahead, found
    return min(t, reach)


@njit
def _trace_peg(peg: FloatArray, origin: FloatArray, dx: float, dy: float, dz: float) -> float:
    """Return how far along a ray an endless cylinder is [m]; infinite where the ray passes it or begins inside."""
    ox, oy, oz = origin[0] - peg[0], origin[1] - peg[1], origin[2] - peg[2]
    along = ox * peg[3] + oy * peg[4] + oz * peg[5]
    ox, oy, oz = ox - along * peg[3], oy - along * peg[4], oz - along * peg[5]
    along = dx * peg[3] + dy * peg[4] + dz * peg[5]
    dx, dy, dz = dx - along * peg[3], dy - along * peg[4], dz - along * peg[5]
    a = dx * dx + dy * dy + dz * dz
    b = ox * dx + oy * dy + oz * dz
    c = ox * ox + oy * oy + oz * oz - peg[6] * peg[6]
    square = b * b - a * c
    if c <= 0.0 or b >= 0.0 or square < 0.0:
        return math.inf
    return float((-b - math.sqrt(square)) / a)


@njit
def _trace_sphere(ball: FloatArray, origin: FloatArray, dx: float, dy: float, dz: float) -> float:
    """Return how far along a ray a ball (centre, radius) is [m]; infinite where the ray passes it or begins inside."""
    ox, oy, oz = origin[0] - ball[0], origin[1] - ball[1], origin[2] - ball[2]
    b = ox * dx + oy * dy + oz * dz
    c = ox * ox + oy * oy + oz * oz - ball[3] * ball[3]
    square = b * b - c
    if c <= 0.0 or b >= 0.0 or square < 0.0:
        return math.inf
    return float(-b - math.sqrt(square))


@njit
def _trace(
    field: WallField,
    has_wall: bool,
    pegs: FloatArray,
    ball: FloatArray,
    origin: FloatArray,
    dx: float,
    dy: float,
    dz: float,
    reach: float,
) -> tuple[float, int, int]:
    """Return how far along a ray the first thing is [m], what it is, and which peg."""
    depth, kind, number = reach, NOTHING, -1
    if ball[3] > 0.0:
        t = _trace_sphere(ball, origin, dx, dy, dz)
        if t < depth:
            depth, kind = t, TARGET
    for index in range(pegs.shape[0]):
        t = _trace_peg(pegs[index], origin, dx, dy, dz)
        if t < depth:
            depth, kind, number = t, PEG, index
    if has_wall:
        t = _trace_wall(field, origin, dx, dy, dz, depth)
        if t < depth:
            depth, kind = t, WALL
    return depth, kind, number


@njit
def trace_rays(
    field: WallField,
    has_wall: bool,
    pegs: FloatArray,
    ball: FloatArray,
    origin: FloatArray,
    directions: FloatArray,
    reach: float,
    depth: FloatArray,
    kind: NDArray[np.int64],
) -> None:
    """Update how far along each ray the first thing is, and what it is.

    Args:
        field: The wall; read only with ``has_wall``.
        has_wall: Whether there is one.
        pegs: Endless cylinders as in ``PegField.pegs``, shape (k, 7).
        ball: Centre and radius of the target's marker [m], shape (4,); radius 0: none.
        origin: Where the rays begin [m], shape (3,).
        directions: Unit vectors, shape (n, 3).
        reach: Where rays end that meet nothing [m].
        depth: Overwritten [m], shape (n,).
        kind: Overwritten with what is met, shape (n,).
    """
    for index in range(directions.shape[0]):
        dx, dy, dz = directions[index, 0], directions[index, 1], directions[index, 2]
        depth[index], kind[index], _ = _trace(field, has_wall, pegs, ball, origin, dx, dy, dz, reach)


@njit
def _compute_mottling(x: float, y: float, z: float) -> float:
    """A faint pattern on the wall, fixed to it, about -1..1: without one a straight duct looks the same all along."""
    a = math.sin(2600.0 * x + 1.7 * math.sin(1900.0 * z)) * math.sin(2300.0 * y + 1.3 * math.sin(2100.0 * x))
    b = math.sin(5200.0 * z + 2.1 * math.sin(3100.0 * y)) * math.sin(4700.0 * x + 900.0 * y)
    return 0.6 * a + 0.4 * b


@njit
def draw_endoscope(
    field: WallField,
    has_wall: bool,
    pegs: FloatArray,
    ball: FloatArray,
    camera: FloatArray,
    half_width: float,
    reach: float,
    lamp: float,
    palette: FloatArray,
    samples: int,
    image: NDArray[np.uint8],
) -> None:
    """Update ``image`` with what a camera with a lamp beside its lens sees.

    A surface is as bright as Lambert's law and the inverse square of its distance make it, with a faint highlight where
    it faces the lamp (tissue is wet); a film curve then maps any brightness to 0..1.

    Args:
        field: See ``trace_rays``, as for the next three.
        has_wall: Whether there is a wall.
        pegs: The pegs.
        ball: The target's marker.
        camera: Position [m], right, up and forward (unit), shape (4, 3).
        half_width: Tangent of half the field of view across the picture's shorter side.
        reach: Where rays end [m].
        lamp: Distance at which a surface that faces the lamp is at middle brightness [m].
        palette: Linear RGB of nothing, wall, peg and target, shape (4, 3).
        samples: Rays per pixel along each side.
        image: Overwritten, shape (height, width, 3).
    """
    height, width, _ = image.shape
    origin = camera[0]
    scale = 2.0 * half_width / min(height, width)
    gradient = np.empty(3)
    hessian = np.empty((3, 3))
    point = np.empty(3)
    total = np.empty(3)
    for row in range(height):
        for column in range(width):
            total[:] = 0.0
            for sample in range(samples * samples):
                across = (column + (sample % samples + 0.5) / samples - 0.5 * width) * scale
                above = (0.5 * height - row - (sample // samples + 0.5) / samples) * scale
                norm = 1.0 / math.sqrt(1.0 + across * across + above * above)
                dx = norm * (camera[3, 0] + across * camera[1, 0] + above * camera[2, 0])
                dy = norm * (camera[3, 1] + across * camera[1, 1] + above * camera[2, 1])
                dz = norm * (camera[3, 2] + across * camera[1, 2] + above * camera[2, 2])
                depth, kind, number = _trace(field, has_wall, pegs, ball, origin, dx, dy, dz, reach)
                if kind == NOTHING:
                    for channel in range(3):
                        total[channel] += palette[0, channel]
                    continue
                point[0], point[1], point[2] = origin[0] + depth * dx, origin[1] + depth * dy, origin[2] + depth * dz
                pattern = 1.0
                own = 0.0  # light of its own, so that a marker stays visible from afar
                if kind == WALL:
                    compute_wall_distance(field, point, gradient, hessian)
                    pattern = 1.0 + 0.16 * _compute_mottling(point[0], point[1], point[2])
                elif kind == PEG:
                    peg = pegs[number]
                    along = 0.0
                    for axis in range(3):
                        along += (point[axis] - peg[axis]) * peg[3 + axis]
                    for axis in range(3):
                        gradient[axis] = point[axis] - peg[axis] - along * peg[3 + axis]
                else:
                    own = 0.35
                    for axis in range(3):
                        gradient[axis] = point[axis] - ball[axis]
                size = math.sqrt(gradient[0] ** 2 + gradient[1] ** 2 + gradient[2] ** 2)
                facing = -(dx * gradient[0] + dy * gradient[1] + dz * gradient[2]) / max(size, 1e-12)
                facing = max(facing, 0.0)
                ratio = lamp / max(depth, 0.1 * lamp)
                if depth <= 0.0:  # the lens is in the tissue: all of the picture has its colour
                    facing, ratio = 1.0, 1.0
                light = ratio * ratio
                shine = 0.12 * light * facing**24
                for channel in range(3):
                    bright = palette[kind, channel] * (facing * light * pattern + own) + shine
                    total[channel] += 1.0 - math.exp(-1.4 * bright)
            for channel in range(3):
                value = total[channel] / (samples * samples)
                image[row, column, channel] = np.uint8(255.0 * math.sqrt(value) + 0.5)
