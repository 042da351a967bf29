"""Tendon stretch: the compliance of the tendon's line between the drive and the catheter's tip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo

__all__ = ["RIGID_LINE_COMPLIANCE", "TendonStretch", "TendonStretchParameters"]

RIGID_LINE_COMPLIANCE = 1e-9
"""Compliance of a line that does not stretch [m/N]: 4e-5 of the default line's, and below any reading."""


class TendonStretchParameters(NamedTuple):
    """SI parameters: compliance [m/N]."""

    compliance: float


@dataclass(frozen=True)
class TendonStretch:
    """pull = sum(arm * bend) + compliance * tension. Off at zero: the line is rigid.

    Source: slope of the paper's Fig. 7, 4.64 1/m per mm, where a rigid line would give 8 to 14.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=13,
        acts_on="state",
        moves=("curvature_1_per_m", "tip_x_mm", "tip_angle_deg"),
        depends_on=("pressure",),
        partners=("tendon_backlash", "tendon_friction", "notch_closure"),
        off={"compliance_mm_per_n": 0.0},
        strength=("compliance_mm_per_n",),
        typical={"compliance_mm_per_n": 0.26},
    )

    compliance_mm_per_n: float = parameter(
        0.2561, unit="mm/N", low=0.0, high=100.0, source="the paper's Figs. 6 and 7 with arm 0.75 mm: 0.26-0.29"
    )

    def compile(self) -> TendonStretchParameters:
        """Return the SI parameters."""
        return TendonStretchParameters(max(self.compliance_mm_per_n * 1e-3, RIGID_LINE_COMPLIANCE))
