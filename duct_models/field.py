"""The wall as compiled steps read it: a quadratic B-spline of the signed distance to the lumen's wall.

A quadratic spline has a continuous gradient, so a minimiser sees no kinks at cell faces, and its second derivatives
give the wall's curvature, without which Newton's method needs several times the iterations.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evergym.jit import njit

__all__ = ["WallField", "compute_wall_distance", "evaluate_wall_field"]

FloatArray = NDArray[np.float64]


class WallField(NamedTuple):
    """Signed distance to the wall [m], positive inside the lumen, on a regular grid.

    Attributes:
        coefficient: Quadratic B-spline coefficients [m], shape (nx, ny, nz), C-contiguous float64.
        origin: Position of the node (0, 0, 0) [m], shape (3,).
        spacing: Distance between nodes [m], shape (1,).
    """

    coefficient: FloatArray
    origin: FloatArray
    spacing: FloatArray


@njit
def compute_wall_distance(field: WallField, point: FloatArray, gradient: FloatArray, hessian: FloatArray) -> float:
    """Signed distance [m] of a point to the wall, with its first two derivatives.

    Outside the grid the distance is that of the nearest grid point minus the way there, so that it stays continuous and
    the gradient leads back; the Hessian of that added cone is left out.

    Args:
        field: The wall.
        point: Position [m], shape (3,).
        gradient: Overwritten with the gradient [-], shape (3,); it points into the lumen.
        hessian: Overwritten with the second derivatives [1/m], shape (3, 3).

    Returns:
        The distance [m], > 0 inside the lumen. It is finite for every finite point.
    """
    coefficient = field.coefficient
    nx, ny, nz = coefficient.shape
    spacing = field.spacing[0]
    inverse = 1.0 / spacing

    # Grid coordinates, clamped one node inside the border so that the 3 x 3 x 3 stencil fits. The comparisons send NaN
    # to the lower border: the index stays valid, and the NaN survives in the excess.
    wanted_x = (point[0] - field.origin[0]) * inverse
    wanted_y = (point[1] - field.origin[1]) * inverse
    wanted_z = (point[2] - field.origin[2]) * inverse
    u = wanted_x if wanted_x > 1.0 else 1.0
    v = wanted_y if wanted_y > 1.0 else 1.0
    w = wanted_z if wanted_z > 1.0 else 1.0
    u = min(u, nx - 2.0)
    v = min(v, ny - 2.0)
    w = min(w, nz - 2.0)
    i = int(u + 0.5)
    j = int(v + 0.5)
    k = int(w + 0.5)

    # Weights of the nodes i-1, i, i+1 with t = u - i in [-1/2, 1/2]: (1/2 - t)^2 / 2, 3/4 - t^2, (1/2 + t)^2 / 2.
    t = u - i
    x0, x1, x2 = 0.5 * (0.5 - t) ** 2, 0.75 - t * t, 0.5 * (0.5 + t) ** 2
    dx0, dx1, dx2 = t - 0.5, -2.0 * t, t + 0.5
    t = v - j
    y0, y1, y2 = 0.5 * (0.5 - t) ** 2, 0.75 - t * t, 0.5 * (0.5 + t) ** 2
    dy0, dy1, dy2 = t - 0.5, -2.0 * t, t + 0.5
    t = w - k
    z0, z1, z2 = 0.5 * (0.5 - t) ** 2, 0.75 - t * t, 0.5 * (0.5 + t) ** 2
    dz0, dz1, dz2 = t - 0.5, -2.0 * t, t + 0.5

    value = 0.0
    gx = gy = gz = 0.0
    hxx = hyy = hzz = hxy = hxz = hyz = 0.0
    for a in range(3):
        # along y and z first: f, f_y, f_z, f_yy, f_zz, f_yz of this x-slice
        s = sy = sz = syy = szz = syz = 0.0
        for b in range(3):
            c0 = coefficient[i + a - 1, j + b - 1, k - 1]
            c1 = coefficient[i + a - 1, j + b - 1, k]
            c2 = coefficient[i + a - 1, j + b - 1, k + 1]
            line = z0 * c0 + z1 * c1 + z2 * c2
            line_z = dz0 * c0 + dz1 * c1 + dz2 * c2
            line_zz = c0 - 2.0 * c1 + c2
            if b == 0:
                weight, slope, bend = y0, dy0, 1.0
            elif b == 1:
                weight, slope, bend = y1, dy1, -2.0
            else:
                weight, slope, bend = y2, dy2, 1.0
            s += weight * line
            sy += slope * line
            syy += bend * line
            sz += weight * line_z
            szz += weight * line_zz
            syz += slope * line_z
        if a == 0:
            weight, slope, bend = x0, dx0, 1.0
        elif a == 1:
            weight, slope, bend = x1, dx1, -2.0
        else:
            weight, slope, bend = x2, dx2, 1.0
        value += weight * s
        gx += slope * s
        gy += weight * sy
        gz += weight * sz
        hxx += bend * s
        hyy += weight * syy
        hzz += weight * szz
        hxy += slope * sy
        hxz += slope * sz
        hyz += weight * syz

    second = inverse * inverse
    gradient[0] = gx * inverse
    gradient[1] = gy * inverse
    gradient[2] = gz * inverse
    hessian[0, 0] = hxx * second
    hessian[1, 1] = hyy * second
    hessian[2, 2] = hzz * second
    hessian[0, 1] = hessian[1, 0] = hxy * second
    hessian[0, 2] = hessian[2, 0] = hxz * second
    hessian[1, 2] = hessian[2, 1] = hyz * second

    excess_x = wanted_x - u
    excess_y = wanted_y - v
    excess_z = wanted_z - w
    if excess_x == 0.0 and excess_y == 0.0 and excess_z == 0.0:
        return float(value)
    excess = math.sqrt(excess_x * excess_x + excess_y * excess_y + excess_z * excess_z)
    for axis in range(3):
        if axis == 0:
            part = excess_x
        elif axis == 1:
            part = excess_y
        else:
            part = excess_z
        if part != 0.0:
            gradient[axis] = -part / excess
            for other in range(3):
                hessian[axis, other] = 0.0
                hessian[other, axis] = 0.0
    return float(value - excess * spacing)


@njit
def _update_wall_distances(field: WallField, points: FloatArray, distances: FloatArray, gradients: FloatArray) -> None:
    hessian = np.empty((3, 3))
    for index in range(points.shape[0]):
        distances[index] = compute_wall_distance(field, points[index], gradients[index], hessian)


def evaluate_wall_field(field: WallField, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Signed distances and gradients at many points; for tests, pictures and reports.

    Args:
        field: The wall.
        points: Positions [m], shape (k, 3).

    Returns:
        Distances [m], shape (k,), > 0 inside the lumen, and their gradients [-], shape (k, 3).
    """
    array = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
    distances = np.empty(len(array))
    gradients = np.empty((len(array), 3))
    _update_wall_distances(field, array, distances, gradients)
    return distances, gradients
