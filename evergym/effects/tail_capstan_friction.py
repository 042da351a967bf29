"""Capstan friction: the tail's tension grows exponentially with the angle that its path turns through."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit

__all__ = ["TailCapstanFriction", "TailCapstanFrictionParameters", "compute_capstan_factor"]


class TailCapstanFrictionParameters(NamedTuple):
    """Parameters: friction coefficient [1]."""

    mu: float


@dataclass(frozen=True)
class TailCapstanFriction:
    """F_out = F_in exp(mu * turn angle): every pressure loss of the tail is multiplied by the factor. Off at zero
    ``mu``.

    Source: Blumenschein et al. 2017 (Living Machines).
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=6,
        acts_on="state",
        moves=("everted_length_mm", "growth_speed_mm_s"),
        depends_on=("orientation", "length"),
        partners=("tail_coulomb_friction", "viscous_eversion"),
        off={"mu": 0.0},
        strength=("mu",),
        typical={"mu": 0.3},
    )

    mu: float = parameter(
        0.05,
        unit="1",
        low=0.0,
        high=1.0,
        prior=True,
        source="low end of 0.05-0.3, wet low-density polyethylene on itself",
    )

    def compile(self) -> TailCapstanFrictionParameters:
        """Return the parameters."""
        return TailCapstanFrictionParameters(self.mu)


@njit
def compute_capstan_factor(parameters: TailCapstanFrictionParameters, turn_angle: float) -> float:
    """Return F_out / F_in [1] over a path that turns by ``turn_angle`` [rad] in sum; 1 exactly when off."""
    if parameters.mu == 0.0:
        return 1.0
    return math.exp(parameters.mu * turn_angle)
