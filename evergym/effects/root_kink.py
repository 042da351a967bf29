"""Root kink: a sheath without a catheter hangs as a straight rod from a hinge at its root."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit

__all__ = ["RootKink", "RootKinkParameters", "compute_kink_moment"]


class RootKinkParameters(NamedTuple):
    """SI parameters: moment at no pressure [N m] and share of pi p R^3 [1]; both zero: off."""

    moment: float
    share: float


@dataclass(frozen=True)
class RootKink:
    """At the root the sheath bends at the moment M_h = M_0 + c pi p R^3, and is straight and stiff below it.

    The film's own resistance M_0 holds along the whole sheath, so that it does not collapse elsewhere. Off when both
    are zero.
    Source: the paper's Fig. 9, M_0 = 1.20e-4 +- 0.10e-4 N m and c = 0.305 +- 0.028 from its five points.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=9,
        acts_on="lattice",
        moves=("tip_y_mm", "bending_angle_deg"),
        depends_on=("pressure", "length", "history"),
        partners=("wall_wrinkling", "wall_creep"),
        off={"moment_n_m": 0.0, "pressure_share": 0.0},
        strength=("moment_n_m", "pressure_share"),
        typical={"moment_n_m": 0.00012, "pressure_share": 0.305},
    )

    moment_n_m: float = parameter(
        0.0, unit="N m", low=0.0, high=1.0, source="Fig. 9: 1.20e-4; off in the default model"
    )
    pressure_share: float = parameter(
        0.0, unit="1", low=0.0, high=2.0, source="Fig. 9: 0.305; off in the default model"
    )

    def compile(self) -> RootKinkParameters:
        """Return the parameters."""
        return RootKinkParameters(self.moment_n_m, self.pressure_share)


@njit
def compute_kink_moment(parameters: RootKinkParameters, pressure: float, radius: float) -> float:
    """Return the hinge moment [N m] of a sheath of ``radius`` [m] at ``pressure`` [Pa]."""
    return parameters.moment + parameters.share * math.pi * max(pressure, 0.0) * radius**3
