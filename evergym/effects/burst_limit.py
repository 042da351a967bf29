"""Burst limit: the gauge pressure at which the sheath fails."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit
from evergym.units import KPA

__all__ = ["BurstLimit", "BurstLimitParameters", "has_burst"]


class BurstLimitParameters(NamedTuple):
    """SI parameters: burst pressure [Pa]; zero: never."""

    pressure: float


@dataclass(frozen=True)
class BurstLimit:
    """The sheath bursts, for good, once its pressure passes the limit. Off at zero."""

    info: ClassVar[EffectInfo] = EffectInfo(
        row=9,
        acts_on="state",
        moves=("pressure_measured_kpa", "everted_length_mm"),
        depends_on=("pressure", "history"),
        partners=("pressure_leak",),
        off={"pressure_kpa": 0.0},
        strength=("pressure_kpa",),
        typical={"pressure_kpa": 45.0},
    )

    pressure_kpa: float = parameter(
        60.0,
        unit="kPa",
        low=0.0,
        high=1e4,
        prior=True,
        source='the paper: "much above" 50 kPa gauge the sheath sometimes bursts; the hoop yield would allow 190 kPa',
    )

    def compile(self) -> BurstLimitParameters:
        """Return the SI parameters."""
        return BurstLimitParameters(self.pressure_kpa * KPA)


@njit
def has_burst(parameters: BurstLimitParameters, pressure: float) -> bool:
    """Return whether the sheath fails at ``pressure`` [Pa]."""
    return parameters.pressure > 0.0 and pressure > parameters.pressure
