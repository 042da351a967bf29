"""Play a campaign on the true robot: what ideal instruments would have read, row by row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.blind.alteration import Alteration
from evergym.discrepancy.blind.plan import PlannedRun
from evergym.discrepancy.data.channels import read_channels
from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.playback import make_command
from evergym.model import Model, Numerics
from evergym.simulator import Command, Simulator
from evergym.units import MM
from evergym.world import World

__all__ = ["PAUSE_S", "play_campaign"]

Array = NDArray[np.float64]

PAUSE_S = 45.0
"""Between two runs the bench is set up again [s]; what drifts with the clock drifts on."""
SETTLING_S = 3.0
"""Time under the first command for an alteration that has to find its rest [s]."""


def play_campaign(
    model: Model, plans: Sequence[PlannedRun], numerics: Numerics, alterations: Sequence[Alteration] = ()
) -> list[Array]:
    """Return the noise-free channels of every run, each of shape (k, 9), columns and units as in a dataset.

    Args:
        model: The true robot, as far as the library can express it.
        plans: Runs in the order in which the bench ran them.
        numerics: Discretisation of the truth.
        alterations: The truth's own code, applied in order.

    Raises:
        SimulationDiverged: The true robot finds no equilibrium.
    """
    clock = 0.0
    signals = []
    for plan in plans:
        signals.append(_play(model, plan, numerics, alterations, clock))
        clock += plan.duration + PAUSE_S
    return signals


def _play(model: Model, plan: PlannedRun, numerics: Numerics, alterations: Sequence[Alteration], clock: float) -> Array:
    simulator = Simulator(model, _make_world(plan), numerics, plan.setup)
    first = make_command(plan.commands[0])
    for alteration in alterations:
        alteration.begin(plan, first, clock)
    rest = Command(0.0, 0.0, first.roll, first.tendon_pull, first.pressure)
    altered = rest
    if alterations:
        # Under the commands that really act; the simulator is at its nominal start until it has been reset.
        simulator.reset(everted_length=plan.initial_everted_length_mm * MM, pressure=max(first.pressure, 0.0))
        for alteration in alterations:
            altered = alteration.alter_command(0.0, numerics.step_s, altered, simulator)
        for alteration in alterations:
            alteration.begin(plan, first, clock)
    simulator.reset(
        everted_length=plan.initial_everted_length_mm * MM,
        pressure=altered.pressure,
        tendon_pull=altered.tendon_pull,
        roll=altered.roll,
    )
    if any(alteration.settles for alteration in alterations):
        for _ in range(round(SETTLING_S / numerics.step_s)):
            _advance(simulator, rest, 0.0, numerics.step_s, alterations)
    signals = np.empty((len(plan.time_s), len(CHANNELS)))
    times = plan.time_s.tolist()
    for i, time in enumerate(times):
        if i > 0:
            start = times[i - 1]
            command = make_command(plan.commands[i - 1])
            count = max(round((time - start) / numerics.step_s), 1)
            dt = (time - start) / count
            for part in range(count):
                _advance(simulator, command, start + part * dt, dt, alterations)
        row = read_channels(simulator)
        for alteration in alterations:
            row = alteration.alter_channels(time, row, simulator)
        signals[i] = row
    return signals


def _advance(simulator: Simulator, command: Command, time: float, dt: float, alterations: Sequence[Alteration]) -> None:
    for alteration in alterations:
        command = alteration.alter_command(time, dt, command, simulator)
    simulator.advance(command, dt)


def _make_world(plan: PlannedRun) -> World:
    pegs = np.array([(x * MM, 0.0, z * MM, 0.0, 1.0, 0.0, 0.5 * d * MM) for x, z, d in plan.pegs]).reshape(-1, 7)
    return World(pegs=pegs, gravity=np.array(plan.gravity))
