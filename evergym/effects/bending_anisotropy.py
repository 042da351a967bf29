"""Bending anisotropy: the notches let the catheter bend in one plane only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from evergym.config import parameter
from evergym.effects.information import EffectInfo

__all__ = ["BendingAnisotropy"]


@dataclass(frozen=True)
class BendingAnisotropy:
    """A switch of the lattice: the catheter's fibres are a soft and a stiff pair (on) or alike (off).

    The ratio is the robot's ``catheter_anisotropy``; the soft plane holds the tendon.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=15,
        acts_on="lattice",
        moves=("tip_x_mm", "tip_y_mm"),
        depends_on=("orientation",),
        partners=("torsional_windup",),
        off={"enabled": False},
        strength=("enabled",),
        typical={"enabled": True},
    )

    enabled: bool = parameter(True, source="the paper's Fig. 6: loads across the bend plane give almost no curvature")
