"""Nominal parameters: those that the model claims to know, each with the tolerance within which it may be wrong."""

from __future__ import annotations

import re
from collections.abc import Sequence

from evergym.discrepancy.candidates import is_off
from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.parameters import find_info, get_value, list_paths
from evergym.discrepancy.space import Axis
from evergym.discrepancy.typical import find_faint, measure_rig
from evergym.model import Model

__all__ = ["BOUND", "find_nominals", "find_tolerance"]

BOUND = 3.0
"""A nominal parameter is recalibrated within this many tolerances: beyond them it is no nominal error any more."""

LIMITS = frozenset(
    {
        "robot.tendon_max_pull_mm",
        "robot.sheath_material_length_mm",
        "robot.feed_max_mm_s",
        "robot.pressure_max_kpa",
        "effects.burst_limit.pressure_kpa",
        "effects.contact_friction.sliding_speed_mm_s",
        "effects.duct_compliance.peg_stiffness_mpa",
        "effects.angle_quantisation.step_deg",
    }
)
"""Limits of drives and numerical constants: nothing to recalibrate."""

CONTACT = frozenset({"contact_friction", "duct_compliance"})
"""Effects that act on what the robot touches."""

MEASURED = {
    "robot.catheter_length_mm": 0.01,
    "robot.catheter_flexible_length_mm": 0.01,
    "robot.catheter_inner_diameter_mm": 0.01,
    "robot.catheter_outer_diameter_mm": 0.01,
    "robot.sheath_outer_diameter_mm": 0.01,
    "robot.fluid_density_kg_m3": 0.01,
    "robot.catheter_mass_g": 0.02,
    "robot.sheath_mass_g": 0.02,
    "robot.tendon_arm_mm": 0.10,
}
"""Relative tolerance of what is measured with a rule or a balance. Prior."""

SOURCED, GUESSED = 0.10, 0.20
"""Relative tolerance of a value with a source, and of one without. Priors."""

_UNCERTAINTY = re.compile(r"([\d.]+(?:e-?\d+)?) \+- ([\d.]+(?:e-?\d+)?)")


def find_tolerance(path: str, value: float) -> float:
    """Return one standard deviation of a nominal parameter, in its unit."""
    info = find_info(path)
    if path in MEASURED:
        return MEASURED[path] * abs(value)
    share = GUESSED if info.prior else SOURCED
    stated = _UNCERTAINTY.search(info.source)
    if stated and float(stated[1]) > 0.0:
        share = max(min(float(stated[2]) / float(stated[1]), 0.4), SOURCED)
    return share * abs(value)


def find_nominals(model: Model, runs: Sequence[Run] = ()) -> list[Axis]:
    """Return the parameters that the model sets and that can be a little wrong: numbers that are not zero.

    Parameters of effects that are off or as good as off, limits of the drives and numerical constants are none; nor are
    those of contact where no run touches anything.
    """
    faint = find_faint(model, measure_rig(model.robot, runs))
    touching = not runs or any(run.environment != "free" for run in runs)
    axes = []
    for path in list_paths():
        table, *rest = path.split(".")
        if table not in ("robot", "effects") or path in LIMITS:
            continue
        if table == "effects" and (is_off(model, rest[0]) or rest[0] in faint or (rest[0] in CONTACT and not touching)):
            continue
        value, info = get_value(model, path), find_info(path)
        if isinstance(value, bool) or not isinstance(value, float) or value == 0.0:
            continue
        scale = find_tolerance(path, value)
        low = max(value - BOUND * scale, info.low if info.low is not None else -float("inf"))
        high = min(value + BOUND * scale, info.high if info.high is not None else float("inf"))
        axes.append(Axis(path, value, scale, low, high, nominal=True))
    return axes
