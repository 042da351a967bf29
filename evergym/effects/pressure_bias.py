"""Pressure bias: the gauge reads too much, and the regulator, which trusts it, gives too little."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.units import KPA

__all__ = ["PressureBias", "PressureBiasParameters"]


class PressureBiasParameters(NamedTuple):
    """SI parameters: bias [Pa]."""

    bias: float


@dataclass(frozen=True)
class PressureBias:
    """The gauge reads p + bias, so a set point s gives s - bias (never below zero). Off at zero.

    The measured pressure looks right, everything that depends on the pressure is shifted. Source: this project;
    gauges of this range are off by 1 to 3 kPa.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=23,
        acts_on="sensor",
        moves=("everted_length_mm", "growth_speed_mm_s", "curvature_1_per_m"),
        depends_on=("pressure",),
        partners=("eversion_yield", "wall_pretension", "pressure_leak"),
        off={"bias_kpa": 0.0},
        strength=("bias_kpa",),
        typical={"bias_kpa": 3.0},
    )

    bias_kpa: float = parameter(0.0, unit="kPa", low=-100.0, high=100.0, source="off; 1-3 kPa is usual")

    def compile(self) -> PressureBiasParameters:
        """Return the SI parameters."""
        return PressureBiasParameters(self.bias_kpa * KPA)
