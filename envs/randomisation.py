"""Draw a model from the uncertainty of its parameters."""

from __future__ import annotations

import dataclasses
import math
from typing import TypeVar

import numpy as np

from evergym.config import build, iterate_parameters, to_mapping
from evergym.model import Model

__all__ = ["SPREAD", "draw_model"]

T = TypeVar("T")

SPREAD = {
    "robot.catheter_bending_stiffness_n_m2": 0.04,  # 4.23 +- 0.09e-4 by elastica, 4.5e-4 by slope
    "robot.catheter_anisotropy": 0.35,  # 5 to 15
    "robot.catheter_torsional_stiffness_n_m2": 0.6,  # 0.05 to 0.3 of the uncut tube's
    "robot.tendon_arm_mm": 0.2,  # 0.75 to 1.3 mm
    "robot.sheath_modulus_mpa": 0.2,  # 0.14 to 0.3 GPa
    "effects.eversion_yield.static_kpa": 0.2,  # 8.7 to 18.7 kPa
    "effects.eversion_yield.kinetic_kpa": 0.1,  # 9.9 +- 1.0 kPa
    "effects.viscous_eversion.resistance_kpa_s_mm": 0.39,  # 1 / (0.41 +- 0.16)
    "effects.feed_limit.slip": 0.05,  # eta 0.25 to 0.28
    "effects.tail_coulomb_friction.gradient_kpa_per_mm": 0.1,  # 0.64 +- 0.06
    "effects.tail_coulomb_friction.pressure_gradient_per_mm": 0.09,  # 0.0100 +- 0.0009
    "effects.tail_coulomb_friction.yield_growth_per_mm": 0.11,  # 0.0217 +- 0.0024
    "effects.tail_coulomb_friction.speed_exponent": 0.3,  # 0.33 +- 0.10
    "effects.tail_catheter_friction.mu": 0.5,  # 0.005 to 0.1, prior
    "effects.tail_capstan_friction.mu": 0.5,  # 0.05 to 0.3, prior
    "effects.tendon_backlash.backlash_mm": 0.055,  # 0.363 +- 0.02 mm
    "effects.tendon_backlash.lost_motion_mm": 0.1,  # "about 2.1 mm"; the width is a prior
    "effects.tendon_stretch.compliance_mm_per_n": 0.05,  # 0.26 to 0.29 mm/N
    "effects.pre_curvature.curvature_1_per_m": 0.45,  # 2.2 +- 1 1/m
    "effects.contact_friction.mu_tissue": 0.8,  # 0.01 to 0.3, prior
    "effects.contact_friction.mu_peg": 0.35,  # 0.1 to 0.4, prior
    "effects.duct_compliance.compliance_1_per_kpa": 0.6,  # 10 to 100 kPa, prior
    "effects.duct_compliance.stiffening_depth_mm": 0.3,  # prior
    "effects.pressure_lag.time_s": 0.5,  # prior
    "effects.retraction_buckling.inversion_yield_kpa": 0.3,  # prior
}
"""Relative standard deviation of each uncertain parameter.

The ranges are those that the parameters' sources give; a range is taken as two standard deviations to either side. What
is missing here is known (such as dimensions), numerical, or a limit (such as the burst pressure), and is never drawn.
"""


def draw_model(model: Model, rng: np.random.Generator, scale: float = 1.0) -> Model:
    """Return a copy of ``model`` with its uncertain parameters drawn anew.

    Each parameter is multiplied by a log-normal factor with median 1, so it keeps its sign, and held to its bounds. An
    effect that is off stays off. All factors are independent: correlations between fitted parameters are not known.

    Args:
        model: The nominal model.
        rng: Source of the draw; one normal number per entry of ``SPREAD``, so that equal seeds give equal models.
        scale: Multiplies every spread; 0 gives an equal model, 1 the full uncertainty.
    """
    factors = {
        path: math.exp(scale * spread * draw)
        for (path, spread), draw in zip(SPREAD.items(), rng.standard_normal(len(SPREAD)).tolist(), strict=True)
    }
    return dataclasses.replace(
        model,
        robot=_scale_parameters(model.robot, "robot.", factors),
        effects=_scale_parameters(model.effects, "effects.", factors),
    )


def _scale_parameters(instance: T, prefix: str, factors: dict[str, float]) -> T:
    """Return a copy of a schema's instance with the parameters named in ``factors`` scaled and held to their bounds."""
    mapping = to_mapping(instance)
    for path, info, _ in iterate_parameters(type(instance), prefix):
        if path not in factors:
            continue
        *tables, key = path.removeprefix(prefix).split(".")
        table = mapping
        for name in tables:
            table = table[name]
        value = table[key] * factors[path]
        if info.low is not None:
            value = max(value, info.low)
        if info.high is not None:
            value = min(value, info.high)
        table[key] = value
    return build(type(instance), mapping, "a drawn model")
