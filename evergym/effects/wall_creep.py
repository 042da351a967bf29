"""Wall creep: a film that is held bent yields slowly and takes the bend as its own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit

__all__ = ["WallCreep", "WallCreepParameters", "compute_crept_curvature"]


class WallCreepParameters(NamedTuple):
    """Parameters: share [1] of the strain that creep takes over in the end, and its time constant [s]."""

    share: float
    time: float


@dataclass(frozen=True)
class WallCreep:
    """The wall's rest curvature follows its curvature: dc/dt = (share kappa - c) / time (one Prony term).

    The sheath's fibres are stretched by the curvature less the crept one. Off at zero share. Source: LDPE film loses
    20 to 50 % of its modulus over 1e3 to 1e4 s; Findley's law for its form, of which this is one term.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=20,
        acts_on="state",
        moves=("curvature_1_per_m", "tip_y_mm", "bending_angle_deg"),
        depends_on=("history", "pressure"),
        partners=("root_kink", "wall_wrinkling", "tendon_backlash"),
        off={"share": 0.0},
        strength=("share", "time_s"),
        typical={"share": 0.5, "time_s": 5.0},
    )

    share: float = parameter(0.0, unit="1", low=0.0, high=1.0, source="off; 0.2-0.5 for LDPE")
    time_s: float = parameter(1000.0, unit="s", low=0.1, high=1e7, source="1e3 to 1e4 s for LDPE film")

    def compile(self) -> WallCreepParameters:
        """Return the parameters."""
        return WallCreepParameters(self.share, self.time_s)


@njit
def compute_crept_curvature(parameters: WallCreepParameters, crept: float, curvature: float, dt: float) -> float:
    """Return the crept curvature [1/m] after ``dt`` [s] at a constant ``curvature`` [1/m]; exact for any step."""
    target = parameters.share * curvature
    return target + (crept - target) * math.exp(-dt / parameters.time)
