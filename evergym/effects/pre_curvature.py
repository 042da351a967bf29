"""Pre-curvature: the catheter's unloaded shape, set into the rest lengths of its fibres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from evergym.config import parameter
from evergym.effects.information import EffectInfo

__all__ = ["PreCurvature"]


@dataclass(frozen=True)
class PreCurvature:
    """The flexible part of the catheter is bent towards the tendon side when nothing loads it. Off at zero.

    Acts through the rest lengths of the catheter's fibres (see `evergym.lattice`).
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=14,
        acts_on="lattice",
        moves=("curvature_1_per_m", "tip_x_mm", "tip_angle_deg"),
        depends_on=("orientation",),
        partners=("wall_pretension", "saline_weight"),
        off={"curvature_1_per_m": 0.0},
        strength=("curvature_1_per_m",),
        typical={"curvature_1_per_m": 2.2},
    )

    curvature_1_per_m: float = parameter(
        2.2, unit="1/m", low=-100.0, high=100.0, source="the paper: 12 degrees over 95 mm, subtracted in its plots"
    )
