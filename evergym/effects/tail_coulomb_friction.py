"""Tail friction: the tail loses pressure along its length, in one of three laws that Fig. 8 cannot tell apart."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit
from evergym.units import KPA, MM

__all__ = ["TailCoulombFriction", "TailCoulombFrictionParameters", "compute_tail_loss"]

FEED_REFERENCE = 2.9e-3
"""Feed speed V1 at which the friction was fitted [m/s] (paper, Fig. 8)."""


class TailCoulombFrictionParameters(NamedTuple):
    """SI parameters: gradient [Pa/m], share of the pressure [1/m], growth of the yield [1/m], exponent [1]."""

    gradient: float
    pressure_gradient: float
    yield_growth: float
    speed_exponent: float


@dataclass(frozen=True)
class TailCoulombFriction:
    """Loss = f L + m p L + Y (exp(g L) - 1), its coefficients falling with the feed speed as (V / 2.9 mm/s)^-b.

    Off when all three coefficients are zero. The default is the exponential (capstan-like) law; the constant and the
    pressure-proportional law fit Fig. 8 as well and are kept as model files. The exponential law keeps the observed
    threshold.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=4,
        acts_on="state",
        moves=("everted_length_mm", "growth_speed_mm_s"),
        depends_on=("pressure", "rate", "length", "history"),
        partners=("tail_catheter_friction", "tail_capstan_friction", "eversion_yield"),
        off={"gradient_kpa_per_mm": 0.0, "pressure_gradient_per_mm": 0.0, "yield_growth_per_mm": 0.0},
        strength=("gradient_kpa_per_mm",),
        typical={"gradient_kpa_per_mm": 0.5},
    )

    gradient_kpa_per_mm: float = parameter(
        0.0, unit="kPa/mm", low=0.0, high=10.0, source="constant law: 0.64 +- 0.06 at V1 (with no yield)"
    )
    pressure_gradient_per_mm: float = parameter(
        0.0, unit="1/mm", low=0.0, high=1.0, source="pressure-proportional law: 0.0100 +- 0.0009 at V1 (yield 12.8 kPa)"
    )
    yield_growth_per_mm: float = parameter(
        0.0217, unit="1/mm", low=0.0, high=1.0, source="exponential law: 0.0217 +- 0.0024 at V1 (yield 9.9 kPa)"
    )
    speed_exponent: float = parameter(
        0.33, unit="1", low=0.0, high=1.0, source="0.33 +- 0.10, fitted to V1 and V2 of Fig. 8 with the exponential law"
    )

    def compile(self) -> TailCoulombFrictionParameters:
        """Return the SI parameters."""
        return TailCoulombFrictionParameters(
            self.gradient_kpa_per_mm * KPA / MM,
            self.pressure_gradient_per_mm / MM,
            self.yield_growth_per_mm / MM,
            self.speed_exponent,
        )


@njit
def compute_tail_loss(
    parameters: TailCoulombFrictionParameters, length: float, pressure: float, yield_pressure: float, feed_speed: float
) -> float:
    """Return the pressure [Pa] lost to friction along a tail of ``length`` [m].

    The law was fitted at feed speeds of 2.9 and 5.8 mm/s; slower or no feed counts as 2.9 mm/s rather than being
    extrapolated.
    """
    if parameters.gradient == 0.0 and parameters.pressure_gradient == 0.0 and parameters.yield_growth == 0.0:
        return 0.0
    scale = 1.0
    if parameters.speed_exponent > 0.0 and feed_speed > FEED_REFERENCE:
        scale = (feed_speed / FEED_REFERENCE) ** (-parameters.speed_exponent)
    loss = scale * length * (parameters.gradient + parameters.pressure_gradient * pressure)
    if parameters.yield_growth > 0.0:
        loss += yield_pressure * (math.exp(min(scale * parameters.yield_growth * length, 50.0)) - 1.0)
    return loss
