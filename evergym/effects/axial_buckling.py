"""Axial buckling: a push along the robot bends it sideways once it exceeds Euler's load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo

__all__ = ["AxialBuckling", "AxialBucklingParameters"]


class AxialBucklingParameters(NamedTuple):
    """Whether it acts."""

    enabled: bool


@dataclass(frozen=True)
class AxialBuckling:
    """A switch. On: it emerges from the exact kinematics. Off: the robot carries any push of the tip load along itself.

    Off, the part of the tip load that presses along the port's axis is taken by the inextensible axis without bending
    it, so nothing amplifies or buckles. Contact forces keep their moment. Source: Haggerty et al.
    2019; Euler's loads in `tests/physics`.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=10,
        acts_on="state",
        moves=("tip_x_mm", "tip_y_mm", "curvature_1_per_m"),
        depends_on=("length",),
        partners=("bending_anisotropy", "wall_wrinkling"),
        off={"enabled": False},
        strength=("enabled",),
        typical={"enabled": True},
    )

    enabled: bool = parameter(True, source="a slender rod")

    def compile(self) -> AxialBucklingParameters:
        """Return the parameters."""
        return AxialBucklingParameters(self.enabled)
