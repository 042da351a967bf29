"""Tail-on-catheter friction: pressure squeezes the tail onto the catheter that it slides along."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit

__all__ = ["TailCatheterFriction", "TailCatheterFrictionParameters", "compute_squeeze_loss"]


class TailCatheterFrictionParameters(NamedTuple):
    """Parameters: friction coefficient [1]."""

    mu: float


@dataclass(frozen=True)
class TailCatheterFriction:
    """F = mu p 2 pi r_c L_c, so the pressure lost is 2 mu r_c L_c / R^2 of p. Off at zero ``mu``.

    Source: law as in the simulation of the 2021 robot (mu = 0.01 coded there); range 0.005 to 0.1.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=5,
        acts_on="state",
        moves=("everted_length_mm", "growth_speed_mm_s"),
        depends_on=("pressure", "length"),
        partners=("tail_coulomb_friction", "tail_capstan_friction"),
        off={"mu": 0.0},
        strength=("mu",),
        typical={"mu": 0.01},
    )

    mu: float = parameter(
        0.005,
        unit="1",
        low=0.0,
        high=0.2,
        prior=True,
        source="low end of 0.005-0.1: Fig. 8's tail friction, fitted without it, holds a part of it already",
    )

    def compile(self) -> TailCatheterFrictionParameters:
        """Return the parameters."""
        return TailCatheterFrictionParameters(self.mu)


@njit
def compute_squeeze_loss(
    parameters: TailCatheterFrictionParameters,
    pressure: float,
    overlap: float,
    catheter_radius: float,
    sheath_radius: float,
) -> float:
    """Return the pressure [Pa] lost over the length ``overlap`` [m] along which the tail encloses the catheter."""
    if parameters.mu == 0.0:
        return 0.0
    return 2.0 * parameters.mu * pressure * catheter_radius * overlap / (sheath_radius * sheath_radius)
