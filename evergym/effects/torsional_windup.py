"""Torsional wind-up: the tail squeezes the catheter and holds back its roll, so the tip turns later than the base."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit

__all__ = ["TorsionalWindup", "TorsionalWindupParameters", "compute_roll_friction", "compute_torque_limit"]


class TorsionalWindupParameters(NamedTuple):
    """SI parameters: coefficient [1] and presliding angle [rad]."""

    mu: float
    presliding: float


@dataclass(frozen=True)
class TorsionalWindup:
    """A friction torque of at most mu p 2 pi r_c^2 per length resists the catheter's roll inside the sheath.

    It sticks (elastic within the presliding angle) and slides, so the twist tau L^2 / (2 G J) turns round only after
    twice that rotation of the base. Off at mu = 0. Source: this project, the tail pressed by p on a catheter of radius
    r_c.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=17,
        acts_on="state",
        moves=("tip_x_mm", "tip_y_mm", "bending_angle_deg"),
        depends_on=("pressure", "history", "orientation"),
        partners=("bending_anisotropy", "clearance_play"),
        off={"mu": 0.0},
        strength=("mu",),
        typical={"mu": 0.1},
    )

    mu: float = parameter(0.0, unit="1", low=0.0, high=2.0, source="off; 0.02-0.1: 1 to 28 degrees at 48.7 kPa")
    presliding_deg: float = parameter(0.05, unit="deg", low=1e-4, high=10.0, prior=True)

    def compile(self) -> TorsionalWindupParameters:
        """Return the SI parameters."""
        return TorsionalWindupParameters(self.mu, math.radians(self.presliding_deg))


@njit
def compute_torque_limit(parameters: TorsionalWindupParameters, pressure: float, radius: float) -> float:
    """Return the largest friction torque per length [N] on a catheter of ``radius`` [m] at ``pressure`` [Pa]."""
    return parameters.mu * max(pressure, 0.0) * 2.0 * math.pi * radius * radius


@njit
def compute_roll_friction(limit: float, angle: float, presliding: float) -> tuple[float, float, float]:
    """Return energy [J], torque [N m] and stiffness [N m] of friction with the torque ``limit`` [N m].

    Args:
        limit: Largest torque [N m].
        angle: From where the catheter sticks [rad].
        presliding: Angle at which it slides [rad].
    """
    if abs(angle) < presliding:
        stiffness = limit / presliding
        return 0.5 * stiffness * angle * angle, stiffness * angle, stiffness
    return limit * (abs(angle) - 0.5 * presliding), math.copysign(limit, angle), 0.0
