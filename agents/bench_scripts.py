"""What the benchmark drives: the duty cycle in ducts and among pegs, and a bench protocol in free space."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import numpy as np

from evergym.agents.duty_cycle import DutyCycleController
from evergym.duct_models.duct import Duct, Target, generate_duct
from evergym.duct_models.peg_family import generate_pegs
from evergym.envs.drive import Drive, check_action
from evergym.errors import GeometryError
from evergym.model import Model
from evergym.simulator import Command
from evergym.units import KPA, MM
from evergym.world import World

__all__ = ["Script", "record_duct", "record_free", "record_pegs"]

EVERTED_MIN = 50e-3
"""Growth that a run down a duct has to reach [m]."""
CONTROL_STEP = 0.25
"""How long each command is held [s]."""
START = 10e-3
"""Everted length at the start [m]."""


@dataclass(frozen=True)
class Script:
    """Commands held one after the other, and what the env took to give them.

    Attributes:
        name: What was driven where.
        world: Surroundings.
        commands: One per control step.
        duration: How long each is held [s].
        everted_length: At the start [m].
        env_seconds: CPU time of the env's steps while it was recorded [s]; 0 without an env.
        env_steps: Number of them.
    """

    name: str
    world: World
    commands: list[Command]
    duration: float = CONTROL_STEP
    everted_length: float = START
    env_seconds: float = 0.0
    env_steps: int = 0


def _lead_to_leaf(duct: Duct) -> Duct | None:
    """Return the duct with the end of its longest way as the only target, or None if 50 mm do not fit in."""
    centreline = duct.centreline
    leaf = int(max(centreline.leaves, key=lambda node: centreline.station[node]))
    if centreline.station[leaf] < EVERTED_MIN + 2.0e-3:
        return None
    target = Target(
        node=leaf,
        position=centreline.position[leaf],
        station=float(centreline.station[leaf]),
        generation=int(centreline.generation[leaf]),
    )
    return replace(duct, targets=(target,))


def _record(env_id: str, options: dict[str, Any], everted: float, **settings: Any) -> tuple[list[Command], float]:
    """Drive an env by the duty cycle until it ends or ``everted`` [m] is reached.

    Returns:
        The commands that its drive gave, and the CPU time of its steps [s].
    """
    env = gymnasium.make(f"evergym:{env_id}", control_step_s=CONTROL_STEP, **settings)
    controller = DutyCycleController(env)
    _, info = env.reset(seed=0, options=options)
    env.step(np.array([0.0, 0.0, -1.0, -1.0], np.float32))  # compile before the clock runs
    observation, info = env.reset(seed=0, options=options)
    drive = Drive(controller.observer.limits)
    commands: list[Command] = []
    memory = None
    seconds = 0.0
    done = False
    while not done:
        action, memory = controller.predict(observation, memory)
        lengths = info["catheter_length_mm"] * MM, info["everted_length_mm"] * MM
        commands.append(drive.command(check_action(action), CONTROL_STEP, *lengths))
        start = time.process_time()
        observation, _, terminated, truncated, info = env.step(action)
        seconds += time.process_time() - start
        done = terminated or truncated or info["everted_length_mm"] * MM >= everted
    env.close()
    return commands, seconds


def _sweep(last: Command) -> list[Command]:
    """Return a sweep of the tip at the end of a drive: pull to the limit, a whole turn, release.

    It drags most sections along the wall, or over the pegs, and snaps the tip from side to side: the hard part.
    """
    turn = [
        Command(roll=last.roll, tendon_pull=max(last.tendon_pull, 4.9e-3 * k / 20), pressure=45e3) for k in range(21)
    ]
    turn += [replace(turn[-1], roll=last.roll + 2.0 * math.pi * k / 64) for k in range(65)]
    turn += [replace(turn[-1], tendon_pull=turn[-1].tendon_pull * (1.0 - k / 20)) for k in range(21)]
    return turn


def record_duct(model: str, rank: int) -> Script:
    """Return the drive to the end of the ``rank``-th held-out duct that takes 50 mm, and a sweep there."""
    found = -1
    for index in range(200):
        duct = _lead_to_leaf(generate_duct("held_out", index))
        found += duct is not None
        if duct is not None and found == rank:
            # The drive goes on to the very end: nothing counts as reached.
            commands, seconds = _record(
                "MammobotDuct-v0", {"duct": duct}, EVERTED_MIN, model=model, success_distance_mm=1e-3
            )
            steps = len(commands)
            commands += _sweep(commands[-1])
            return Script(duct.name, World.duct(duct), commands, env_seconds=seconds, env_steps=steps)
    raise GeometryError(f"Fewer than {rank + 1} of 200 held-out ducts take {EVERTED_MIN / MM:g} mm of everted length.")


def record_pegs(model: str, index: int) -> Script:
    """Return the drive to the target of a held-out peg field, and a sweep there."""
    field = generate_pegs("held_out", index)
    commands, seconds = _record("MammobotPegs-v0", {"family": "held_out", "index": index}, 1.0, model=model)
    world = World.peg_field(field)
    steps = len(commands)
    commands += _sweep(commands[-1])
    return Script(f"pegs held_out {index}", world, commands, env_seconds=seconds, env_steps=steps)


def record_free(model: Model) -> Script:
    """Return the bench protocol: growth, tendon up, half a turn, pressure steps, tendon down, retraction."""
    pull = model.robot.tendon_max_pull_mm * MM
    high = 0.95 * model.robot.pressure_max_kpa * KPA
    feed = 0.5 * model.robot.feed_max_mm_s * MM
    commands = [Command(insertion_velocity=feed, pressure=high)] * 80
    commands += [Command(pressure=high, tendon_pull=pull * k / 40) for k in range(41)]
    commands += [Command(pressure=high, tendon_pull=pull, roll=math.pi * k / 40) for k in range(41)]
    for share in (0.2, 0.4, 0.6, 0.8, 1.0):
        commands += [Command(pressure=share * high, tendon_pull=pull, roll=math.pi)] * 12
    commands += [Command(pressure=high, tendon_pull=pull * (1 - k / 40), roll=math.pi) for k in range(41)]
    commands += [Command(insertion_velocity=-feed, pressure=0.2 * high, roll=math.pi)] * 40
    return Script("bench protocol", World.free(), commands)
