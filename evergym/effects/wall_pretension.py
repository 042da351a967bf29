"""Wall pre-tension: the everted wall is shorter on one side, or its thrust off the axis, and bends the robot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit
from evergym.units import KPA, MM

__all__ = ["WallPretension", "WallPretensionParameters", "compute_pretension_moment"]


class WallPretensionParameters(NamedTuple):
    """SI parameters: moment [N m], eccentricity [m], step of the moment [N m] at [Pa] over [Pa], direction [1]."""

    moment: float
    eccentricity: float
    step_moment: float
    step_pressure: float
    step_width: float
    cosine: float
    sine: float


@dataclass(frozen=True)
class WallPretension:
    """A bias moment M = M_0 + p A e + M_1 / (1 + exp(-(p - p_1) / w)) along the everted wall, fixed in the sheath.

    The step stands for a wall that grips only once the pressure has everted it tight. Positive moments bend towards
    the direction, counted from +x (the tendon's side at zero roll) to +y. Off when all three strengths are zero.
    Source: the paper suspects it for Fig. 11a; its data show a step between 110 and 120 kPa of 2.0e-4 to 2.6e-4 N m.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=19,
        acts_on="state",
        moves=("curvature_1_per_m", "tip_x_mm", "tip_y_mm"),
        depends_on=("pressure", "orientation"),
        partners=("pre_curvature", "pressure_bias", "saline_weight"),
        off={"moment_n_m": 0.0, "eccentricity_mm": 0.0, "step_moment_n_m": 0.0},
        strength=("eccentricity_mm",),
        typical={"eccentricity_mm": 0.7},
    )

    moment_n_m: float = parameter(0.0, unit="N m", low=-1.0, high=1.0, source="off")
    eccentricity_mm: float = parameter(
        0.0, unit="mm", low=-50.0, high=50.0, source="off; 0.7 mm would give Fig. 11's bias over 40 kPa"
    )
    step_moment_n_m: float = parameter(0.0, unit="N m", low=-1.0, high=1.0, source="off; Fig. 11: -2.0e-4 to -2.6e-4")
    step_pressure_kpa: float = parameter(
        13.7, unit="kPa", low=0.0, high=1e4, source="between 8.7 and 18.7 kPa, the paper's Fig. 11a,b"
    )
    step_width_kpa: float = parameter(1.0, unit="kPa", low=0.01, high=1e3, prior=True)
    direction_deg: float = parameter(0.0, unit="deg", low=-360.0, high=360.0, source="in the bend plane, Fig. 11a,b")

    def compile(self) -> WallPretensionParameters:
        """Return the SI parameters."""
        angle = math.radians(self.direction_deg)
        return WallPretensionParameters(
            self.moment_n_m,
            self.eccentricity_mm * MM,
            self.step_moment_n_m,
            self.step_pressure_kpa * KPA,
            self.step_width_kpa * KPA,
            math.cos(angle),
            math.sin(angle),
        )


@njit
def compute_pretension_moment(parameters: WallPretensionParameters, pressure: float, area: float) -> float:
    """Return the bias moment [N m] at ``pressure`` [Pa] of a sheath of cross-section ``area`` [m^2]."""
    moment = parameters.moment + max(pressure, 0.0) * area * parameters.eccentricity
    if parameters.step_moment != 0.0:
        excess = (parameters.step_pressure - pressure) / parameters.step_width
        moment += parameters.step_moment / (1.0 + math.exp(min(excess, 500.0)))
    return moment
