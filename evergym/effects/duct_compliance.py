"""Duct compliance: the tissue around a duct as a bed of springs that stiffen with depth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit
from evergym.units import KPA, MM

__all__ = ["DuctCompliance", "DuctComplianceParameters", "compute_wall_force"]


class DuctComplianceParameters(NamedTuple):
    """SI parameters: stiffness per length [Pa], stiffening depth [m], damping time [s], stiffness of pegs [Pa]."""

    stiffness: float
    depth: float
    damping_time: float
    peg_stiffness: float


@dataclass(frozen=True)
class DuctCompliance:
    """Force per length of robot = k' delta (1 + (delta / depth)^2), k' of the order of the tissue's modulus.

    A wall that nothing indents is the limit of a small compliance; at exactly zero compliance the wall is as rigid as
    a peg. The damping acts while the wall is pressed in, and never pulls.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=25,
        acts_on="state",
        moves=("tip_x_mm", "tip_y_mm", "curvature_1_per_m"),
        depends_on=("pressure",),
        partners=("contact_friction",),
        off={"compliance_1_per_kpa": 0.0},
        strength=("compliance_1_per_kpa",),
        typical={"compliance_1_per_kpa": 0.1},
    )

    compliance_1_per_kpa: float = parameter(
        1.0 / 30.0,
        unit="1/kPa",
        low=0.0,
        high=10.0,
        prior=True,
        source="1 / 30 kPa: duct wall 10-100 (no measurement found); fat 1-10, fibrous tissue 30-100 (Krouskop 1998)",
    )
    stiffening_depth_mm: float = parameter(
        0.5,
        unit="mm",
        low=0.01,
        high=100.0,
        prior=True,
        source="soft tissue stiffens several-fold within its strain of 0.5",
    )
    damping_time_s: float = parameter(
        0.05, unit="s", low=0.0, high=10.0, prior=True, source="tissue relaxation, short part"
    )
    peg_stiffness_mpa: float = parameter(
        2.0,
        unit="MPa",
        low=0.01,
        high=1e4,
        prior=True,
        help="Numerical: rigid pegs; 10 mN dent them by some micrometres.",
    )

    def compile(self) -> DuctComplianceParameters:
        """Return the SI parameters."""
        peg = self.peg_stiffness_mpa * 1e6
        if self.compliance_1_per_kpa == 0.0:
            # As a peg: a linear spring without damping.
            return DuctComplianceParameters(peg, math.inf, 0.0, peg)
        stiffness = min(KPA / self.compliance_1_per_kpa, peg)
        return DuctComplianceParameters(stiffness, self.stiffening_depth_mm * MM, self.damping_time_s, peg)


@njit
def compute_wall_force(stiffness: float, stiffening_depth: float, depth: float) -> tuple[float, float, float]:
    """Return energy [J], force [N] and stiffness [N/m] of a spring bed indented by ``depth`` [m] > 0.

    Args:
        stiffness: Initial stiffness of the bed under this section [N/m].
        stiffening_depth: Depth at which the force is twice the linear one [m].
        depth: Indentation [m].
    """
    square = (depth / stiffening_depth) ** 2
    energy = stiffness * depth * depth * (0.5 + 0.25 * square)
    return energy, stiffness * depth * (1.0 + square), stiffness * (1.0 + 3.0 * square)
