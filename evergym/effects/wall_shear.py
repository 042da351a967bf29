"""Wall shear: an inflated tube without a catheter gives way sideways as a whole, beside bending."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit

__all__ = ["WallShear", "WallShearParameters", "compute_shear_stiffness"]


class WallShearParameters(NamedTuple):
    """SI parameters: whether it acts, and the film's share G pi R t of the stiffness [N]."""

    enabled: bool
    film: float


@dataclass(frozen=True)
class WallShear:
    """A switch: sections of sheath without catheter slide by V / (p A + G pi R t) under the shear force V.

    The shear force is the last step's, so the slide lags by one step. Negligible at the robot's slenderness (0.2 % at
    95 mm), so a good decoy. Source: Fichter 1966, NASA TN D-3466.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=8,
        acts_on="state",
        moves=("tip_x_mm", "tip_y_mm"),
        depends_on=("pressure",),
        partners=("wall_wrinkling", "wall_compliance"),
        off={"enabled": False},
        strength=("enabled",),
        typical={"enabled": True},
    )

    enabled: bool = parameter(False, source="off: 0.2 % of the deflection at 95 mm")

    def compile(self, radius: float, wall: float, modulus: float, poisson_ratio: float) -> WallShearParameters:
        """Return the SI parameters of a sheath of ``radius`` and ``wall`` [m] with ``modulus`` [Pa]."""
        return WallShearParameters(self.enabled, modulus / (2.0 * (1.0 + poisson_ratio)) * math.pi * radius * wall)


@njit
def compute_shear_stiffness(parameters: WallShearParameters, thrust: float) -> float:
    """Return the shear stiffness [N] of a sheath whose pressure pushes with ``thrust`` [N]."""
    return thrust + parameters.film
