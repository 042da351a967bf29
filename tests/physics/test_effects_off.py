"""An effect that is off is gone: bit for bit the same whatever its other parameters are, and not the same as when it
is on.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from evergym.duct_models.field import WallField
from evergym.effects.catalogue import Effects
from evergym.effects.tendon_stretch import RIGID_LINE_COMPLIANCE
from evergym.model import Model, Numerics, load_model
from evergym.simulator import Command, Simulator
from evergym.stepper import pack
from evergym.world import World

PRESS = (5e-3, -0.02, -4e-3)
LIFT = (0.0, 0.02, 0.0)
"""Loads on the tip [N], into the wall and against the port, and off it (where contacts would keep it from buckling)."""

Edit = Callable[..., Model]
CreatePlane = Callable[..., WallField]


@dataclass(frozen=True)
class Switch:
    """How one effect is switched.

    Attributes:
        off: Its strength, switched off.
        idle: What must then have no say: its other parameters, and others that only it uses.
        on: Values at which it acts in the scenario, where the default model has it off.
        kernel: The kernel's parameters when it is off.
    """

    off: dict[str, Any]
    idle: dict[str, Any] = field(default_factory=dict)
    on: dict[str, Any] = field(default_factory=dict)
    kernel: dict[str, float] = field(default_factory=dict)


SWITCHES: dict[str, Switch] = {
    "eversion_yield": Switch(
        {"eversion_yield.static_kpa": 0.0, "eversion_yield.kinetic_kpa": 0.0}, kernel={"static": 0.0, "kinetic": 0.0}
    ),
    "viscous_eversion": Switch(
        {"viscous_eversion.resistance_kpa_s_mm": 0.0}, {"viscous_eversion.exponent": 0.7}, kernel={"resistance": 0.0}
    ),
    "feed_limit": Switch({"feed_limit.slip": 0.0}, kernel={"slip": 0.0}),
    "tail_coulomb_friction": Switch(
        {
            "tail_coulomb_friction.gradient_kpa_per_mm": 0.0,
            "tail_coulomb_friction.pressure_gradient_per_mm": 0.0,
            "tail_coulomb_friction.yield_growth_per_mm": 0.0,
        },
        {"tail_coulomb_friction.speed_exponent": 0.9},
        kernel={"gradient": 0.0, "pressure_gradient": 0.0, "yield_growth": 0.0},
    ),
    "tail_catheter_friction": Switch({"tail_catheter_friction.mu": 0.0}, kernel={"mu": 0.0}),
    "tail_capstan_friction": Switch({"tail_capstan_friction.mu": 0.0}, kernel={"mu": 0.0}),
    "wall_wrinkling": Switch({"wall_wrinkling.enabled": False}),
    "root_kink": Switch(
        {"root_kink.moment_n_m": 0.0, "root_kink.pressure_share": 0.0},
        on={"root_kink.pressure_share": 0.3},
        kernel={"moment": 0.0, "share": 0.0},
    ),
    "tendon_backlash": Switch(
        {"tendon_backlash.backlash_mm": 0.0, "tendon_backlash.lost_motion_mm": 0.0},
        kernel={"backlash": 0.0, "lost_motion": 0.0},
    ),
    "tendon_stretch": Switch({"tendon_stretch.compliance_mm_per_n": 0.0}, kernel={"compliance": RIGID_LINE_COMPLIANCE}),
    "bending_anisotropy": Switch({"bending_anisotropy.enabled": False}, {"robot.catheter_anisotropy": 3.0}),
    "pre_curvature": Switch({"pre_curvature.curvature_1_per_m": 0.0}),
    "saline_weight": Switch({"saline_weight.share": 0.0}, {"gravity": 3.0}, kernel={"share": 0.0}),
    "pressure_lag": Switch({"pressure_lag.time_s": 0.0}, kernel={"time": 0.0}),
    "burst_limit": Switch({"burst_limit.pressure_kpa": 0.0}, kernel={"pressure": 0.0}),
    "contact_friction": Switch(
        {"contact_friction.mu_tissue": 0.0, "contact_friction.mu_peg": 0.0},
        {"contact_friction.sliding_speed_mm_s": 5.0},
        kernel={"mu_tissue": 0.0, "mu_peg": 0.0},
    ),
    "duct_compliance": Switch(
        {"duct_compliance.compliance_1_per_kpa": 0.0},
        {"duct_compliance.stiffening_depth_mm": 0.01, "duct_compliance.damping_time_s": 3.0},
    ),
    "catheter_protrusion": Switch({"catheter_protrusion.enabled": False}),
    "retraction_buckling": Switch(
        {"retraction_buckling.length_factor": 0.0},
        {"retraction_buckling.wall_poisson_ratio": 0.1},
        kernel={"length_factor": 0.0},
    ),
    "wall_shear": Switch({"wall_shear.enabled": False}, on={"wall_shear.enabled": True}),
    "axial_buckling": Switch({"axial_buckling.enabled": False}),
    "tendon_friction": Switch(
        {"tendon_friction.mu": 0.0},
        {"tendon_friction.presliding_mm": 0.1},
        on={"tendon_friction.mu": 0.2},
        kernel={"mu": 0.0},
    ),
    "notch_closure": Switch(
        {"notch_closure.stiffness_n_m2": 0.0},
        {"notch_closure.curvature_1_per_m": 2.5},
        on={"notch_closure.stiffness_n_m2": 2e-3, "notch_closure.curvature_1_per_m": 3.0},
        kernel={"stiffness": 0.0},
    ),
    "torsional_windup": Switch(
        {"torsional_windup.mu": 0.0},
        {"torsional_windup.presliding_deg": 1.0},
        on={"torsional_windup.mu": 0.1},
        kernel={"mu": 0.0},
    ),
    "wall_pretension": Switch(
        {"wall_pretension.eccentricity_mm": 0.0, "wall_pretension.step_moment_n_m": 0.0},
        {"wall_pretension.direction_deg": 90.0, "wall_pretension.step_pressure_kpa": 30.0},
        on={"wall_pretension.eccentricity_mm": 0.5, "wall_pretension.step_moment_n_m": 1e-4},
        kernel={"moment": 0.0, "eccentricity": 0.0, "step_moment": 0.0},
    ),
    "wall_creep": Switch(
        {"wall_creep.share": 0.0},
        {"wall_creep.time_s": 1.0},
        on={"wall_creep.share": 0.3, "wall_creep.time_s": 2.0},
        kernel={"share": 0.0},
    ),
    "wall_compliance": Switch(
        {"wall_compliance.share": 0.0}, on={"wall_compliance.share": 1.0}, kernel={"hoop": 0.0, "axial": 0.0}
    ),
    "pressure_droop": Switch(
        {"pressure_droop.resistance_kpa_s_mm": 0.0},
        on={"pressure_droop.resistance_kpa_s_mm": 2.0},
        kernel={"resistance": 0.0},
    ),
    "pressure_ripple": Switch(
        {"pressure_ripple.amplitude_kpa": 0.0},
        {"pressure_ripple.frequency_hz": 3.0},
        on={"pressure_ripple.amplitude_kpa": 2.0},
        kernel={"amplitude": 0.0},
    ),
    "pressure_leak": Switch({"pressure_leak.share": 0.0}, on={"pressure_leak.share": 0.1}, kernel={"share": 0.0}),
    "pressure_bias": Switch({"pressure_bias.bias_kpa": 0.0}, on={"pressure_bias.bias_kpa": 2.0}, kernel={"bias": 0.0}),
    "clearance_play": Switch(
        {"clearance_play.angle_deg": 0.0},
        {"clearance_play.centring_moment_n_m": 1e-5, "clearance_play.tendon_crosses": True},
        on={"clearance_play.angle_deg": 3.0},
        kernel={"angle": 0.0},
    ),
}

SENSOR_ONLY = {"angle_quantisation"}
"""Effects that change what is read, never the state."""


@pytest.fixture(scope="module")
def create(edit_model: Edit, create_plane: CreatePlane) -> Callable[..., Simulator]:
    def create(changes: dict[str, Any]) -> Simulator:
        gravity = np.array([0.0, -9.81 * changes.get("gravity", 1.0), 0.0])
        world = World(
            wall=create_plane((0.0, 1.0, 0.0), -1.52e-3),
            pegs=np.array([[6e-3, 0.0, 0.045, 0.0, 1.0, 0.0, 2.5e-3]]),
            gravity=gravity,
        )
        changes = {name: value for name, value in changes.items() if name != "gravity"}
        model = edit_model(load_model("mammobot_2023"), changes)
        return Simulator(model, world, Numerics(section_length_mm=4.0))

    return create


def _drive(robot: Simulator) -> str:
    """Let every effect act, and return a hash of all that happened: lag, steering both ways, growth, contact,
    buckling, burst.
    """
    digest = hashlib.sha256()
    robot.reset(everted_length=0.030, catheter_length=0.025)
    commands = [
        *[
            Command(insertion_velocity=4e-3, pressure=40e3, tendon_pull=6e-4 * k, roll=0.1, tip_load=PRESS)
            for k in range(7)
        ],
        *[Command(insertion_velocity=6e-3, tail_feed_velocity=9e-3, pressure=50e3, tendon_pull=3.6e-3, roll=0.5)] * 8,
        *[Command(tendon_pull=3.3e-3 - 3e-4 * k, pressure=15e3, roll=0.5) for k in range(4)],
        *[Command(insertion_velocity=-2e-2, tail_feed_velocity=0.0, pressure=15e3)] * 6,
        *[Command(tail_feed_velocity=-1e-2, pressure=45e3, tip_load=LIFT), Command(tail_feed_velocity=-1e-2)] * 4,
        *[Command(tip_load=PRESS, pressure=70e3)] * 3,
    ]
    for command in commands:
        robot.advance(command, 0.5)
        for array in robot.state:
            digest.update(array.tobytes())
    return digest.hexdigest()


@pytest.fixture(scope="module")
def default(create: Callable[..., Simulator]) -> str:
    return _drive(create({}))


def test_every_effect_has_a_switch() -> None:
    assert set(SWITCHES) | SENSOR_ONLY == set(Effects.__dataclass_fields__)


@pytest.mark.parametrize("name", sorted(SWITCHES))
def test_effect_that_is_off_is_gone(create: Callable[..., Simulator], default: str, name: str) -> None:
    switch = SWITCHES[name]
    off = _drive(create(switch.off))
    on = _drive(create(switch.on)) if switch.on else default
    assert off != on, "the scenario does not exercise the effect"
    if switch.idle:
        assert _drive(create({**switch.off, **switch.idle})) == off
        # The same change matters when the effect is on: else this would prove nothing.
        assert _drive(create({**switch.on, **switch.idle})) != on


@pytest.mark.parametrize("name", sorted(name for name in SWITCHES if SWITCHES[name].kernel))
def test_off_is_the_kernel_without_strength(create: Callable[..., Simulator], name: str) -> None:
    switch = SWITCHES[name]
    robot = create(switch.on)
    effects = robot.parameters.effects
    effects = effects._replace(**{name: getattr(effects, name)._replace(**switch.kernel)})
    robot.parameters = robot.parameters._replace(effects=effects)
    robot._box = pack(robot.parameters, robot.state, robot._backup, robot.workspace)
    assert _drive(robot) == _drive(create(switch.off))
