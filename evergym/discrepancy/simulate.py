"""Simulate a measured run: the same commands at the same times, and what the instruments would have read."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.channels import quantise_angles
from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.data.rig import (
    choose_numerics,
    refine_for_contact,
    refine_for_effects,
    refine_for_hanging,
    refine_for_length,
)
from evergym.discrepancy.data.surroundings import open_world
from evergym.discrepancy.playback import Playback, make_command
from evergym.discrepancy.schedule import Step, plan_steps
from evergym.errors import SimulationDiverged
from evergym.model import Model, Numerics
from evergym.simulator import Simulator

if TYPE_CHECKING:
    from evergym.discrepancy.hook import Hook

__all__ = ["Prediction", "find_longest", "fit_damping", "make_command", "simulate_run", "try_simulate_run"]

Array = NDArray[np.float64]

CORNER_SHARE = 5e-4
"""Largest error of the tip and the everted length by interpolation within a joined step, over the tip's distance."""
CORNER_DEG = 0.1
"""The same of the angles [deg]."""
_LENGTHS = [CHANNELS.index(name) for name in ("tip_x_mm", "tip_y_mm", "tip_z_mm", "everted_length_mm")]
_ANGLES = [CHANNELS.index(name) for name in ("tip_angle_deg", "bending_angle_deg")]


class Prediction(NamedTuple):
    """What the instruments would have read."""

    channels: Array
    """Columns `CHANNELS`, in their units, at the run's times, shape (k, 9); NaN from a failure on."""
    failure: str
    """Why the simulation stopped; empty if it did not."""


def simulate_run(model: Model, run: Run, numerics: Numerics | None = None, hooks: Sequence[Hook] = ()) -> Array:
    """Return the predicted channels at the run's times, shape (k, 9); NaN from where the simulation failed.

    Args:
        model: Robot and effects, with the dataset's overrides (`evergym.discrepancy.data.rig.apply_robot`).
        run: Setup, surroundings, start, times and commands.
        numerics: Discretisation; None: `evergym.discrepancy.data.rig.choose_numerics` for this model and run. Among
            pegs and in ducts it is refined as contact needs.
        hooks: Effects of the user's own, applied in order.
    """
    return try_simulate_run(model, run, numerics, hooks).channels


def try_simulate_run(
    model: Model, run: Run, numerics: Numerics | None = None, hooks: Sequence[Hook] = ()
) -> Prediction:
    """Like `simulate_run`, and say why a simulation failed."""
    channels = np.full((len(run.time_s), len(CHANNELS)), np.nan)
    numerics = choose_numerics(model, run.setup) if numerics is None else numerics
    try:
        _fill(channels, model, run, numerics, hooks)
    except SimulationDiverged as error:
        return Prediction(quantise_angles(channels, model), f"run '{run.id}': {error}")
    return Prediction(quantise_angles(channels, model), "")


def _fill(channels: Array, model: Model, run: Run, numerics: Numerics, hooks: Sequence[Hook]) -> None:
    """Overwrite ``channels`` row by row, so that those before a failure stand."""
    if run.environment != "free":
        numerics = refine_for_contact(model, numerics)
    if run.setup == "sheath" and not np.any(np.nan_to_num(run.commands[:, :2]) != 0.0):
        numerics = refine_for_hanging(numerics, run.initial_everted_length_mm)
    if run.setup != "catheter":
        numerics = refine_for_length(numerics, find_longest(run))
    numerics = refine_for_effects(model, numerics, run.setup)
    simulator = Simulator(fit_damping(model, run, numerics.step_s), open_world(run), numerics, run.setup)
    playback = Playback(simulator, run, hooks)
    time = run.time_s
    channels[0] = playback.start()
    for step in plan_steps(run, numerics.step_s):
        joined = step.last > step.first + 1
        snapshot = simulator.save() if joined and not hooks else None
        channels[step.last] = playback.play(step)
        if snapshot is not None and _hides_corner(channels, time, step):
            simulator.restore(snapshot)
            for row in range(step.first, step.last):
                duration = float(time[row + 1] - time[row])
                channels[row + 1] = playback.play(Step(row, row + 1, duration, run.commands[row], step.rests))
        elif joined:
            share = ((time[step.first + 1 : step.last] - time[step.first]) / step.duration)[:, None]
            channels[step.first + 1 : step.last] = (1.0 - share) * channels[step.first] + share * channels[step.last]


def find_longest(run: Run) -> float:
    """Return the longest that the robot can get in a run by its feeds, were the sheath long enough [mm]."""
    duration = np.diff(run.time_s)
    insertion, tail = np.nan_to_num(run.commands[:-1, :1]).ravel(), run.commands[:-1, 1]
    feed = np.where(np.isnan(tail), 2.0 * insertion, tail)
    grown = 0.5 * np.maximum(feed, 0.0) @ duration
    inserted = np.maximum(insertion, 0.0) @ duration
    return float(run.initial_everted_length_mm + max(grown, inserted))


def _hides_corner(channels: Array, time: Array, step: Step) -> bool:
    """Whether the robot changed its pace within a joined step so much that interpolation would show.

    A play that is taken up, a tail that stalls: the commands do not tell, only the result does.
    """
    if step.first == 0:
        return False
    before, start, end = channels[step.first - 1], channels[step.first], channels[step.last]
    expected = (start - before) * (step.duration / (time[step.first] - time[step.first - 1]))
    bend = np.abs(end - start - expected)
    length = max(float(np.linalg.norm(start[:3])), 1.0)
    return bool(bend[_LENGTHS].max() > 4.0 * CORNER_SHARE * length or bend[_ANGLES].max() > 4.0 * CORNER_DEG)


def fit_damping(model: Model, run: Run, step_s: float) -> Model:
    """Return the model with the catheter's damping as a step of the run's length needs it.

    An implicit step of length h leaves tau / (tau + h) of a damped motion where exp(-h / tau) is left in truth: at
    0.1 s and 5 ms, 5 % of every change would come a step late, and pass for a lag. With tau' = h / (exp(h / tau) - 1)
    the step leaves what it should. A tenth of tau is kept, for Newton's method to hold on to.
    """
    tau = model.robot.catheter_damping_time_ms * 1e-3
    if tau == 0.0 or len(run.time_s) < 2:
        return model
    h = min(step_s, float(np.median(np.diff(run.time_s))))
    fitted = max(h / math.expm1(min(h / tau, 500.0)), 0.1 * tau)
    robot = dataclasses.replace(model.robot, catheter_damping_time_ms=fitted * 1e3)
    return dataclasses.replace(model, robot=robot)
