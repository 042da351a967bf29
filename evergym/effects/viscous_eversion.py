"""Viscous eversion: the tip's speed grows with the pressure left after yield and friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit
from evergym.units import KPA, MM

__all__ = ["ViscousEversion", "ViscousEversionParameters", "compute_pressure_speed"]


class ViscousEversionParameters(NamedTuple):
    """SI parameters: resistance [Pa^n s/m], exponent n [1]; no resistance means no rate dependence."""

    resistance: float
    exponent: float


@dataclass(frozen=True)
class ViscousEversion:
    """v = (driving pressure)^n / resistance. Off at zero resistance: then only the feed limits the speed.

    Source: Blumenschein et al. 2017 (Living Machines); with mobility phi = 1 / resistance.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=2,
        acts_on="state",
        moves=("growth_speed_mm_s", "everted_length_mm"),
        depends_on=("pressure", "rate"),
        partners=("pressure_droop", "feed_limit"),
        off={"resistance_kpa_s_mm": 0.0},
        strength=("resistance_kpa_s_mm",),
        typical={"resistance_kpa_s_mm": 2.4},
    )

    resistance_kpa_s_mm: float = parameter(
        1.0 / 0.41,
        unit="kPa^n s/mm",
        low=0.0,
        high=1e4,
        source="1 / phi, phi = 0.41 +- 0.16 mm/s/kPa: exponential growth law fitted to the paper's Fig. 8",
    )
    exponent: float = parameter(1.0, unit="1", low=0.3, high=2.0, source="0.7-1.1; the fits of Fig. 8 use 1")

    def compile(self) -> ViscousEversionParameters:
        """Return the SI parameters; kPa^n s/mm becomes Pa^n s/m."""
        return ViscousEversionParameters(self.resistance_kpa_s_mm * KPA**self.exponent / MM, self.exponent)


@njit
def compute_pressure_speed(parameters: ViscousEversionParameters, pressure: float) -> float:
    """Return the tip speed [m/s] that a driving pressure [Pa] sustains; infinite where nothing resists."""
    if pressure <= 0.0:
        return 0.0
    if parameters.resistance <= 0.0:
        return 1e30
    if parameters.exponent == 1.0:
        return pressure / parameters.resistance
    return float(pressure**parameters.exponent / parameters.resistance)
