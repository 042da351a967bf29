"""The lab's robot and model: which effects its model holds, and how far the real robot's nominals are from it.

Effects are left out of the model and of the truth alike at random, so that what is off in the model file does not say
what is missing.
"""

from __future__ import annotations

from collections.abc import Collection

from numpy.random import Generator

from evergym.discrepancy.parameters import get_value, list_paths, set_values
from evergym.model import Model, load_model

__all__ = ["NOMINALS", "draw_jitter", "draw_lab_model", "draw_overrides", "draw_wrong_nominals", "list_nominals"]

NOMINALS = {
    "robot.catheter_bending_stiffness_n_m2": 0.10,
    "robot.catheter_anisotropy": 0.15,
    "robot.tendon_arm_mm": 0.08,
    "robot.sheath_modulus_mpa": 0.15,
    "robot.fluid_density_kg_m3": 0.01,
    "effects.eversion_yield.static_kpa": 0.10,
    "effects.eversion_yield.kinetic_kpa": 0.10,
    "effects.viscous_eversion.resistance_kpa_s_mm": 0.15,
    "effects.feed_limit.slip": 0.08,
    "effects.tail_coulomb_friction.gradient_kpa_per_mm": 0.12,
    "effects.tail_coulomb_friction.yield_growth_per_mm": 0.10,
    "effects.tail_catheter_friction.mu": 0.20,
    "effects.tail_capstan_friction.mu": 0.20,
    "effects.tendon_backlash.backlash_mm": 0.10,
    "effects.tendon_backlash.lost_motion_mm": 0.06,
    "effects.tendon_stretch.compliance_mm_per_n": 0.12,
    "effects.pre_curvature.curvature_1_per_m": 0.15,
    "effects.pressure_lag.time_s": 0.20,
    "effects.contact_friction.mu_peg": 0.20,
}
"""Relative tolerance of every nominal parameter (prior: the uncertainties stated with the values' sources)."""

ON_SHARE = {
    "eversion_yield": 0.8,
    "viscous_eversion": 0.8,
    "feed_limit": 0.7,
    "tail_coulomb_friction": 0.7,
    "tail_catheter_friction": 0.5,
    "tail_capstan_friction": 0.5,
    "wall_wrinkling": 0.75,
    "tendon_backlash": 0.6,
    "tendon_stretch": 0.7,
    "bending_anisotropy": 0.75,
    "pre_curvature": 0.6,
    "saline_weight": 0.8,
    "pressure_lag": 0.6,
    "contact_friction": 0.6,
}
"""How often an effect that is not hidden is in the lab's model (and then in the truth as well)."""

STIFF_LINE_MM_PER_N = 0.02
"""A line that a lab takes for rigid: 8 % of the default's. At exactly zero the solver may stop short of the shape."""
OFF: dict[str, dict[str, float | bool]] = {
    "eversion_yield": {"static_kpa": 0.0, "kinetic_kpa": 0.0},
    "viscous_eversion": {"resistance_kpa_s_mm": 0.0},
    "feed_limit": {"slip": 0.0},
    "tail_coulomb_friction": {"gradient_kpa_per_mm": 0.0, "pressure_gradient_per_mm": 0.0, "yield_growth_per_mm": 0.0},
    "tail_catheter_friction": {"mu": 0.0},
    "tail_capstan_friction": {"mu": 0.0},
    "wall_wrinkling": {"enabled": False},
    "tendon_backlash": {"backlash_mm": 0.0, "lost_motion_mm": 0.0},
    "tendon_stretch": {"compliance_mm_per_n": STIFF_LINE_MM_PER_N},
    "bending_anisotropy": {"enabled": False},
    "pre_curvature": {"curvature_1_per_m": 0.0},
    "saline_weight": {"share": 0.0},
    "pressure_lag": {"time_s": 0.0},
    "contact_friction": {"mu_peg": 0.0, "mu_tissue": 0.0},
}
"""Values that take an effect out of the default model."""


def draw_lab_model(generator: Generator, hidden: Collection[str]) -> Model:
    """Draw the model that the lab has: the hidden effects are not in it, of the others some are.

    Args:
        generator: Source of all draws; it is used alike whatever is hidden.
        hidden: Names of the effects that the truth has and the model lacks.
    """
    values: dict[str, float | bool] = {}
    present = {name: bool(generator.uniform() < share) and name not in hidden for name, share in ON_SHARE.items()}
    for name, on in present.items():
        if not on:
            values.update({f"effects.{name}.{key}": value for key, value in OFF[name].items()})
    gradient = round(generator.uniform(0.25, 0.45), 3)
    if present["tail_coulomb_friction"] and not present["eversion_yield"]:
        # The exponential law is a multiple of the yield: without one, the constant law.
        values["effects.tail_coulomb_friction.yield_growth_per_mm"] = 0.0
        values["effects.tail_coulomb_friction.gradient_kpa_per_mm"] = gradient
    if present["tendon_backlash"] and generator.uniform() < 0.5:
        values["effects.tendon_backlash.lost_motion_mm"] = 0.0
    return set_values(load_model("mammobot_2023"), values)


def draw_overrides(generator: Generator, model: Model) -> dict[str, float]:
    """Draw the keys of ``[robot]`` by which the rig differs from the model file; mostly none."""
    scale = generator.uniform(0.85, 1.25, size=4).tolist()
    if generator.uniform() > 0.3:
        return {}
    robot = model.robot
    return {
        "catheter_bending_stiffness_n_m2": float(f"{robot.catheter_bending_stiffness_n_m2 * scale[0]:.3g}"),
        "tendon_arm_mm": round(robot.tendon_arm_mm * scale[1], 2),
        "sheath_outer_diameter_mm": round(max(robot.sheath_outer_diameter_mm * scale[2], 2.6), 2),
        "sheath_material_length_mm": round(robot.sheath_material_length_mm * scale[3], 0),
    }


def list_nominals(model: Model) -> dict[str, float]:
    """Return the nominal parameters that do something in ``model``, with their relative tolerances."""
    known = set(list_paths())
    return {path: width for path, width in NOMINALS.items() if path in known and float(get_value(model, path)) != 0.0}


def draw_jitter(generator: Generator, model: Model) -> dict[str, float]:
    """Draw the real robot's nominals, well inside their tolerances."""
    shares = generator.uniform(-0.7, 0.7, size=len(NOMINALS))
    active = list_nominals(model)
    return {
        path: float(get_value(model, path)) * (1.0 + active[path] * share)
        for path, share in zip(NOMINALS, shares.tolist(), strict=True)
        if path in active
    }


def draw_wrong_nominals(generator: Generator, model: Model) -> dict[str, float]:
    """Draw two or three nominals that are as wrong as their tolerances allow."""
    active = list_nominals(model)
    count = int(generator.integers(2, 4))
    chosen = generator.choice(list(active), size=min(count, len(active)), replace=False)
    signs = generator.choice([-1.0, 1.0], size=len(chosen))
    shares = generator.uniform(0.9, 1.2, size=len(chosen))
    return {
        str(path): float(get_value(model, path)) * (1.0 + active[path] * sign * share)
        for path, sign, share in zip(chosen.tolist(), signs.tolist(), shares.tolist(), strict=True)
    }
