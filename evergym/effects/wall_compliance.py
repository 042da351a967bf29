"""Wall compliance: pressure widens and lengthens the sheath a little."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit

__all__ = ["WallCompliance", "WallComplianceParameters", "compute_wall_stretch"]


class WallComplianceParameters(NamedTuple):
    """SI parameters: relative growth of radius and length per pressure [1/Pa]."""

    hoop: float
    axial: float


@dataclass(frozen=True)
class WallCompliance:
    """dR / R = p R (1 - nu / 2) / (E t), dL / L = p R (1 - 2 nu) / (2 E t), times the share. Off at zero.

    Thrust p A and the length outside follow; negligible at the robot's size, so a good decoy. Source: this project, a
    thin closed tube.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=21,
        acts_on="state",
        moves=("everted_length_mm", "curvature_1_per_m"),
        depends_on=("pressure", "length"),
        partners=("pressure_lag", "wall_pretension"),
        off={"share": 0.0},
        strength=("share",),
        typical={"share": 1.0},
    )

    share: float = parameter(0.0, unit="1", low=0.0, high=1000.0, source="off; 1 is the film's own compliance")

    def compile(self, radius: float, wall: float, modulus: float, poisson_ratio: float) -> WallComplianceParameters:
        """Return the SI parameters of a sheath of ``radius`` and ``wall`` [m] with ``modulus`` [Pa]."""
        strain = self.share * radius / (modulus * wall)
        return WallComplianceParameters(strain * (1.0 - 0.5 * poisson_ratio), strain * (0.5 - poisson_ratio))


@njit
def compute_wall_stretch(rate: float, pressure: float) -> float:
    """Return the factor [1] by which the wall grows under ``pressure`` [Pa]."""
    return 1.0 + rate * max(pressure, 0.0)
