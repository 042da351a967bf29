"""What the catalogue says about each effect is so: switched on at its typical values, it moves a channel that it names,
by more than a bench resolves; the two decoys do not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from evergym.discrepancy.data.channels import read_channels
from evergym.discrepancy.data.columns import CHANNELS
from evergym.duct_models.field import WallField
from evergym.effects.catalogue import EFFECTS
from evergym.model import Model, Numerics, load_model
from evergym.simulator import Command, Simulator
from evergym.world import World

RESOLUTION = {
    "tip_x_mm": 0.2,
    "tip_y_mm": 0.2,
    "tip_z_mm": 0.2,
    "everted_length_mm": 0.5,
    "growth_speed_mm_s": 0.1,
    "curvature_1_per_m": 0.1,
    "tip_angle_deg": 0.5,
    "bending_angle_deg": 0.5,
    "pressure_measured_kpa": 0.5,
}
"""What a bench resolves of each channel: about that of the paper's readings."""
DECOYS = {"wall_shear", "wall_compliance"}
"""Negligible at this size, as the catalogue says: a diagnosis must not name them."""
KPA, MM = 1e3, 1e-3


def _bend(robot: Simulator) -> list[np.ndarray]:
    """The assembled robot on the bench: pulled, paid out, rolled and loaded, at two pressures."""
    robot.reset(everted_length=95.0 * MM, catheter_length=95.0 * MM, pressure=5.0 * KPA)
    commands = []
    for pressure in (5.0 * KPA, 8.0 * KPA):
        commands += [Command(tendon_pull=pull * MM, pressure=pressure) for pull in (0.0, 3.0, 4.9, 4.0, 3.0)]
        commands += [
            Command(tendon_pull=4.0 * MM, roll=roll, pressure=pressure, tip_load=(0.0, 0.0, -5e-3))
            for roll in (0.0, 0.5, 1.0, 0.5)
        ]
        commands += [Command(pressure=pressure, tip_load=(load, 0.5 * load, -0.05)) for load in (0.01, -0.02, 0.01)]
    return [_step(robot, command, 1.0) for command in commands]


def _grow(robot: Simulator) -> list[np.ndarray]:
    """Growth with the catheter following, at two feeds and pressures, in a bend, and back again."""
    rows = []
    robot.reset(everted_length=20.0 * MM, catheter_length=15.0 * MM)
    for pressure, feed, insertion, pull in (
        (20.0, 4.0, 3.0, 0.0),
        (40.0, 4.0, 8.0, 3.5),
        (48.0, 11.0, 8.0, 4.9),
        (30.0, 11.0, 2.0, 4.9),
        (30.0, -3.0, -1.0, 0.0),
        (5.0, -3.0, -3.0, 0.0),
        (5.0, -10.0, -8.0, 0.0),
    ):
        command = Command(insertion * MM, feed * MM, 0.0, pull * MM, pressure * KPA)
        rows += [_step(robot, command, 0.5) for _ in range(6)]
    return rows


def _hang(robot: Simulator) -> list[np.ndarray]:
    """The sheath alone at two pressures, loaded, left to itself, and pulled back."""
    rows = []
    robot.reset(everted_length=95.0 * MM, pressure=40.0 * KPA)
    for pressure in (40.0 * KPA, 9.0 * KPA):
        for load, wait in ((0.0, 1.0), (1e-4, 1.0), (1e-4, 10.0), (0.0, 1.0)):
            rows.append(_step(robot, Command(pressure=pressure, tip_load=(load, 0.0, 0.0)), wait))
        rows.append(_step(robot, Command(pressure=pressure, tail_feed_velocity=-4.0 * MM), 0.5))
    return rows


def _touch(robot: Simulator) -> list[np.ndarray]:
    """Pressed on a wall below, pushed along it and let go."""
    robot.reset(everted_length=60.0 * MM, catheter_length=60.0 * MM, pressure=5.0 * KPA)
    loads = ((0.0, -0.1, 0.0), (0.03, -0.1, 0.0), (0.0, -0.1, 0.0))
    return [_step(robot, Command(pressure=5.0 * KPA, tip_load=load), 3.0) for load in loads]


def _step(robot: Simulator, command: Command, duration: float) -> np.ndarray:
    robot.advance(command, duration)
    return read_channels(robot)


SCENES: dict[str, tuple[str, Callable[[Simulator], list[np.ndarray]]]] = {
    "bend": ("full", _bend),
    "grow": ("full", _grow),
    "hang": ("sheath", _hang),
    "touch": ("full", _touch),
}


@pytest.fixture(scope="module")
def measure(create_plane: Callable[..., WallField]) -> Callable[[Model], dict[str, np.ndarray]]:
    wall = create_plane((0.0, 1.0, 0.0), -1.6e-3)

    @cache
    def measure(model: Model) -> dict[str, np.ndarray]:
        rows = {}
        for name, (setup, drive) in SCENES.items():
            world = World(wall=wall) if name == "touch" else World.free()
            rows[name] = np.array(drive(Simulator(model, world, Numerics(section_length_mm=4.0), setup)))
        return rows

    return measure


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_effect_moves_what_it_says(measure: Callable[[Model], dict[str, np.ndarray]], name: str) -> None:
    info = EFFECTS[name].info
    model = load_model("mammobot_2023")
    present = getattr(model.effects, name)
    off = replace(model, effects=replace(model.effects, **{name: replace(present, **info.off)}))
    on = replace(model, effects=replace(model.effects, **{name: replace(present, **{**info.off, **info.typical})}))
    before, after = measure(off), measure(on)
    resolution = np.array([RESOLUTION[channel] for channel in CHANNELS])
    moved = np.max([np.abs(after[scene] - before[scene]).max(axis=0) / resolution for scene in SCENES], axis=0)
    visible = {channel for channel, size in zip(CHANNELS, moved, strict=True) if size > 1.0}
    if name in DECOYS:
        assert visible == set()
        assert moved.max() > 0.0
    else:
        assert visible & set(info.moves), dict(zip(CHANNELS, moved.round(2), strict=True))
