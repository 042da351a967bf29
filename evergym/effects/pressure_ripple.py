"""Pressure ripple: the supply swings about its set point, as a regulator's pulses make it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit
from evergym.units import KPA

__all__ = ["PressureRipple", "PressureRippleParameters", "compute_ripple"]


class PressureRippleParameters(NamedTuple):
    """SI parameters: amplitude [Pa] and frequency [Hz]."""

    amplitude: float
    frequency: float


@dataclass(frozen=True)
class PressureRipple:
    """The supply is the set point plus amplitude sin(2 pi f t), while there is pressure. Off at zero amplitude.

    What reaches the sheath is smoothed by `pressure_lag`. Source: pulses of 1.3 s of the 2021 robot's pump.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=22,
        acts_on="state",
        moves=("growth_speed_mm_s", "everted_length_mm", "pressure_measured_kpa"),
        depends_on=("pressure", "rate"),
        partners=("pressure_lag", "pressure_droop"),
        off={"amplitude_kpa": 0.0},
        strength=("amplitude_kpa", "frequency_hz"),
        typical={"amplitude_kpa": 4.0, "frequency_hz": 0.5},
    )

    amplitude_kpa: float = parameter(0.0, unit="kPa", low=0.0, high=1000.0, source="off")
    frequency_hz: float = parameter(0.77, unit="Hz", low=0.0, high=100.0, source="1 / 1.3 s, the 2021 robot's pulses")

    def compile(self) -> PressureRippleParameters:
        """Return the SI parameters."""
        return PressureRippleParameters(self.amplitude_kpa * KPA, self.frequency_hz)


@njit
def compute_ripple(parameters: PressureRippleParameters, time: float, set_point: float) -> float:
    """Return the swing of the supply [Pa] at ``time`` [s]."""
    if parameters.amplitude == 0.0 or set_point <= 0.0:
        return 0.0
    return parameters.amplitude * math.sin(2.0 * math.pi * parameters.frequency * time)
