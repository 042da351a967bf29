"""Notch closure: bent far enough towards the tendon, the notches close and the catheter becomes stiff."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit

__all__ = ["NotchClosure", "NotchClosureParameters", "compute_closure"]


class NotchClosureParameters(NamedTuple):
    """SI parameters: curvature at which the notches close [1/m], added stiffness [N m^2]; no stiffness: off."""

    curvature: float
    stiffness: float


@dataclass(frozen=True)
class NotchClosure:
    """Beyond the closing curvature, towards the tendon only, the bending stiffness is higher by the given amount.

    The moment is continuous. Off at zero stiffness. Source: York et al. 2015 (notched wrists) for the mechanism; the
    paper's Fig. 11d, whose angles saturate at 80 to 82 degrees, for its presence.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=16,
        acts_on="lattice",
        moves=("curvature_1_per_m", "tip_x_mm", "tip_angle_deg"),
        depends_on=("orientation",),
        partners=("tendon_stretch", "tendon_friction"),
        off={"stiffness_n_m2": 0.0},
        strength=("curvature_1_per_m",),
        typical={"curvature_1_per_m": 9.0, "stiffness_n_m2": 2e-3},
    )

    curvature_1_per_m: float = parameter(
        15.0, unit="1/m", low=0.0, high=1000.0, prior=True, help="Including the pre-curvature."
    )
    stiffness_n_m2: float = parameter(
        0.0, unit="N m^2", low=0.0, high=10.0, source="off; at most the uncut tube's 6.5e-3"
    )

    def compile(self) -> NotchClosureParameters:
        """Return the parameters."""
        return NotchClosureParameters(self.curvature_1_per_m, self.stiffness_n_m2)


@njit
def compute_closure(parameters: NotchClosureParameters, bend: float, length: float) -> tuple[float, float, float]:
    """Return energy [J], moment [N m] and stiffness [N m] of the notches at a ``bend`` [rad] over ``length`` [m]."""
    excess = bend / length - parameters.curvature
    if parameters.stiffness == 0.0 or excess <= 0.0:
        return 0.0, 0.0, 0.0
    moment = parameters.stiffness * excess
    return 0.5 * moment * excess * length, moment, parameters.stiffness / length
