"""Tendon backlash: pull that is lost between the drive and the tendon, on every reversal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit
from evergym.units import MM

__all__ = ["TendonBacklash", "TendonBacklashParameters", "compute_transmitted_pull"]


class TendonBacklashParameters(NamedTuple):
    """SI parameters: width of the play [m] and slack to be taken up once [m]."""

    backlash: float
    lost_motion: float


@dataclass(frozen=True)
class TendonBacklash:
    """A play operator of width b between drive and tendon, after a fixed lost motion in the assembled robot.

    Until both are taken up the tendon is slack, also where a load bends the catheter away from its side.

    Off when both are zero. Source: the paper's Figs. 7 and 10 (see the parameters).
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=12,
        acts_on="state",
        moves=("curvature_1_per_m", "tip_x_mm", "tip_angle_deg"),
        depends_on=("history",),
        partners=("tendon_friction", "tendon_stretch", "clearance_play"),
        off={"backlash_mm": 0.0, "lost_motion_mm": 0.0},
        strength=("backlash_mm",),
        typical={"backlash_mm": 0.5},
    )

    backlash_mm: float = parameter(0.363, unit="mm", low=0.0, high=10.0, source="0.363 +- 0.02, the paper's Fig. 7")
    lost_motion_mm: float = parameter(
        2.1, unit="mm", low=0.0, high=20.0, source="the paper's Fig. 10: 4.9 mm are pulled where 2.8 mm are explained"
    )

    def compile(self) -> TendonBacklashParameters:
        """Return the SI parameters."""
        return TendonBacklashParameters(self.backlash_mm * MM, self.lost_motion_mm * MM)


@njit
def compute_transmitted_pull(parameters: TendonBacklashParameters, drive_pull: float, transmitted: float) -> float:
    """Return the pull [m] that reaches the tendon, from the drive's pull and the pull transmitted before (both [m]).

    Negative: the tendon is slack by that much on a straight catheter.
    """
    if parameters.backlash == 0.0 and parameters.lost_motion == 0.0:
        return drive_pull
    drive = drive_pull - parameters.lost_motion
    return max(min(transmitted, drive), drive - parameters.backlash)
