"""Clearance play: the catheter tilts in its port and in the sheath before it is bent."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit

__all__ = ["ClearancePlay", "ClearancePlayParameters", "add_play"]

Array = NDArray[np.float64]


class ClearancePlayParameters(NamedTuple):
    """SI parameters: angle [rad] to either side, moment that crosses it [N m], whether the tendon pulls across it."""

    angle: float
    moment: float
    tendon_crosses: bool


@dataclass(frozen=True)
class ClearancePlay:
    """At the base the catheter tilts by up to the angle to any side, held by the sheath and a small centring moment.

    The sheath bends by the whole tilt; the catheter's springs take what is beyond the angle. The radial gap of 0.55 mm
    gives an angle of gap over overlap. Off at zero angle; acts in the full setup only. Source: the paper's Table I for
    the gap, its Fig. 11 for the angle: the full system answers a tip load 12 to 34 % more than the bare catheter.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=26,
        acts_on="state",
        moves=("tip_x_mm", "tip_y_mm", "curvature_1_per_m", "tip_angle_deg"),
        depends_on=("orientation",),
        partners=("torsional_windup", "tendon_backlash", "saline_weight"),
        off={"angle_deg": 0.0},
        strength=("angle_deg",),
        typical={"angle_deg": 4.0},
    )

    angle_deg: float = parameter(0.0, unit="deg", low=0.0, high=60.0, source="off; 6 to 8 in all would explain Fig. 11")
    centring_moment_n_m: float = parameter(
        1e-5, unit="N m", low=1e-9, high=1.0, prior=True, help="Reached at the angle, and constant beyond."
    )
    tendon_crosses: bool = parameter(False, prior=True, help="Whether the tendon's pull closes the play.")

    def compile(self) -> ClearancePlayParameters:
        """Return the SI parameters."""
        return ClearancePlayParameters(math.radians(self.angle_deg), self.centring_moment_n_m, self.tendon_crosses)


@njit
def add_play(
    parameters: ClearancePlayParameters, bend_x: float, bend_y: float, gradient: Array, hessian: Array
) -> float:
    """Turn derivatives by the elastic bend into derivatives by the whole bend, and add the play's own energy.

    Args:
        parameters: Of the play.
        bend_x: Tilt about x: the whole bend less the catheter's own [rad].
        bend_y: About y [rad].
        gradient: Derivatives by elastic bend x and y, twist and roll, shape (4,); overwritten.
        hessian: Second derivatives, shape (4, 4), upper triangle; overwritten.

    Returns:
        The play's energy [J].
    """
    limit = parameters.angle
    size = math.sqrt(bend_x * bend_x + bend_y * bend_y)
    if size <= limit:
        # Nothing elastic is bent: the springs' derivatives by the bend vanish with it.
        stiffness = parameters.moment / limit
        gradient[0] = stiffness * bend_x
        gradient[1] = stiffness * bend_y
        for a in range(2):
            for b in range(a, 4):
                hessian[a, b] = 0.0
        hessian[0, 0] = stiffness
        hessian[1, 1] = stiffness
        return 0.5 * stiffness * size * size
    nx = bend_x / size
    ny = bend_y / size
    ratio = limit / size
    # Elastic bend b - limit n: its derivative is (1 - ratio) I + ratio n n.
    xx = 1.0 - ratio + ratio * nx * nx
    xy = ratio * nx * ny
    yy = 1.0 - ratio + ratio * ny * ny
    gx = gradient[0]
    gy = gradient[1]
    hxx = hessian[0, 0]
    hxy = hessian[0, 1]
    hyy = hessian[1, 1]
    axx = hxx * xx + hxy * xy
    axy = hxx * xy + hxy * yy
    ayx = hxy * xx + hyy * xy
    ayy = hxy * xy + hyy * yy
    along = gx * nx + gy * ny
    curl = ratio / size
    tangential = parameters.moment / size
    gradient[0] = xx * gx + xy * gy + parameters.moment * nx
    gradient[1] = xy * gx + yy * gy + parameters.moment * ny
    hessian[0, 0] = xx * axx + xy * ayx + curl * (2.0 * nx * gx + along * (1.0 - 3.0 * nx * nx)) + tangential * ny * ny
    hessian[0, 1] = xx * axy + xy * ayy + curl * (nx * gy + ny * gx - 3.0 * along * nx * ny) - tangential * nx * ny
    hessian[1, 1] = xy * axy + yy * ayy + curl * (2.0 * ny * gy + along * (1.0 - 3.0 * ny * ny)) + tangential * nx * nx
    for b in range(2, 4):
        hx = hessian[0, b]
        hy = hessian[1, b]
        hessian[0, b] = xx * hx + xy * hy
        hessian[1, b] = xy * hx + yy * hy
    return parameters.moment * (size - 0.5 * limit)
