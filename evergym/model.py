"""A model: a robot and its effects, read from a TOML file, and turned into the kernels' parameters."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

from evergym.config import dump_toml, load_toml, parameter
from evergym.effects.catalogue import Effects, compile_effects
from evergym.errors import ConfigError
from evergym.lattice import FIBRE_COUNT_MAX, build_catheter_bundle, build_proximal_bundle, build_sheath_bundle
from evergym.robot import RobotConfig
from evergym.state import NumericsParameters, RobotParameters
from evergym.units import GRAM, MM, UM
from evergym.whole_file import write_whole

__all__ = [
    "MODEL_NAMES",
    "Model",
    "Numerics",
    "compile_effects",
    "compile_numerics",
    "compile_robot",
    "load_model",
    "save_model",
]

MODEL_NAMES = (
    "mammobot_2023",
    "mammobot_2021",
    "mammobot_2023_fitted",
    "mammobot_2023_fitted_constant",
    "mammobot_2023_fitted_proportional",
    "mammobot_2023_predicted",
)
"""Models that ship with the package: the robot of the paper as the environments know it, its sharper predecessor, and
what ``evergym identify`` made of the paper's figures (with the three growth laws that fit them, and from the component
experiments only)."""

TENDON_MASS_PER_METRE = 0.059e-3 / 0.095
"""Tendon inside the catheter [kg/m] (paper, Table I)."""


@dataclass(frozen=True)
class Model:
    """A robot and its effects: the content of a model file."""

    schema: int = parameter(1, low=1, high=1)
    name: str = parameter("mammobot_2023")
    robot: RobotConfig = field(default_factory=RobotConfig)
    effects: Effects = field(default_factory=Effects)


@dataclass(frozen=True)
class Numerics:
    """Discretisation and tolerances of a simulator; not part of a model.

    Attributes:
        section_length_mm: Distance between sections.
        step_s: Longest implicit step.
        sheath_fibres: Fibres around the sheath.
        energy_tolerance_j: Newton stops when a full step would gain less; 1e-12 J is about a micrometre at the tip.
        iterations_max: Newton iterations before a step is halved. Almost all steps take fewer than 20; of 3000 violent
            ones of a second among pegs, 200 were enough for all, 60 for all but two, which failed in small steps too.
    """

    section_length_mm: float = parameter(2.0, unit="mm", low=0.02, high=50.0)
    step_s: float = parameter(0.125, unit="s", low=1e-5, high=10.0)
    sheath_fibres: int = parameter(12, low=4, high=FIBRE_COUNT_MAX)
    energy_tolerance_j: float = parameter(1e-10, unit="J", low=1e-18, high=1e-3)
    iterations_max: int = parameter(400, low=1, high=1000)


def load_model(name_or_path: str | Path) -> Model:
    """Return a shipped model by name, or the model in a TOML file.

    Raises:
        ConfigError: unknown name, or a file that is missing, has unknown keys or impossible values.
    """
    text = str(name_or_path)
    if text in MODEL_NAMES:
        with resources.as_file(resources.files("evergym") / "models" / f"{text}.toml") as path:
            return check_model(load_toml(path, Model), text)
    path = Path(name_or_path)
    if path.suffix != ".toml" and not path.exists():
        near = difflib.get_close_matches(text, MODEL_NAMES, n=1, cutoff=0.3)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise ConfigError(
            f"Unknown model {text!r}: it is neither a shipped model ({', '.join(MODEL_NAMES)}) nor a TOML file.{hint}"
        )
    return check_model(load_toml(path, Model), str(path))


def check_model(model: Model, where: str) -> Model:
    """Return ``model`` if its parts fit together.

    Raises:
        ConfigError: a catheter that does not fit into its sheath, or a tube without a wall.
    """
    robot = model.robot
    inner = robot.sheath_outer_diameter_mm - 2.0 * robot.sheath_wall_um * UM / MM
    if robot.catheter_inner_diameter_mm >= robot.catheter_outer_diameter_mm:
        raise ConfigError(
            f"{where}: robot.catheter_inner_diameter_mm is {robot.catheter_inner_diameter_mm:g} mm, not below the "
            f"outer diameter of {robot.catheter_outer_diameter_mm:g} mm. Give the catheter a wall."
        )
    if robot.catheter_outer_diameter_mm >= inner:
        raise ConfigError(
            f"{where}: robot.catheter_outer_diameter_mm is {robot.catheter_outer_diameter_mm:g} mm and does not fit "
            f"into the sheath, whose inner diameter is {inner:.3f} mm. Use a thinner catheter or a wider sheath."
        )
    return model


def save_model(model: Model, path: Path) -> None:
    """Write a model file that `load_model` reads back, whole or not at all."""
    write_whole(path, dump_toml(model))


def compile_robot(model: Model, numerics: Numerics, setup: str) -> RobotParameters:
    """Return the constants [SI] of the model's robot, as assembled in ``setup`` ("full", "catheter" or "sheath")."""
    robot, effects = model.robot, model.effects
    sheath_radius = 0.5 * robot.sheath_outer_diameter_mm * MM
    inner_radius = sheath_radius - robot.sheath_wall_um * UM
    catheter_radius = 0.5 * robot.catheter_outer_diameter_mm * MM
    catheter_mass = robot.catheter_mass_g * GRAM / (robot.catheter_length_mm * MM) + TENDON_MASS_PER_METRE
    # Table I gives the sheath's mass for 95 mm of double wall. The catheter's bore is dry: the sum meets the paper's
    # 0.074 N/m.
    wall_mass = robot.sheath_mass_g * GRAM / 0.095
    return RobotParameters(
        sheath_bundle=build_sheath_bundle(robot, effects, numerics.sheath_fibres),
        flexible_bundle=build_catheter_bundle(robot, effects),
        proximal_bundle=build_proximal_bundle(robot),
        sheath_radius=sheath_radius,
        catheter_radius=catheter_radius,
        flexible_length=robot.catheter_flexible_length_mm * MM,
        tendon_arm=robot.tendon_arm_mm * MM,
        pre_curvature=effects.pre_curvature.curvature_1_per_m,
        damping_time=robot.catheter_damping_time_ms * 1e-3,
        sheath_mass=wall_mass + robot.fluid_density_kg_m3 * math.pi * inner_radius**2,
        catheter_mass=catheter_mass,
        inner_mass=catheter_mass - robot.fluid_density_kg_m3 * math.pi * catheter_radius**2,
        everted_length_max=0.5 * robot.sheath_material_length_mm * MM,
        catheter_length_max=0.5 * robot.sheath_material_length_mm * MM + robot.catheter_length_mm * MM,
        has_sheath=setup != "catheter",
        has_catheter=setup != "sheath",
        may_protrude=effects.catheter_protrusion.enabled,
    )


def compile_numerics(numerics: Numerics) -> NumericsParameters:
    """Return the kernels' view of ``numerics``."""
    return NumericsParameters(numerics.section_length_mm * MM, numerics.energy_tolerance_j, numerics.iterations_max)
