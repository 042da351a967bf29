"""The steps in which a measured run is simulated: as few as its commands allow.

A bench samples faster than its robot changes. Rows are joined into one step of the simulator where the commands rest or
change steadily; between the ends of a step the channels are interpolated. Around an event (a command that jumps, or
starts, stops or reverses its ramp) the steps are as short as the samples and then grow with the time since the event,
so that what decays after it is followed.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import COMMANDS, RATES
from evergym.discrepancy.data.dataset import Run

__all__ = ["REST_FACTOR", "Step", "find_events", "plan_steps"]

Array = NDArray[np.float64]

GROWTH = 0.25
"""A step may be this share of the time since the last event. Interpolation then misses a decay of any time constant by
at most 2 % of its size: h^2 / 8 of the second derivative, largest at twice the time constant."""
STEADY_SHARE = 0.5
"""A ramp is steady where its increments differ by less than this share."""
REST_FACTOR = 2.0
"""Under commands that rest, the robot in free space is followed in steps longer by this factor."""
JITTER = (0.02, 0.02, 0.1, 0.01, 0.05, 2e-4, 2e-4, 2e-4)
"""Changes of each command, in its unit, that are no event: rounding of a ramp, noise of a logged set point. They move
the tip of the default robot by less than 0.1 mm."""
JITTER_RANGE = (2.9, 5.8, 180.0, 4.9, 50.0, 0.02, 0.02, 0.02)
"""Commands of that robot. In a run with less than a quarter of them at the most, or more than four times, the jitter is
in proportion, but not below a tenth: where nothing much is commanded, noise is all there is. A roll stays a roll."""
JITTER_SPAN, JITTER_LEAST = 4.0, 0.1


class Step(NamedTuple):
    """A part of a run that is simulated under one command."""

    first: int
    """Row at whose time it starts."""
    last: int
    """Row at whose time it ends."""
    duration: float
    """[s]."""
    command: Array
    """Columns `COMMANDS`: set points as they are at the end, rates averaged; shape (8,)."""
    rests: bool
    """No command changes within the step or at its start."""


def find_events(commands: Array) -> NDArray[np.bool_]:
    """Return whether each row's commands break with the rows before, shape (k,); the first row does."""
    count = len(commands)
    event = np.zeros(count, dtype=bool)
    event[:1] = True
    filled = np.where(np.isnan(commands), np.inf, commands)
    for number, column in enumerate(filled.T):
        finite = np.isfinite(column)
        jitter = JITTER[number] * _scale_jitter(number, float(np.max(np.abs(column), initial=0.0, where=finite)))
        event[1:] |= finite[1:] != finite[:-1]
        change = np.zeros(count)
        change[1:] = np.diff(np.where(finite, column, 0.0))
        before = np.concatenate(([0.0], change[:-1]))
        size = np.maximum(np.abs(change), np.abs(before))
        event |= np.abs(change - before) > STEADY_SHARE * size + jitter
    return event


def _scale_jitter(number: int, top: float) -> float:
    """Return the jitter of a command, relative to the default robot's, in a run that commands ``top`` at the most."""
    if number == COMMANDS.index("roll_deg"):
        return 1.0
    share = top / JITTER_RANGE[number]
    if share > JITTER_SPAN:
        return share / JITTER_SPAN
    return max(min(share * JITTER_SPAN, 1.0), JITTER_LEAST)


@functools.lru_cache(maxsize=512)  # a fit plays the same runs thousands of times
def plan_steps(run: Run, step_s: float) -> tuple[Step, ...]:
    """Return the steps of a run, joined from rows that span at most ``step_s`` [s], where commands rest twice that."""
    time, commands = run.time_s, run.commands
    event = find_events(commands)
    moves = np.ones(len(time), dtype=bool)
    moves[1:] = ~np.all((commands[1:] == commands[:-1]) | (np.isnan(commands[1:]) & np.isnan(commands[:-1])), axis=1)
    stretch = REST_FACTOR if run.environment == "free" else 1.0
    steps = []
    first, last_event = 0, float(time[0])
    while first < len(time) - 1:
        if event[first]:
            last_event = float(time[first])
        age = float(time[first]) - last_event
        last = first + 1
        rests = not moves[first]
        while last < len(time) - 1 and not event[last]:
            resting = rests and not moves[last]
            if time[last + 1] - time[first] > min(step_s * (stretch if resting else 1.0), GROWTH * age) + 1e-9:
                break
            rests = resting
            last += 1
        steps.append(Step(first, last, float(time[last] - time[first]), _join(time, commands, first, last), rests))
        first = last
    return tuple(steps)


def _join(time: Array, commands: Array, first: int, last: int) -> Array:
    command: Array = commands[last - 1].copy()
    if last == first + 1:
        return command
    weight = np.diff(time[first : last + 1])
    command[RATES] = weight @ commands[first:last][:, RATES] / weight.sum()
    return command
