"""Tendon friction: the catheter's bends hold the tendon back, so that tension is lost on the way to the tip."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit
from evergym.units import MM

__all__ = ["TendonFriction", "TendonFrictionParameters", "compute_rubbing_tendon", "compute_slide"]

# Gauss-Legendre rule of five points on [0, 1]: exact to 1e-12 for the exponents met here.
_X1 = 0.5 - 0.45308992296933193
_X2 = 0.5 - 0.26923465505284155
_W0 = 0.28444444444444444
_W1 = 0.23931433524968324
_W2 = 0.11846344252809454


class TendonFrictionParameters(NamedTuple):
    """SI parameters: coefficient [1] and presliding distance [m]."""

    mu: float
    presliding: float


@dataclass(frozen=True)
class TendonFriction:
    """Of the drive's tension T the catheter feels T exp(-mu theta) while it is pulled, T exp(mu theta) while paid out.

    theta is the summed bend of the catheter. On a reversal the tendon first sticks: it gives way elastically over the
    presliding distance (Dahl). The loss is taken at the catheter's base, so the bend stays uniform. Off at mu = 0.
    Source: Kaneko et al. 1991, Camarillo et al. 2008 for capstan friction of tendons.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=11,
        acts_on="state",
        moves=("curvature_1_per_m", "tip_x_mm", "tip_angle_deg"),
        depends_on=("history",),
        partners=("tendon_backlash", "tendon_stretch"),
        off={"mu": 0.0},
        strength=("mu",),
        typical={"mu": 0.15},
    )

    mu: float = parameter(0.0, unit="1", low=0.0, high=2.0, source="off; 0.05-0.3 in the literature of tendon drives")
    presliding_mm: float = parameter(
        0.02, unit="mm", low=1e-4, high=1.0, prior=True, help="Motion of the tendon over which friction turns round."
    )

    def compile(self) -> TendonFrictionParameters:
        """Return the SI parameters."""
        return TendonFrictionParameters(self.mu, self.presliding_mm * MM)


@njit
def compute_slide(path: float, start: float, slide: float, presliding: float) -> float:
    """Return the state of friction, -1 (paid out) to 1 (pulled), at a ``path`` [m] from that at ``start`` [m]."""
    return min(max(slide + (path - start) / presliding, -1.0), 1.0)


@njit
def _integrate(
    exponent: float, pull: float, low: float, high: float, start: float, slide: float, width: float
) -> float:
    """Return the integral of (pull - u) exp(-exponent slide(u)) for u from low to high [m^2]; low <= high <= pull."""
    total = 0.0
    first = start - (1.0 + slide) * width
    last = start + (1.0 - slide) * width
    end = min(high, first)
    if end > low:
        total += math.exp(exponent) * 0.5 * ((pull - low) ** 2 - (pull - end) ** 2)
    begin = max(low, last)
    if high > begin:
        total += math.exp(-exponent) * 0.5 * ((pull - begin) ** 2 - (pull - high) ** 2)
    begin = max(low, first)
    end = min(high, last)
    if end > begin:
        length = end - begin
        part = 0.0
        for x, weight in ((0.5, _W0), (_X1, _W2), (_X2, _W1), (1.0 - _X2, _W1), (1.0 - _X1, _W2)):
            u = begin + x * length
            part += weight * (pull - u) * math.exp(-exponent * (slide + (u - start) / width))
        total += part * length
    return total


@njit
def compute_rubbing_tendon(
    exponent: float, pull: float, path: float, start: float, slide: float, presliding: float, compliance: float
) -> tuple[float, float, float]:
    """Return energy [J], tension in the catheter [N] and compliance [m/N] of a taut tendon that rubs.

    Args:
        exponent: mu theta.
        pull: That reaches the tendon [m].
        path: By which the catheter's bend shortens the tendon [m], below ``pull``.
        start: Path at the step's start [m].
        slide: State of friction at the step's start, -1 to 1.
        presliding: [m].
        compliance: Of the line [m/N].
    """
    origin = min(start, pull)
    if path >= origin:
        work = _integrate(exponent, pull, origin, path, start, slide, presliding)
    else:
        work = -_integrate(exponent, pull, path, origin, start, slide, presliding)
    energy = (0.5 * (pull - origin) ** 2 - work) / compliance
    now = slide + (path - start) / presliding
    share = math.exp(-exponent * min(max(now, -1.0), 1.0))
    tension = (pull - path) / compliance
    stiffness = share / compliance
    if -1.0 < now < 1.0:
        stiffness += tension * share * exponent / presliding
    return energy, tension * share, 1.0 / stiffness
