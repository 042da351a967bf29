"""Play a run's steps on a simulator, each in pieces as long as what happens in them allows."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.channels import convert_reading
from evergym.discrepancy.data.columns import CHANNELS, COMMANDS
from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.schedule import REST_FACTOR, Step
from evergym.eversion import EVERTED_LENGTH_MIN
from evergym.model import Numerics
from evergym.simulator import Command, Simulator
from evergym.units import DEG, KPA, MM

if TYPE_CHECKING:
    from evergym.discrepancy.hook import Hook

__all__ = ["Playback", "find_pressure_settling", "make_command"]

Array = NDArray[np.float64]

SETTLING_STEPS = 4
"""Steps after a change of the command that are not lengthened."""
PRESSURE_STEP_S = 0.02
"""Step while the pressure changes under a growing robot: the law of growth takes the pressure at a step's end. With
0.125 s and a jump every 2 s the everted length is 0.25 mm off at the most, so 0.01 mm."""
PRESSURE_JUMP_KPA, PRESSURE_JUMP_SHARE = 1.0, 0.05
"""Change of the set point from row to row that growth feels, in a run of low pressures as a share of the largest."""
SETTLING_TIMES = 3.0
"""Time constants of the pressure's lag after which it has settled: 5 % are left."""
SPEED_STEP_S = 0.02
"""Last piece of a step where the growth speed is measured: it is that of the simulator's last step."""
SHORTEST_S = 1e-9


class Playback:
    """A run on a simulator.

    Args:
        simulator: In the run's surroundings and setup.
        run: What to play.
        hooks: Effects of the user's own, applied in order.
    """

    def __init__(self, simulator: Simulator, run: Run, hooks: Sequence[Hook]) -> None:
        self._simulator = simulator
        self._run = run
        self._hooks = hooks
        self._numerics = simulator.numerics
        self._by_step: dict[float, Numerics] = {}
        self._settled = find_pressure_settling(simulator.model.effects.pressure_lag.time_s, run)
        world = simulator.world
        self._stretch = REST_FACTOR if world.wall is None and len(world.pegs) == 0 else 1.0
        self._watches_speed = bool(np.isfinite(run.measured[:, CHANNELS.index("growth_speed_mm_s")]).any())
        self._reading = simulator.reading

    def start(self) -> Array:
        """Put the robot at rest under the run's first commands; return the first row's channels.

        A sheath that starts shorter than the simulator's shortest starts with that.
        """
        first = make_command(self._run.commands[0])
        for hook in self._hooks:
            hook.reset(self._run)
        self._reading = self._simulator.reset(
            everted_length=max(self._run.initial_everted_length_mm * MM, EVERTED_LENGTH_MIN),
            pressure=first.pressure,
            tendon_pull=first.tendon_pull,
            roll=first.roll,
        )
        return self._read(float(self._run.time_s[0]))

    def play(self, step: Step) -> Array:
        """Play a step; return the channels at its end."""
        command = make_command(step.command)
        time = start = float(self._run.time_s[step.first])
        for duration, step_s in self._divide(step, float(self._settled[step.first]) - start):
            self._simulator.numerics = self._find_numerics(step_s)
            if self._hooks:
                self._advance_hooked(command, time, duration)
            else:
                self._reading = self._simulator.advance(command, duration)
            time += duration
        return self._read(start + step.duration)

    def _find_numerics(self, step_s: float) -> Numerics:
        """Return the simulator's discretisation with another step; made once, since a replacement takes 25 us."""
        found = self._by_step.get(step_s)
        if found is None:
            found = self._by_step[step_s] = dataclasses.replace(self._numerics, step_s=step_s)
        return found

    def _divide(self, step: Step, pressure_settles: float) -> Iterator[tuple[float, float]]:
        """Yield (duration, longest step) of the pieces of a step [s]."""
        step_s = self._numerics.step_s
        left = step.duration
        last = 0.0
        if self._watches_speed and left > 2.0 * SPEED_STEP_S:
            last = SPEED_STEP_S
            left -= last
        changing = min(left, pressure_settles)
        if changing > SHORTEST_S:
            yield changing, min(step_s, PRESSURE_STEP_S)
            left -= changing
        settling = 0.0 if step.rests else min(left, SETTLING_STEPS * step_s)
        if settling > SHORTEST_S:
            yield settling, step_s
            left -= settling
        if left > SHORTEST_S:
            yield left, self._stretch * step_s
        if last > 0.0:
            yield last, step_s

    def _advance_hooked(self, command: Command, start: float, duration: float) -> None:
        """Advance through the hooks, which may have a time of their own: asked as often as the simulator steps."""
        parts = math.ceil(duration / self._numerics.step_s - 1e-9)
        dt = duration / parts
        for part in range(parts):
            changed = command
            for hook in self._hooks:
                changed = hook.transform_command(start + part * dt, dt, changed, self._reading)
            self._reading = self._simulator.advance(changed, dt)

    def _read(self, time: float) -> Array:
        row = convert_reading(self._simulator, self._reading, self._run.signed_angles)
        for hook in self._hooks:
            row = hook.transform_channels(time, row)
        return row


def make_command(row: Array) -> Command:
    """Return the command [SI] of a row of `Run.commands`."""
    insertion, tail, roll, pull, pressure, *load = row.tolist()
    return Command(
        insertion_velocity=insertion * MM,
        tail_feed_velocity=None if math.isnan(tail) else tail * MM,
        roll=roll * DEG,
        tendon_pull=pull * MM,
        pressure=pressure * KPA,
        tip_load=(load[0], load[1], load[2]),
    )


def find_pressure_settling(lag_s: float, run: Run) -> Array:
    """Return until when [s], at each row, growth is driven by a pressure that still follows its set point; shape (k,).

    A robot that feeds nothing does not grow: its pressure needs no following.

    Args:
        lag_s: Time constant of the pressure [s].
        run: With setup, times and commands.
    """
    fed = np.nan_to_num(run.commands[:, :2]) > 0.0
    if run.setup == "catheter" or not fed.any():
        return np.full(len(run.time_s), -np.inf)
    pressure = run.commands[:, COMMANDS.index("pressure_kpa")]
    jump = np.zeros(len(pressure), dtype=bool)
    felt = min(PRESSURE_JUMP_KPA, PRESSURE_JUMP_SHARE * float(np.max(np.abs(pressure))))
    jump[1:] = np.abs(np.diff(pressure)) > felt
    settled: Array = np.maximum.accumulate(np.where(jump, run.time_s + SETTLING_TIMES * lag_s, -np.inf))
    return settled
