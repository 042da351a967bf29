"""Wall wrinkling: the film carries no compression, so an inflated wall wrinkles, softens and collapses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from evergym.config import parameter
from evergym.effects.information import EffectInfo

__all__ = ["WallWrinkling", "compute_collapse_curve"]


@dataclass(frozen=True)
class WallWrinkling:
    """A switch of the lattice: the sheath's fibres carry tension only (on) or tension and compression (off).

    With tension-only fibres the law of Comer and Levy emerges: linear up to pi p R^3 / 2, collapse at pi p R^3.
    Source: Comer & Levy 1963, AIAA J 1:1652.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=7,
        acts_on="lattice",
        moves=("curvature_1_per_m", "tip_x_mm", "tip_y_mm"),
        depends_on=("pressure",),
        partners=("root_kink", "wall_creep"),
        off={"enabled": False},
        strength=("enabled",),
        typical={"enabled": True},
    )

    enabled: bool = parameter(True, source="a film of 35 um buckles at once")


def compute_collapse_curve(wrinkle_angle: float) -> tuple[float, float]:
    """Return Comer and Levy's M / (pi p R^3) and kappa / kappa_w of a tube wrinkled over ``wrinkle_angle`` [rad].

    The closed form that the lattice is held to; no kernel uses it. The angle runs from 0 (onset) to pi (collapse).

    Source: Comer & Levy 1963, AIAA J 1:1652.
    """
    a = wrinkle_angle
    denominator = math.sin(a) + (math.pi - a) * math.cos(a)
    moment = (2.0 * math.pi - 2.0 * a + math.sin(2.0 * a)) / (4.0 * denominator)
    return moment, math.pi / denominator
