"""Catheter protrusion: the catheter may slide out of the sheath's tip, and leads from there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from evergym.config import parameter
from evergym.effects.information import EffectInfo

__all__ = ["CatheterProtrusion"]


@dataclass(frozen=True)
class CatheterProtrusion:
    """A switch: the catheter may be longer than the everted sheath (on) or stops at its tip (off).

    With it the tip is the further of the sheath's and the catheter's, as in the duty cycle of the real robot.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=27,
        acts_on="lattice",
        moves=("tip_z_mm", "curvature_1_per_m"),
        depends_on=("length",),
        partners=("feed_limit",),
        off={"enabled": False},
        strength=("enabled",),
        typical={"enabled": True},
    )

    enabled: bool = parameter(True, source="the paper: after much growth the catheter protrudes beyond the sheath")
