"""What the bench protocols share: how the robot is mounted, loaded and read, as the authors did."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evergym.experiments.paper import READING_LENGTH
from evergym.model import Model, Numerics
from evergym.simulator import Command, Reading, Simulator
from evergym.world import World

__all__ = [
    "ASSUMPTIONS",
    "DOWN",
    "STATICS",
    "bend",
    "find_pre_curvature_angle",
    "hang",
    "mount",
    "read_angle",
    "remove_tendon",
]

Array = NDArray[np.float64]

ASSUMPTIONS = (
    "The bend plane is vertical and the base horizontal; weights are dead loads: they keep pulling straight down.",
    "'Toward' is a load towards the tendon's side: the robot lies with that side down.",
    "For a load 'opposite', and without a load, it lies with that side up.",
    "What the authors subtract is the unloaded, unpulled shape of the bare catheter (their 12 degrees).",
    "They subtract the same from the full system's readings: the sag under its own weight is part of these.",
    "Pulls are raised from none before a load is applied, the loads follow each other; readings are taken at rest.",
    "Without a pull the tendon is slack by the motion that the assembled robot loses.",
    "The sheath is under pressure before its tail is fed, from the shortest length that the simulator knows.",
)
"""What the paper leaves open, as it is taken here."""

DOWN: Mapping[str, Array] = {
    "toward": np.array([1.0, 0.0, 0.0]),
    "opposite": np.array([-1.0, 0.0, 0.0]),
    "90deg": np.array([0.0, 1.0, 0.0]),
}
"""Direction of weight and load in the robot's frame, whose x axis is the tendon's side, by the paper's words."""

STATICS = Numerics(section_length_mm=95.0 / 40.0, step_s=1.0)
"""Steps of a second have no inertia to speak of: the robot's slowest mode takes 0.1 s."""

_STEPS = 3
"""Steps in which a pull is raised."""
_STEP_TIME = 1.0
_REST_TIME = 3.0
"""Robot time [s] for each of them, and at the end; the pressure's and the material's lags are below a second."""

GRAVITY = 9.81
TENDON_SLACK_COMPLIANCE_MM_PER_N = 100.0
"""So soft (1 cm per 0.1 N) that a tendon of it counts as removed."""


def mount(model: Model, setup: str, load_direction: str) -> Simulator:
    """Return the robot on the bench, with the weight along ``DOWN[load_direction]``."""
    return Simulator(model, World.free(gravity=GRAVITY * DOWN[load_direction]), STATICS, setup)


def remove_tendon(model: Model) -> Model:
    """Return the model without tendon: what is left of it holds no force."""
    stretch = replace(model.effects.tendon_stretch, compliance_mm_per_n=TENDON_SLACK_COMPLIANCE_MM_PER_N)
    return replace(model, effects=replace(model.effects, tendon_stretch=stretch))


def bend(simulator: Simulator, *, pressure: float = 0.0, tendon_pull: float = 0.0) -> Reading:
    """Reset the robot to 95 mm, pull, wait, and return the reading at rest.

    Args:
        simulator: As `mount` returns it; a sheath does not grow, since no tail is fed.
        pressure: [Pa gauge].
        tendon_pull: [m].
    """
    simulator.reset(everted_length=READING_LENGTH, catheter_length=None, pressure=pressure)
    for step in range(1, _STEPS) if tendon_pull > 0.0 else ():
        _hold(simulator, pressure, tendon_pull * step / _STEPS, np.zeros(3), _STEP_TIME)
    return _hold(simulator, pressure, tendon_pull, np.zeros(3), _REST_TIME)


def hang(simulator: Simulator, load: Array, *, pressure: float = 0.0, tendon_pull: float = 0.0) -> Reading:
    """Hang a weight, in place of the one before, on a robot that was bent, wait, and return the reading at rest.

    Args:
        simulator: After `bend`, with the same pressure and pull.
        load: Force on the tip [N], shape (3,).
        pressure: [Pa gauge].
        tendon_pull: [m].
    """
    return _hold(simulator, pressure, tendon_pull, load, _REST_TIME)


def _hold(simulator: Simulator, pressure: float, tendon_pull: float, load: Array, duration: float) -> Reading:
    x, y, z = load.tolist()
    command = Command(tail_feed_velocity=0.0, pressure=pressure, tendon_pull=tendon_pull, tip_load=(x, y, z))
    return simulator.advance(command, duration)


def read_angle(reading: Reading) -> float:
    """Return the angle of the tip's tangent in the notch plane [rad], towards the tendon's side."""
    return math.atan2(reading.tip_direction[0], reading.tip_direction[2])


def find_pre_curvature_angle(model: Model) -> float:
    """Return the tip angle of the catheter's own pre-curvature over 95 mm [rad], which the authors subtract."""
    return model.effects.pre_curvature.curvature_1_per_m * READING_LENGTH
