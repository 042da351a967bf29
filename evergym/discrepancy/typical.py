"""How large a visible effect is on a robot of another size: candidates' strengths in proportion to the rig.

The catalogue's typical strengths are those of the 2023 robot. A play of half a millimetre is clearly seen on it, and
droop of 5 kPa per mm/s; on a tube that grows at 100 mm/s the latter would stop all growth, and a fit that begins there
finds nothing. Each strength is scaled by the rig's own measure of its dimension: pressures by the pressures that the
runs command, speeds by the feeds, tendon travel by the pulls, lengths, curvatures and moments by the robot.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evergym.discrepancy.candidates import Candidate, is_off
from evergym.discrepancy.data.columns import COMMANDS
from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.parameters import get_value
from evergym.effects.catalogue import EFFECTS
from evergym.model import Model
from evergym.robot import RobotConfig
from evergym.units import MM, MPA, UM

__all__ = ["RigScale", "find_factor", "find_faint", "measure_rig", "scale_candidates"]

REFERENCE = RobotConfig()
"""The robot for which the catalogue's typical strengths are visible."""
FAINT = 0.1
"""An effect at this share of its visible strength, or less, is as good as missing."""
STEP = 4.0
"""Factors are powers of this: a fit finds its way over less, and robots much like the 2023 one are left alone."""


@dataclass(frozen=True)
class RigScale:
    """A rig's measures, each relative to those of the 2023 robot.

    Attributes:
        pressure: Pressures that the runs command.
        speed: Tail feeds.
        pull: Travel of the tendon's drive.
        length: Length of the part that bends or grows.
        radius: Of the sheath.
        stiffness: Bending stiffness, sheath and catheter together.
        arm: Of the tendon.
    """

    pressure: float = 1.0
    speed: float = 1.0
    pull: float = 1.0
    length: float = 1.0
    radius: float = 1.0
    stiffness: float = 1.0
    arm: float = 1.0


def measure_rig(robot: RobotConfig, runs: Sequence[Run]) -> RigScale:
    """Return a rig's measures; what no run commands is taken from the limits of its drives.

    Args:
        robot: With the dataset's overrides.
        runs: Of the dataset.
    """
    setups = {run.setup for run in runs} or {"full"}
    pressure = _find_top(runs, "pressure_kpa") or robot.pressure_max_kpa
    insertion, tail = _find_top(runs, "insertion_mm_s"), _find_top(runs, "tail_feed_mm_s")
    speed = max(2.0 * insertion, tail) or robot.feed_max_mm_s
    pull = _find_top(runs, "tendon_pull_mm") or robot.tendon_max_pull_mm
    return RigScale(
        pressure=pressure / REFERENCE.pressure_max_kpa,
        speed=speed / REFERENCE.feed_max_mm_s,
        pull=pull / REFERENCE.tendon_max_pull_mm if pull > 0.0 else 1.0,
        length=_find_length(robot, setups) / _find_length(REFERENCE, setups),
        radius=robot.sheath_outer_diameter_mm / REFERENCE.sheath_outer_diameter_mm,
        stiffness=_find_stiffness(robot, setups) / _find_stiffness(REFERENCE, setups),
        arm=robot.tendon_arm_mm / REFERENCE.tendon_arm_mm,
    )


def scale_candidates(candidates: Sequence[Candidate], scale: RigScale) -> list[Candidate]:
    """Return the candidates with visible strengths for a rig; their starts, counted in those, stay as they are."""
    return [_scale_candidate(candidate, scale) for candidate in candidates]


def find_faint(model: Model, scale: RigScale) -> list[str]:
    """Return the effects that a model has on so weakly that they may be missing all the same.

    A line that a lab takes for nearly rigid is within its tolerance of nearly rigid, and never of a soft one.

    Args:
        model: With the dataset's overrides.
        scale: Of the rig.
    """
    return [name for name in EFFECTS if not is_off(model, name) and _is_faint(model, name, scale)]


def _is_faint(model: Model, name: str, scale: RigScale) -> bool:
    info = EFFECTS[name].info
    for key, off in info.off.items():
        path = f"effects.{name}.{key}"
        value, typical = get_value(model, path), info.typical.get(key, off)
        if value == off:
            continue
        if isinstance(off, bool) or abs(value - off) > FAINT * abs(typical - off) * find_factor(path, scale):
            return False
    return True


def find_factor(path: str, scale: RigScale) -> float:
    """Return by what a parameter's visible value is multiplied on a rig: a power of four, 1 where it has no dimension.

    Args:
        path: Of the parameter in a model file.
        scale: Of the rig.
    """
    law = _LAWS.get(path) or next((law for unit, law in _UNITS.items() if path.endswith(unit)), None)
    if law is None or not path.startswith("effects."):
        return 1.0
    size = math.prod(getattr(scale, name) ** power for name, power in law.items())
    if not (math.isfinite(size) and size > 0.0):
        return 1.0
    return float(STEP ** round(math.log(size, STEP)))


_GROWTH_PER_MM = {"pressure": 1.0, "length": -1.0}
_LAWS: dict[str, dict[str, float]] = {
    "effects.tendon_backlash.backlash_mm": {"pull": 1.0},
    "effects.tendon_backlash.lost_motion_mm": {"pull": 1.0},
    "effects.tendon_friction.presliding_mm": {"pull": 1.0},
    # A pull of arm x angle takes the tension stiffness x angle / (length x arm).
    "effects.tendon_stretch.compliance_mm_per_n": {"arm": 2.0, "length": 1.0, "stiffness": -1.0},
    "effects.tail_coulomb_friction.gradient_kpa_per_mm": _GROWTH_PER_MM,
    "effects.wall_pretension.eccentricity_mm": {"radius": 1.0},
}
"""Powers of a rig's measures to which a parameter is in proportion, where its unit alone does not say."""
_UNITS: dict[str, dict[str, float]] = {
    "_kpa_s_mm": {"pressure": 1.0, "speed": -1.0},
    "_per_kpa": {"pressure": -1.0},
    "_kpa": {"pressure": 1.0},
    "_1_per_m": {"length": -1.0},
    "_per_mm": {"length": -1.0},
    "_n_m2": {"stiffness": 1.0},
    "_n_m": {"stiffness": 1.0, "length": -1.0},
}
"""... where it does, the longest ending first. Contact depth, angles, times, frequencies and shares stay."""


def _scale_candidate(candidate: Candidate, scale: RigScale) -> Candidate:
    axes = []
    for axis in candidate.axes:
        factor = find_factor(axis.path, scale)
        # A parameter that only shapes the effect has its typical value at z = 0, an amplitude its zero.
        origin = axis.origin if axis.path in candidate.amplitudes else axis.origin * factor
        axes.append(dataclasses.replace(axis, origin=origin, scale=axis.scale * factor))
    fixed = {path: _scale_value(path, value, scale) for path, value in candidate.fixed.items()}
    return dataclasses.replace(candidate, axes=tuple(axes), fixed=fixed)


def _scale_value(path: str, value: object, scale: RigScale) -> object:
    if isinstance(value, bool) or not isinstance(value, float):
        return value
    return value * find_factor(path, scale)


def _find_top(runs: Sequence[Run], command: str) -> float:
    """Return the largest value commanded, 0 if none is."""
    column = COMMANDS.index(command)
    tops = [float(np.nanmax(np.abs(values), initial=0.0)) for values in (run.commands[:, column] for run in runs)]
    return max(tops, default=0.0)


def _find_length(robot: RobotConfig, setups: set[str]) -> float:
    """Return the length that bends or grows [mm]."""
    grown = 0.5 * robot.sheath_material_length_mm
    return robot.catheter_length_mm if setups == {"catheter"} else grown


def _find_stiffness(robot: RobotConfig, setups: set[str]) -> float:
    """Return the bending stiffness of what the runs have [N m^2]."""
    radius = 0.5 * robot.sheath_outer_diameter_mm * MM
    sheath = math.pi * radius**3 * robot.sheath_wall_um * UM * robot.sheath_modulus_mpa * MPA
    catheter = robot.catheter_bending_stiffness_n_m2
    return sheath if setups == {"sheath"} else catheter if setups == {"catheter"} else sheath + catheter
