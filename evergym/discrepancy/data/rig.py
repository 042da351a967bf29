"""The robot of a dataset: the model with the rig's own dimensions, and a discretisation to match."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping

from evergym.config import build, to_mapping
from evergym.discrepancy.data.dataset import Dataset
from evergym.model import Model, Numerics, check_model, compile_robot
from evergym.robot import RobotConfig
from evergym.units import KPA, MM, MPA, UM

__all__ = [
    "Fidelity",
    "apply_robot",
    "choose_numerics",
    "override_robot",
    "refine_for_contact",
    "refine_for_effects",
    "refine_for_hanging",
    "refine_for_length",
    "soften_line",
]

LINE_COMPLIANCE_MIN = 0.02
"""Least compliance of the tendon line [mm/N]: a tenth of what the paper's Fig. 7 shows."""


class Fidelity(enum.Enum):
    """How finely to simulate."""

    FAST = "fast"
    """For fits: within 0.03 mm rms of the finest in free space, see docs/datasets.md."""
    STANDARD = "standard"
    """Half the step, and a third more sections."""
    FINE = "fine"
    """To tell numerics from physics."""


def apply_robot(model: Model, dataset: Dataset) -> Model:
    """Return the model with the dataset's ``[robot]`` overrides.

    Raises:
        ConfigError: an unknown key (the nearest is named), or a value that is impossible.
    """
    where = f"{dataset.path / 'dataset.toml'} [robot]"
    robot = override_robot(model.robot, dataset.robot, where, {run.setup for run in dataset.runs})
    return check_model(dataclasses.replace(model, robot=robot), where)


def soften_line(model: Model) -> tuple[Model, tuple[str, ...]]:
    """Return the model without a tendon line of no compliance at all, and what to remark about that.

    A line that cannot stretch at all has false equilibria, in which the tip ends up turned by half a circle: which one
    is met depends on the step. In a comparison with data that would pass for numerics, or for physics.
    """
    stretch = model.effects.tendon_stretch
    if stretch.compliance_mm_per_n >= LINE_COMPLIANCE_MIN:
        return model, ()
    stiff = dataclasses.replace(stretch, compliance_mm_per_n=LINE_COMPLIANCE_MIN)
    remark = (
        f"the model's tendon line (effects.tendon_stretch.compliance_mm_per_n = {stretch.compliance_mm_per_n:g}) is "
        f"simulated with {LINE_COMPLIANCE_MIN} mm/N: a stiffer one has false equilibria"
    )
    return dataclasses.replace(model, effects=dataclasses.replace(model.effects, tendon_stretch=stiff)), (remark,)


def override_robot(robot: RobotConfig, overrides: Mapping[str, float], where: str, setups: set[str]) -> RobotConfig:
    """Return ``robot`` with some of its keys replaced.

    A part that no run has (the sheath, or the catheter) is made to fit around or into the part that they have, unless
    the overrides give its size: a model file must hold a robot that can be assembled.

    Args:
        robot: The model's.
        overrides: Keys of ``[robot]`` and their values.
        where: Start of every message.
        setups: Of the runs.

    Raises:
        ConfigError: an unknown key (the nearest is named), or a value that is impossible.
    """
    changed = build(RobotConfig, {**to_mapping(robot), **overrides}, where)
    inner = changed.sheath_outer_diameter_mm - 2.0 * changed.sheath_wall_um * UM / MM
    if changed.catheter_outer_diameter_mm < inner or "full" in setups:
        return changed
    if setups == {"catheter"} and "sheath_outer_diameter_mm" not in overrides:
        gap = robot.sheath_outer_diameter_mm / robot.catheter_outer_diameter_mm
        wide = gap * changed.catheter_outer_diameter_mm + 2.0 * changed.sheath_wall_um * UM / MM
        return dataclasses.replace(changed, sheath_outer_diameter_mm=wide)
    if setups == {"sheath"} and not {"catheter_outer_diameter_mm", "catheter_inner_diameter_mm"} & set(overrides):
        share = inner / changed.sheath_outer_diameter_mm * robot.catheter_outer_diameter_mm
        share /= robot.sheath_outer_diameter_mm
        thin = share * changed.sheath_outer_diameter_mm
        bore = thin * robot.catheter_inner_diameter_mm / robot.catheter_outer_diameter_mm
        return dataclasses.replace(changed, catheter_outer_diameter_mm=thin, catheter_inner_diameter_mm=bore)
    return changed


def refine_for_contact(model: Model, numerics: Numerics) -> Numerics:
    """Return a discretisation fine enough among pegs or in a duct.

    There a section has a contact of its own: with 2 mm and 62.5 ms the tip of the default robot is within 0.02 mm rms
    of the finest among pegs, with 3.9 mm and 125 ms within 0.1 mm.
    """
    section_mm = 2.0 / 3.0 * model.robot.sheath_outer_diameter_mm
    return dataclasses.replace(
        numerics,
        section_length_mm=min(numerics.section_length_mm, max(section_mm, 0.05)),
        step_s=min(numerics.step_s, _CONTACT_STEP_S),
    )


def refine_for_effects(model: Model, numerics: Numerics, setup: str) -> Numerics:
    """Return a discretisation fine enough for the model's effects that a fast one would blur.

    Measured on tendon ramps, growth, roll and loads of 12 s, in standard deviations of a bench (0.3 mm, 0.5 degrees):
    the ripple's phase is late by half a step; friction along the tendon takes the bend of the step's start (0.6 sigma
    with 0.1 s, 0.2 with 1 / 32 s); the play at the base swallows what the first section bends by itself (3 sigma with
    3.9 mm, 1 with 1.5 mm). All other effects are within 0.25 sigma as they are.
    """
    effects = model.effects
    step_s, section_mm = numerics.step_s, numerics.section_length_mm
    ripple = effects.pressure_ripple
    if setup != "catheter" and ripple.amplitude_kpa > 0.0 and ripple.frequency_hz > 0.0:
        step_s = min(step_s, max(2.0 ** math.floor(-math.log2(64.0 * ripple.frequency_hz)), 1e-3))
    if setup != "sheath" and effects.tendon_friction.mu > 0.0:
        step_s = min(step_s, _TENDON_FRICTION_STEP_S)
    if setup == "full" and effects.clearance_play.angle_deg > 0.0:
        section_mm = min(section_mm, max(0.5 * model.robot.sheath_outer_diameter_mm, 0.05))
    return dataclasses.replace(numerics, step_s=step_s, section_length_mm=section_mm)


def refine_for_length(numerics: Numerics, length_mm: float) -> Numerics:
    """Return a discretisation with some sections on a robot that stays far shorter than its material allows."""
    section_mm = max(length_mm / _SECTIONS_MIN, 0.05)
    return dataclasses.replace(numerics, section_length_mm=min(numerics.section_length_mm, section_mm))


def refine_for_hanging(numerics: Numerics, length_mm: float) -> Numerics:
    """Return a discretisation fine enough for a sheath that hangs and does not grow.

    Its kink at the root is spread over the first section: 0.5 of 95 mm make 0.3 degrees.
    """
    return dataclasses.replace(
        numerics, section_length_mm=min(numerics.section_length_mm, max(length_mm / 190.0, 0.05))
    )


def choose_numerics(model: Model, setup: str, fidelity: Fidelity = Fidelity.FAST) -> Numerics:
    """Return a discretisation in proportion to the robot: sections to its length, the tolerance to its energy.

    A sheath alone hangs from a kink at its root, which is spread over one section: it gets twice as many. A robot that
    swings so slowly that samples show it is followed in steps that show it, too.

    Args:
        model: Robot and effects, with the dataset's overrides.
        setup: "full", "catheter" or "sheath".
        fidelity: How finely.
    """
    robot = model.robot
    length = robot.catheter_length_mm if setup == "catheter" else 0.5 * robot.sheath_material_length_mm
    count, step_s = _DISCRETISATION[fidelity]
    sections = 2 * count if setup == "sheath" else count
    stiffness = 0.0 if setup == "sheath" else robot.catheter_bending_stiffness_n_m2 / (length * MM)
    area = 0.25 * math.pi * (robot.sheath_outer_diameter_mm * MM) ** 2
    thrust = 0.0 if setup == "catheter" else robot.pressure_max_kpa * KPA * area * length * MM
    tolerance = _TOLERANCE_SHARE * (stiffness + thrust)
    if setup != "sheath":  # which grows or hangs; its swing in saline is not what benches sample
        period = _estimate_period(model, setup, length * MM)
        if period > _VISIBLE_PERIOD_S:
            # A power of two, so that the step does not change with every stiffness that a fit tries.
            step_s = min(step_s, 2.0 ** math.floor(math.log2(period / _STEPS_PER_PERIOD)))
    return Numerics(
        section_length_mm=min(max(length / sections, 0.05), 50.0),
        step_s=step_s,
        energy_tolerance_j=min(max(tolerance, 1e-14), 1e-4),
    )


_DISCRETISATION = {Fidelity.FAST: (36, 0.125), Fidelity.STANDARD: (48, 0.0625), Fidelity.FINE: (96, 1.0 / 64.0)}
"""Sections and step [s]."""
_TOLERANCE_SHARE = 2e-9
"""Of the robot's energy (one radian of bend over its length, pressure times volume); 1e-10 J for the default robot."""
_SECTIONS_MIN = 8
_CONTACT_STEP_S = 0.0625
_TENDON_FRICTION_STEP_S = 1.0 / 32.0
_VISIBLE_PERIOD_S = 0.2
"""Slower swings than this are seen in bench data, faster ones die out between samples."""
_STEPS_PER_PERIOD = 20


def _estimate_period(model: Model, setup: str, length: float) -> float:
    """Return the period [s] of the slowest swing of a cantilever with the robot's stiffness and mass."""
    robot = compile_robot(model, Numerics(), setup)
    sheath = math.pi * robot.sheath_radius**3 * model.robot.sheath_wall_um * UM * model.robot.sheath_modulus_mpa * MPA
    catheter = model.robot.catheter_bending_stiffness_n_m2
    stiffness, mass = catheter, robot.catheter_mass
    if setup == "full":
        stiffness, mass = sheath + catheter, robot.sheath_mass + robot.inner_mass
    return 2.0 * math.pi * length**2 / 3.516 * math.sqrt(mass / stiffness)
