"""Feed limit: the tail that the drive pays out, and its slip, bound the speed of the tip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit

__all__ = ["FeedLimit", "FeedLimitParameters", "compute_taut_speed"]


class FeedLimitParameters(NamedTuple):
    """Parameters: slip [1], the share of the drive's motion that does not move the tail."""

    slip: float


@dataclass(frozen=True)
class FeedLimit:
    """Everting 1 m of wall takes 2 m of tail, so the tip is never faster than V / 2 in the long run.

    A tail that the pressure draws taut slips in the drive, the more the nearer the tip comes to eta V, eta = (1 -
    slip) / 2: 1/v = 1/v_pressure + 1/(eta V). A tail that nothing draws is laid in at full pace as slack, and grown
    from later at the pressure's pace, as in the duty cycle. Off at zero slip: v = min(v_pressure, V / 2). Which drive
    the paper's feed speed names is not stated; the slip stands for that as well.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=3,
        acts_on="state",
        moves=("growth_speed_mm_s", "everted_length_mm"),
        depends_on=("rate",),
        partners=("viscous_eversion",),
        off={"slip": 0.0},
        strength=("slip",),
        typical={"slip": 0.5},
    )

    slip: float = parameter(
        0.492, unit="1", low=0.0, high=0.95, source="eta = 0.254: exponential growth law fitted to the paper's Fig. 8"
    )

    def compile(self) -> FeedLimitParameters:
        """Return the parameters."""
        return FeedLimitParameters(self.slip)


@njit
def compute_taut_speed(parameters: FeedLimitParameters, pressure_speed: float, feed_speed: float) -> float:
    """Return the tip speed [m/s] on a taut tail, from the pressure's and the feed's speed (both at the tip)."""
    if feed_speed <= 0.0 or pressure_speed <= 0.0:
        return 0.0
    if parameters.slip > 0.0:
        return 1.0 / (1.0 / pressure_speed + 1.0 / feed_speed)
    return min(pressure_speed, feed_speed)
