"""Pre-curvature: the catheter's unloaded shape, set into the rest lengths of its fibres."""

from __future__ import annotations

from dataclasses import dataclass

from evergym.config import parameter

__all__ = ["PreCurvature"]


@dataclass(frozen=True)
class PreCurvature:
    """The flexible part of the catheter is bent towards the tendon side when nothing loads it. Off at zero.

    Acts through the rest lengths of the catheter's fibres (see `evergym.lattice`).
    """

    curvature_1_per_m: float = parameter(
        2.2, unit="1/m", low=-100.0, high=100.0, source="the paper: 12 degrees over 95 mm, subtracted in its plots"
    )
