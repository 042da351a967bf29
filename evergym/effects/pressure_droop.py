"""Pressure droop: growth drains the sheath faster than the supply fills it, so the pressure falls with the speed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit
from evergym.units import KPA, MM

__all__ = ["PressureDroop", "PressureDroopParameters", "compute_droop"]

DROOP_TIME_MIN = 0.05
"""Shortest time in which droop follows the growth rate [s]."""


class PressureDroopParameters(NamedTuple):
    """SI parameters: loss per growth rate [Pa s/m]."""

    resistance: float


@dataclass(frozen=True)
class PressureDroop:
    """p = supply - resistance x growth rate, with the time constant of `pressure_lag` (at least 50 ms). Off at zero.

    Source: this project, volume balance p' = (q_in - A v) / C_h with a supply of finite resistance; 1 mm of growth
    drops 9.7 kPa where 0.5 % of a 21.6 mL tank is air and nothing is made up.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=22,
        acts_on="state",
        moves=("growth_speed_mm_s", "everted_length_mm", "pressure_measured_kpa"),
        depends_on=("rate", "pressure"),
        partners=("eversion_yield", "viscous_eversion"),
        off={"resistance_kpa_s_mm": 0.0},
        strength=("resistance_kpa_s_mm",),
        typical={"resistance_kpa_s_mm": 5.0},
    )

    resistance_kpa_s_mm: float = parameter(0.0, unit="kPa s/mm", low=0.0, high=1e4, source="off")

    def compile(self) -> PressureDroopParameters:
        """Return the SI parameters."""
        return PressureDroopParameters(self.resistance_kpa_s_mm * KPA / MM)


@njit
def compute_droop(parameters: PressureDroopParameters, droop: float, rate: float, lag: float, dt: float) -> float:
    """Return the droop [Pa] after ``dt`` [s] at a growth ``rate`` [m/s]; ``lag`` is the supply's time constant [s]."""
    target = parameters.resistance * max(rate, 0.0)
    return target + (droop - target) * math.exp(-dt / max(lag, DROOP_TIME_MIN))
