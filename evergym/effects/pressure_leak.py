"""Pressure leak: a share of the regulator's pressure is lost through a leak before it reaches the sheath."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo

__all__ = ["PressureLeak", "PressureLeakParameters"]


class PressureLeakParameters(NamedTuple):
    """Parameters: share [1] of the set point that is lost."""

    share: float


@dataclass(frozen=True)
class PressureLeak:
    """A steady leak behind a line with resistance: p = (1 - share) of what the regulator holds. Off at zero.

    Source: this project; line and leak as two flow resistances in series.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=22,
        acts_on="state",
        moves=("everted_length_mm", "growth_speed_mm_s", "pressure_measured_kpa"),
        depends_on=("pressure",),
        partners=("pressure_bias", "tail_coulomb_friction"),
        off={"share": 0.0},
        strength=("share",),
        typical={"share": 0.15},
    )

    share: float = parameter(0.0, unit="1", low=0.0, high=0.99, source="off")

    def compile(self) -> PressureLeakParameters:
        """Return the parameters."""
        return PressureLeakParameters(self.share)
