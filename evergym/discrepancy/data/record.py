"""Record what a simulator is told and what the instruments would read, as a run of a dataset."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.channels import convert_reading, quantise_angles
from evergym.discrepancy.data.columns import COMMANDS
from evergym.discrepancy.data.dataset import Run
from evergym.errors import ConfigError
from evergym.simulator import Command, Reading, Simulator
from evergym.state import Scalar
from evergym.units import DEG, KPA, MM

__all__ = ["Recorder", "record_simulator"]

Array = NDArray[np.float64]

REST = 1e-3
"""Time before the first command that shows the rest from which the robot started, where that differs [s]."""


class Recorder:
    """Record a simulator from its reset on.

    Args:
        simulator: Just reset; free to be advanced through this recorder only.
        period: Longest time between samples [s]; None: one sample per command.

    Raises:
        ConfigError: the simulator has moved since its reset, or started in a way that a dataset cannot say.
    """

    def __init__(self, simulator: Simulator, period: float | None = None) -> None:
        if period is not None and not 0.0 < period < math.inf:
            raise ConfigError(f"The sampling period is {period} s; it must be above 0.")
        self.simulator = simulator
        self.period = period
        reading = simulator.reading
        _check_start(simulator, reading)
        # Not the reading's: under pressure a compliant wall is longer than what was everted.
        self._initial_mm = float(simulator.state.scalar[Scalar.EVERTED_LENGTH]) / MM
        self._rest = np.zeros(len(COMMANDS))
        self._rest[COMMANDS.index("tail_feed_mm_s")] = np.nan
        self._rest[COMMANDS.index("roll_deg")] = reading.roll / DEG
        self._rest[COMMANDS.index("tendon_pull_mm")] = reading.tendon_pull / MM
        self._rest[COMMANDS.index("pressure_kpa")] = _find_set_point(simulator, reading.pressure) / KPA
        self._time = [reading.time]
        self._commands: list[Array] = []
        self._channels = [convert_reading(simulator, reading)]
        self._advance = simulator.advance

    @property
    def sample_count(self) -> int:
        """Samples so far, with the one at the reset."""
        return len(self._time)

    def advance(self, command: Command, duration: float) -> Reading:
        """Advance the simulator under a held command and record it; see `Simulator.advance`."""
        parts = 1 if self.period is None else max(1, math.ceil(duration / self.period - 1e-9))
        row = _describe_command(command)
        for _ in range(parts):
            reading = self._advance(command, duration / parts)
            self._time.append(reading.time)
            self._commands.append(row)
            self._channels.append(convert_reading(self.simulator, reading))
        return reading

    def finish(self, run_id: str, experiment: str = "", environment: str = "free") -> Run:
        """Return what was recorded so far, without noise.

        Args:
            run_id: Name of the run.
            experiment: Runs of the same experiment are repeats or variants; the run's own name by default.
            environment: As `Run.environment`; the caller writes the file that it names.

        Raises:
            ConfigError: nothing was recorded.
        """
        if not self._commands:
            raise ConfigError(f"Run '{run_id}' holds no step. Advance the simulator before finishing the record.")
        time = np.array(self._time)
        commands = np.array([*self._commands, self._commands[-1]])
        measured = quantise_angles(np.array(self._channels), self.simulator.model)
        if _differs(self._rest, commands[0]):
            time = np.concatenate(([time[0] - REST], time))
            commands = np.concatenate((self._rest[None], commands))
            measured = np.concatenate((measured[:1], measured))
        for array in (time, commands, measured):
            array.flags.writeable = False
        x, y, z = self.simulator.world.gravity.tolist()
        return Run(
            id=run_id,
            setup=self.simulator.setup,
            gravity=(x, y, z),
            experiment=experiment or run_id,
            environment=environment,
            initial_everted_length_mm=self._initial_mm,
            time_s=time,
            commands=commands,
            measured=measured,
        )


@contextmanager
def record_simulator(simulator: Simulator, period: float | None = None) -> Iterator[Recorder]:
    """Record everything that others do with a simulator that was just reset, such as an environment with its own.

    Within the block ``simulator.advance`` is the recorder's.

    Raises:
        ConfigError: as `Recorder`.
    """
    recorder = Recorder(simulator, period)
    simulator.advance = recorder.advance  # type: ignore[method-assign]
    try:
        yield recorder
    finally:
        del simulator.advance  # the class's own shows again


def _check_start(simulator: Simulator, reading: Reading) -> None:
    if reading.time != 0.0:
        raise ConfigError(f"A record starts at the simulator's reset, but {reading.time:g} s have passed. Reset it.")
    if not np.array_equal(simulator.world.port_frame, np.eye(3)):
        raise ConfigError("A dataset's port faces +z. Turn gravity instead of the port.")
    full = simulator.setup == "full"
    everted = float(simulator.state.scalar[Scalar.EVERTED_LENGTH])
    expected = everted if full else simulator.model.robot.catheter_length_mm * MM
    if simulator.setup != "sheath" and abs(reading.catheter_length - expected) > 1e-9:
        raise ConfigError(
            f"A run starts with {expected / MM:g} mm of catheter inserted "
            f"({'up to the tip' if full else 'its whole length'}), but the simulator was reset with "
            f"{reading.catheter_length / MM:g} mm. Leave catheter_length out."
        )


def _find_set_point(simulator: Simulator, pressure: float) -> float:
    """Return the set point [Pa] that holds a resting robot at a pressure [Pa], through a gauge's bias and a leak."""
    effects = simulator.parameters.effects
    supply = pressure / (1.0 - effects.pressure_leak.share)
    return supply + effects.pressure_bias.bias if supply > 0.0 else 0.0


def _describe_command(command: Command) -> Array:
    tail = command.tail_feed_velocity
    return np.array(
        [
            command.insertion_velocity / MM,
            math.nan if tail is None else tail / MM,
            command.roll / DEG,
            command.tendon_pull / MM,
            command.pressure / KPA,
            *command.tip_load,
        ]
    )


def _differs(rest: Array, first: Array) -> bool:
    """Whether the set points of the first command are others than those at rest."""
    names = ("roll_deg", "tendon_pull_mm", "pressure_kpa")
    index = [COMMANDS.index(name) for name in names]
    return not np.allclose(rest[index], first[index], rtol=0.0, atol=1e-9)
