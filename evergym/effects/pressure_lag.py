"""Pressure lag: the pressure in the sheath follows the regulator's set point with a delay of first order."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit

__all__ = ["PressureLag", "PressureLagParameters", "compute_lagged_pressure"]


class PressureLagParameters(NamedTuple):
    """SI parameters: time constant [s]."""

    time: float


@dataclass(frozen=True)
class PressureLag:
    """dp/dt = (set point - p) / time. Off at zero time."""

    info: ClassVar[EffectInfo] = EffectInfo(
        row=22,
        acts_on="state",
        moves=("growth_speed_mm_s", "everted_length_mm", "pressure_measured_kpa"),
        depends_on=("rate", "pressure"),
        partners=("wall_compliance", "pressure_droop", "pressure_ripple"),
        off={"time_s": 0.0},
        strength=("time_s",),
        typical={"time_s": 1.0},
    )

    time_s: float = parameter(
        0.15,
        unit="s",
        low=0.0,
        high=100.0,
        prior=True,
        source="air trapped in a 21.6 mL tank behind 4 mm x 0.3 m lines",
    )

    def compile(self) -> PressureLagParameters:
        """Return the parameters."""
        return PressureLagParameters(self.time_s)


@njit
def compute_lagged_pressure(parameters: PressureLagParameters, pressure: float, set_point: float, dt: float) -> float:
    """Return the pressure [Pa] after ``dt`` [s] at a constant set point [Pa]; exact for any step."""
    if parameters.time == 0.0:
        return set_point
    return set_point + (pressure - set_point) * math.exp(-dt / parameters.time)
