"""What the physics tests share: a robot stripped of every effect that a closed form leaves out, and worlds made by
hand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from evergym.duct_models.field import WallField
from evergym.model import Model, Numerics, load_model
from evergym.simulator import Simulator
from evergym.world import World

BARE: dict[str, Any] = {
    "robot.catheter_anisotropy": 1.0,
    "robot.catheter_damping_time_ms": 0.0,
    "pre_curvature.curvature_1_per_m": 0.0,
    "saline_weight.share": 0.0,
    "tendon_backlash.backlash_mm": 0.0,
    "tendon_backlash.lost_motion_mm": 0.0,
    "pressure_lag.time_s": 0.0,
    "burst_limit.pressure_kpa": 0.0,
    "contact_friction.mu_tissue": 0.0,
    "contact_friction.mu_peg": 0.0,
}
"""Isotropic, weightless, straight, frictionless, at once under pressure."""

LOSSLESS_GROWTH: dict[str, Any] = {
    "eversion_yield.static_kpa": 0.0,
    "eversion_yield.kinetic_kpa": 0.0,
    "feed_limit.slip": 0.0,
    "tail_coulomb_friction.yield_growth_per_mm": 0.0,
    "tail_coulomb_friction.speed_exponent": 0.0,
    "tail_catheter_friction.mu": 0.0,
    "tail_capstan_friction.mu": 0.0,
}
"""Growth against nothing but its rate."""


def _edit_model(model: Model, changes: Mapping[str, Any]) -> Model:
    for name, value in changes.items():
        table, key = name.split(".")
        if table == "robot":
            model = replace(model, robot=replace(model.robot, **{key: value}))
        else:
            effect = replace(getattr(model.effects, table), **{key: value})
            model = replace(model, effects=replace(model.effects, **{table: effect}))
    return model


@pytest.fixture(scope="session")
def edit_model() -> Callable[[Model, Mapping[str, Any]], Model]:
    """Return a copy of a model with changes such as ``{"robot.sheath_wall_um": 20.0, "feed_limit.slip": 0.0}``."""
    return _edit_model


@pytest.fixture(scope="session")
def create_robot() -> Callable[..., Simulator]:
    """Return a simulator of the 2023 robot, bare but for ``changes``.

    By default in free space, in steps of 1 s with an energy tolerance at which the solver adds nothing to the error
    that is looked for: statics (a step of 1 s has no inertia to speak of: the slowest mode is faster than 0.1 s).
    """

    def create(
        changes: Mapping[str, Any] | None = None,
        *,
        section_mm: float = 95.0 / 40.0,
        setup: str = "catheter",
        world: World | None = None,
        fibres: int = 12,
        step_s: float = 1.0,
        tolerance_j: float = 1e-16,
    ) -> Simulator:
        model = _edit_model(load_model("mammobot_2023"), {**BARE, **(changes or {})})
        numerics = Numerics(section_mm, step_s, fibres, tolerance_j)
        return Simulator(model, World.free() if world is None else world, numerics, setup)

    return create


@pytest.fixture(scope="session")
def create_grower(create_robot: Callable[..., Simulator]) -> Callable[..., Simulator]:
    """Return a bare simulator whose growth meets no resistance but that in ``changes``; a sheath without a catheter."""

    def create(changes: Mapping[str, Any] | None = None, **options: Any) -> Simulator:
        return create_robot({**LOSSLESS_GROWTH, **(changes or {})}, **{"setup": "sheath", "step_s": 0.125, **options})

    return create


@pytest.fixture(scope="session")
def create_plane() -> Callable[[ArrayLike, float], WallField]:
    """Return the field of a flat wall: the distance is ``normal . point - offset`` (a quadratic spline holds it
    exactly).
    """

    def create(normal: ArrayLike, offset: float) -> WallField:
        direction = np.array(normal, dtype=np.float64)
        spacing, origin = 0.05, np.array([-0.15, -0.15, -0.1])
        node = np.stack(np.meshgrid(*[np.arange(7)] * 3, indexing="ij"), axis=-1) * spacing + origin
        return WallField(np.ascontiguousarray(node @ direction - offset), origin, np.array([spacing]))

    return create
