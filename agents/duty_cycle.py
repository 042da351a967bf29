"""The duty cycle: the scripted controller that drives the robot as its operators do.

Pressure down, catheter forward by a step with tendon and roll set towards the next way point, pressure up until the sheath has
grown over the catheter, and again; out of a wrong branch it backs by inversion. It sees the observation and nothing else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from importlib import resources
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from evergym.agents.observer import Observer, Seen
from evergym.config import build, load_toml, parameter
from evergym.units import KPA, MM

__all__ = ["DutyCycleController", "DutyCycleSettings", "load_tuned_settings"]


@dataclass(frozen=True)
class DutyCycleSettings:
    """The controller's parameters; the shipped values are found by ``evergym.agents.tuning`` on training anatomies."""

    step_mm: float = parameter(5.0, unit="mm", low=0.5, high=20.0, source="2021 paper: steps of 5 mm")
    pressure_low_kpa: float = parameter(5.0, unit="kPa", low=0.0, high=50.0, source="2021 paper: dropped to 5 kPa")
    pressure_high_kpa: float = parameter(48.0, unit="kPa", low=5.0, high=50.0, prior=True)
    insertion_mm_s: float = parameter(2.0, unit="mm/s", low=0.1, high=20.0, prior=True)
    look_ahead_mm: float = parameter(10.0, unit="mm", low=3.0, high=20.0, prior=True)
    lever_mm: float = parameter(25.0, unit="mm", low=5.0, high=100.0, prior=True, help="Length that steering bends.")
    gain: float = parameter(0.3, unit="1", low=0.01, high=2.0, prior=True)
    curvature_max_1_per_m: float = parameter(11.0, unit="1/m", low=1.0, high=50.0, prior=True)
    force_limit_n: float = parameter(0.25, unit="N", low=0.01, high=5.0, prior=True)
    back_out_mm: float = parameter(6.0, unit="mm", low=0.0, high=40.0, prior=True)


class Phase(Enum):
    """Where in the cycle the controller is."""

    STEER = 0
    ADVANCE = 1
    GROW = 2
    BACK_OUT = 3


@dataclass
class Memory:
    """What the controller keeps of one episode."""

    phase: Phase = Phase.STEER
    time: float = 0.0
    bend: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    """Wanted curvature at the base, x and y [1/m]."""
    start: float = 0.0
    """Catheter length at which the advance or the way back began [m]."""
    stalls: int = 0
    backing_from: float = 0.0


def load_tuned_settings(task: str) -> DutyCycleSettings:
    """Return the shipped parameters for a task ("duct" or "pegs")."""
    with resources.as_file(resources.files("evergym.agents") / "tuned" / f"duty_cycle_{task}.toml") as path:
        return load_toml(path, DutyCycleSettings) if path.exists() else build(DutyCycleSettings, {}, "duty cycle")


class DutyCycleController:
    """Drive by the duty cycle, with the ``predict`` signature of Stable-Baselines3.

    Args:
        env: The environment to be driven; gives the layout of the observation and the drive's limits, nothing of its state.
        settings: Parameters; None: the shipped ones for the env's task.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], settings: DutyCycleSettings | None = None) -> None:
        self.observer = Observer(env)
        self.settings = load_tuned_settings(self.observer.task) if settings is None else settings

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the action for an observation or a batch of them, and the memory to hand back in the next call."""
        rows = self.observer.split(observation)
        memories: list[Memory] = list(state) if state is not None else [Memory() for _ in rows]
        starts = np.zeros(len(rows), bool) if episode_start is None else np.broadcast_to(episode_start, len(rows))
        actions = np.zeros((len(rows), 4), np.float32)
        for index, row in enumerate(rows):
            if starts[index]:
                memories[index] = Memory()
            actions[index] = self._act(self.observer.read(row), memories[index])
        return (actions if self.observer.is_batch(observation) else actions[0]), tuple(memories)

    def _act(self, seen: Seen, memory: Memory) -> NDArray[np.float32]:
        """Return the action in the current phase, having moved on to the next where this one is done."""
        settings = self.settings
        memory.time += self.observer.control_step
        protrusion = seen.catheter_length - seen.everted_length
        pressed = seen.wall_force_max > settings.force_limit_n
        if memory.phase is not Phase.BACK_OUT and seen.astray:
            self._enter(memory, Phase.BACK_OUT, seen)
            memory.backing_from = seen.catheter_length
        if memory.phase is Phase.STEER:
            self._steer(seen, memory)
            ready = self._is_steered(seen, memory) and seen.pressure < (settings.pressure_low_kpa + 3.0) * KPA
            if ready or memory.time > 6.0:
                self._enter(memory, Phase.ADVANCE, seen)
        elif memory.phase is Phase.ADVANCE:
            self._steer(seen, memory)
            gone = seen.catheter_length - memory.start
            if gone >= settings.step_mm * MM or (pressed and gone > 1.0 * MM) or memory.time > 15.0:
                self._enter(memory, Phase.GROW, seen)
        elif memory.phase is Phase.GROW:
            settled = memory.time > 1.5 and seen.growth_rate < 0.05 * MM
            if protrusion <= 0.3 * MM or settled or memory.time > 12.0:
                self._enter(memory, Phase.STEER, seen)
        elif memory.phase is Phase.BACK_OUT:
            gone = memory.backing_from - seen.catheter_length
            if not seen.astray:
                # Back before the bifurcation, and by a margin, in order to enter the right branch from its mouth.
                if gone >= settings.back_out_mm * MM or seen.catheter_length < 6.0 * MM:
                    self._enter(memory, Phase.STEER, seen)
            else:
                memory.backing_from = max(seen.catheter_length, memory.backing_from - 1e9)
                memory.backing_from = seen.catheter_length
            if memory.time > 40.0:
                self._enter(memory, Phase.STEER, seen)
        insertion, pressure = self._drive(memory.phase)
        return self._command(seen, memory, insertion, pressure)

    def _drive(self, phase: Phase) -> tuple[float, float]:
        """Return insertion velocity [m/s] and pressure [Pa] of a phase."""
        settings = self.settings
        if phase is Phase.ADVANCE:
            return settings.insertion_mm_s * MM, settings.pressure_low_kpa * KPA
        if phase is Phase.GROW:
            return 0.0, settings.pressure_high_kpa * KPA
        if phase is Phase.BACK_OUT:
            return -settings.insertion_mm_s * MM, settings.pressure_low_kpa * KPA
        return 0.0, settings.pressure_low_kpa * KPA

    def _enter(self, memory: Memory, phase: Phase, seen: Seen) -> None:
        memory.phase = phase
        memory.time = 0.0
        memory.start = seen.catheter_length

    def _steer(self, seen: Seen, memory: Memory) -> None:
        """Move the wanted curvature towards the one that takes the tip over the way point ahead."""
        settings = self.settings
        ahead = settings.look_ahead_mm * MM
        aside = seen.look_aside(ahead)
        # The section frames have no twist, so the tip's lateral directions turn into the base's by the roll alone.
        c, s = math.cos(seen.roll), math.sin(seen.roll)
        lateral = np.array([c * aside[0] - s * aside[1], s * aside[0] + c * aside[1]])
        lever = min(settings.lever_mm * MM, seen.catheter_length)
        missing = lateral - 0.5 * memory.bend * ahead**2
        change = missing / (0.5 * (lever + ahead) ** 2)
        memory.bend = memory.bend + settings.gain * change
        size = float(np.linalg.norm(memory.bend))
        if size > settings.curvature_max_1_per_m:
            memory.bend *= settings.curvature_max_1_per_m / size

    def _is_steered(self, seen: Seen, memory: Memory) -> bool:
        roll, pull = self._compute_set_points(seen, memory)
        return abs(roll) < 0.15 and abs(pull - seen.tendon_pull) < 0.2 * MM

    def _compute_set_points(self, seen: Seen, memory: Memory) -> tuple[float, float]:
        """Return the turn still to be made [rad] and the pull [m] for the wanted curvature."""
        size = float(np.linalg.norm(memory.bend))
        pull = self.observer.find_pull(size)
        if size < 1e-6:
            return 0.0, pull
        turn = math.atan2(memory.bend[1], memory.bend[0]) - seen.roll
        return math.remainder(turn, 2.0 * math.pi), pull

    def _command(self, seen: Seen, memory: Memory, insertion: float, pressure: float) -> NDArray[np.float32]:
        turn, pull = self._compute_set_points(seen, memory)
        return self.observer.make_action(insertion, turn / self.observer.control_step, pull, pressure)
