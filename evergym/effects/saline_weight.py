"""Saline weight: gravity on the fluid that fills the sheath, on the wall and on the catheter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo

__all__ = ["SalineWeight", "SalineWeightParameters"]


class SalineWeightParameters(NamedTuple):
    """Parameters: share [1] of the robot's weight that acts."""

    share: float


@dataclass(frozen=True)
class SalineWeight:
    """The weight per length of fluid, wall, tail and catheter acts on every section. Off at zero share.

    Source: the paper's saline-filled sheath; 0.072 N/m (sheath), 0.074 N/m (full system) from its dimensions.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=18,
        acts_on="state",
        moves=("tip_y_mm", "bending_angle_deg"),
        depends_on=("orientation", "length"),
        partners=("wall_pretension", "pre_curvature"),
        off={"share": 0.0},
        strength=("share",),
        typical={"share": 1.0},
    )

    share: float = parameter(1.0, unit="1", low=0.0, high=2.0, source="all of it")

    def compile(self) -> SalineWeightParameters:
        """Return the parameters."""
        return SalineWeightParameters(self.share)
