"""Angle quantisation: angles are read to whole steps, as off a protractor in a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from evergym.config import parameter
from evergym.effects.information import EffectInfo

__all__ = ["AngleQuantisation"]


@dataclass(frozen=True)
class AngleQuantisation:
    """Tip angle and curvature are read to the nearest multiple of the step. Off at zero. Acts on the sensor only.

    Source: every curvature of the paper is a whole number of degrees over 95 mm.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=23,
        acts_on="sensor",
        moves=("curvature_1_per_m", "tip_angle_deg"),
        depends_on=(),
        partners=("tendon_backlash",),
        off={"step_deg": 0.0},
        strength=("step_deg",),
        typical={"step_deg": 5.0},
    )

    step_deg: float = parameter(0.0, unit="deg", low=0.0, high=45.0, source="off; 1 in the paper's readings")

    def read(self, angle_deg: float) -> float:
        """Return the angle as it is read [deg]."""
        return angle_deg if self.step_deg == 0.0 else round(angle_deg / self.step_deg) * self.step_deg
