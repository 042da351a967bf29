"""Simulate a measured run: the same commands at the same times, and what the instruments would have read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.channels import read_channels, read_pressure_bias
from evergym.discrepancy.columns import CHANNELS
from evergym.discrepancy.dataset import Run
from evergym.discrepancy.surroundings import open_world
from evergym.errors import SimulationDiverged
from evergym.model import Model, Numerics
from evergym.simulator import Command, Simulator
from evergym.units import DEG, KPA, MM

if TYPE_CHECKING:
    from evergym.discrepancy.hook import Hook

__all__ = ["Prediction", "simulate_run", "try_simulate_run"]

Array = NDArray[np.float64]


class Prediction(NamedTuple):
    """What the instruments would have read."""

    channels: Array
    """Columns `CHANNELS`, in their units, at the run's times, shape (k, 9); NaN from a failure on."""
    failure: str
    """Why the simulation stopped; empty if it did not."""


def simulate_run(model: Model, run: Run, numerics: Numerics | None = None, hooks: Sequence[Hook] = ()) -> Array:
    """Return the predicted channels at the run's times, shape (k, 9); NaN from where the simulation failed.

    Args:
        model: Robot and effects, with the dataset's overrides (`evergym.discrepancy.rig.apply_robot`).
        run: Setup, surroundings, start, times and commands.
        numerics: Discretisation; None: `evergym.discrepancy.rig.choose_numerics` for this model and run.
        hooks: Effects of the user's own, applied in order.
    """
    return try_simulate_run(model, run, numerics, hooks).channels


def try_simulate_run(
    model: Model, run: Run, numerics: Numerics | None = None, hooks: Sequence[Hook] = ()
) -> Prediction:
    """Like `simulate_run`, and say why a simulation failed."""
    channels = np.full((len(run.time_s), len(CHANNELS)), np.nan)
    try:
        _fill(channels, model, run, numerics, hooks)
    except SimulationDiverged as error:
        return Prediction(channels, f"run '{run.id}': {error}")
    return Prediction(channels, "")


def make_command(row: Array, pressure_bias: float = 0.0) -> Command:
    """Return the command [SI] of a row of `Run.commands`; the regulator controls what the gauge reads."""
    insertion, tail, roll, pull, pressure, *load = row.tolist()
    return Command(
        insertion_velocity=insertion * MM,
        tail_feed_velocity=None if tail != tail else tail * MM,
        roll=roll * DEG,
        tendon_pull=pull * MM,
        pressure=(pressure - pressure_bias) * KPA,
        tip_load=(load[0], load[1], load[2]),
    )


def _fill(channels: Array, model: Model, run: Run, numerics: Numerics | None, hooks: Sequence[Hook]) -> None:
    from evergym.discrepancy.rig import choose_numerics

    numerics = choose_numerics(model, run.setup) if numerics is None else numerics
    simulator = Simulator(model, open_world(run), numerics, run.setup)
    bias = read_pressure_bias(simulator)
    first = make_command(run.commands[0], bias)
    for hook in hooks:
        hook.reset(run)
    simulator.reset(
        everted_length=run.initial_everted_length_mm * MM,
        pressure=first.pressure,
        tendon_pull=first.tendon_pull,
        roll=first.roll,
    )
    times = run.time_s.tolist()
    for i, time in enumerate(times):
        if i > 0:
            start = times[i - 1]
            command = make_command(run.commands[i - 1], bias)
            for hook in hooks:
                command = hook.transform_command(start, time - start, command, simulator.reading)
            simulator.advance(command, time - start)
        row = read_channels(simulator, run.signed_angles)
        for hook in hooks:
            row = hook.transform_channels(time, row)
        channels[i] = row
