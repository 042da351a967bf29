"""Eversion yield: the pressure that folding the wall over at the tip takes before, and while, the tip moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit
from evergym.units import KPA

__all__ = ["EversionYield", "EversionYieldParameters", "compute_yield_pressure"]


class EversionYieldParameters(NamedTuple):
    """SI parameters: yield pressures [Pa] at rest and in motion."""

    static: float
    kinetic: float


@dataclass(frozen=True)
class EversionYield:
    """Growth starts above the static yield pressure and stops below the kinetic one.

    Off at zero. Source: Blumenschein et al. 2017 (Living Machines) for the form.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=1,
        acts_on="state",
        moves=("everted_length_mm", "growth_speed_mm_s"),
        depends_on=("pressure", "history"),
        partners=("pressure_bias", "pressure_droop", "tail_coulomb_friction"),
        off={"static_kpa": 0.0, "kinetic_kpa": 0.0},
        strength=("static_kpa", "kinetic_kpa"),
        typical={"static_kpa": 13.7, "kinetic_kpa": 9.9},
    )

    static_kpa: float = parameter(
        13.7,
        unit="kPa",
        low=0.0,
        high=1000.0,
        source="middle of 8.7-18.7 kPa: the paper's Fig. 8 grows at 120, not at 110 kPa",
    )
    kinetic_kpa: float = parameter(
        9.9, unit="kPa", low=0.0, high=1000.0, source="exponential growth law fitted to the paper's Fig. 8: 9.9 +- 1.0"
    )

    def compile(self) -> EversionYieldParameters:
        """Return the SI parameters; the static yield is never below the kinetic one."""
        return EversionYieldParameters(max(self.static_kpa, self.kinetic_kpa) * KPA, self.kinetic_kpa * KPA)


@njit
def compute_yield_pressure(parameters: EversionYieldParameters, moving: bool) -> float:
    """Return the yield pressure [Pa] of a tip that moves or rests."""
    return parameters.kinetic if moving else parameters.static
