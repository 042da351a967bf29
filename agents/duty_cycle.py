"""The duty cycle: the scripted controller that drives the robot as its operators do.

The cycle of the 2021 and 2023 robots: drop the pressure, so that the sheath is soft and does not grow; turn the
catheter and pull its tendon towards the next way point; advance it by a step out of the sheath; raise the pressure
until the sheath has grown over it; and again. It goes back at low pressure: withdrawing the catheter pulls the tail
too, which first gives up its slack and then inverts the wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
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

LOW_ENOUGH = 3.0 * KPA
"""Excess over the low set point [Pa] at which the pressure counts as dropped: the last of a lag takes for ever."""
TURN_TOLERANCE = 0.15
"""Turn [rad] and pull [m] still to be made at which the catheter counts as steered."""
PULL_TOLERANCE = 0.2 * MM
LENGTH_MIN = 6.0 * MM
"""Shortest catheter length [m] to withdraw to."""
GROWN = 0.3 * MM
"""Catheter ahead of the sheath [m] at which the sheath counts as grown over it."""
STALLED = 0.05 * MM
"""Growth rate [m/s] below which growth has stalled."""
CERTAIN = 0.5
"""Time [s] for which the way must have led back before that is believed: a localisation is noisy."""
NEAR_MIN = 3.0 * MM
"""Nearest point to steer at [m]: nearer ones ask for bends that nothing can make."""


@dataclass(frozen=True)
class DutyCycleSettings:
    """The controller's parameters; ``evergym tune`` finds the shipped values on training anatomies."""

    step_mm: float = parameter(5.0, unit="mm", low=0.5, high=10.0, source="2021 paper: steps of 5 mm")
    pressure_low_kpa: float = parameter(5.0, unit="kPa", low=0.0, high=50.0, source="2021 paper: dropped to 5 kPa")
    pressure_high_kpa: float = parameter(48.0, unit="kPa", low=5.0, high=50.0, source="2023 paper: 48.7 kPa at most")
    insertion_mm_s: float = parameter(2.0, unit="mm/s", low=0.1, high=20.0, prior=True)
    look_ahead_mm: float = parameter(10.0, unit="mm", low=3.0, high=20.0, prior=True, help="How far ahead it aims.")
    lever_mm: float = parameter(25.0, unit="mm", low=5.0, high=100.0, prior=True, help="Length that steering bends.")
    reaction_s: float = parameter(0.7, unit="s", low=0.05, high=10.0, prior=True, help="Time constant of steering.")
    force_limit_n: float = parameter(
        0.3, unit="N", low=0.01, high=0.5, prior=True, help="Force on the tip from which it withdraws."
    )
    relief_mm: float = parameter(2.0, unit="mm", low=0.0, high=20.0, prior=True, help="How far it then withdraws.")
    astray_mm: float = parameter(
        4.0,
        unit="mm",
        low=0.0,
        high=9.0,
        prior=True,
        help="Way into a wrong branch, whose mouth both share, to back out.",
    )
    back_out_mm: float = parameter(
        6.0, unit="mm", low=1.0, high=40.0, prior=True, help="Way back before a bifurcation."
    )
    retries: int = parameter(3, low=0, high=20, prior=True, help="Times that backing out goes farther than before.")


class Phase(Enum):
    """Where in the cycle the controller is."""

    STEER = 0
    """Pressure down, catheter turned and bent towards the way ahead."""
    ADVANCE = 1
    """Catheter forward by a step."""
    GROW = 2
    """Pressure up until the sheath has grown over the catheter."""
    WITHDRAW = 3
    """Catheter and sheath back, at low pressure."""


@dataclass(frozen=True)
class Memory:
    """What the controller keeps of one episode; SI units."""

    phase: Phase = Phase.STEER
    time: float = 0.0
    """Time in this phase."""
    goal: float = 0.0
    """Catheter length at which to end an advance or a withdrawal."""
    doubt: float = 0.0
    """Time for which the way has led back, at every observation."""
    bend: tuple[float, float] = (0.0, 0.0)
    """Wanted curvature at the base, x and y."""
    attempts: int = 0
    """Times that it has backed out."""


def load_tuned_settings(task: str) -> DutyCycleSettings:
    """Return the shipped parameters for a task ("duct" or "pegs")."""
    with resources.as_file(resources.files("evergym.agents") / "tuned" / f"duty_cycle_{task}.toml") as path:
        return load_toml(path, DutyCycleSettings) if path.exists() else build(DutyCycleSettings, {}, "duty cycle")


class DutyCycleController:
    """Drive by the duty cycle, with the ``predict`` signature of Stable-Baselines3.

    It sees the observation and nothing else. Its state is a tuple of memories, one for each environment; they are never
    changed in place, so an earlier state can be used again.

    Args:
        env: The environment to be driven; gives the layout of the observation and the drive's limits.
        settings: Parameters; None: the shipped ones for the env's task.

    Raises:
        ConfigError: The environment is not one of MAMMOBOT's.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], settings: DutyCycleSettings | None = None) -> None:
        self.observer = Observer(env)
        self.settings = load_tuned_settings(self.observer.task) if settings is None else settings

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the action for an observation or a batch of them, and the state to hand back in the next call."""
        rows = self.observer.split(observation)
        memories = list(state) if state is not None else [Memory()] * len(rows)
        starts = np.zeros(len(rows), bool) if episode_start is None else np.broadcast_to(episode_start, len(rows))
        actions = np.zeros((len(rows), 4), np.float32)
        for index, row in enumerate(rows):
            seen = self.observer.read(row)
            memory = Memory() if starts[index] else memories[index]
            memory = self._move_on(seen, self._wait(seen, memory))
            if memory.phase in (Phase.STEER, Phase.ADVANCE):
                memory = replace(memory, bend=self._steer(seen, memory))
            actions[index] = self._command(seen, memory)
            memories[index] = memory
        return (actions if self.observer.is_batch(observation) else actions[0]), tuple(memories)

    # Which phase is next

    def _wait(self, seen: Seen, memory: Memory) -> Memory:
        """Return the memory after one more control step in the same phase."""
        # Daughters share their mouth: some way into the wrong one, the right one can still be steered for.
        tolerance = 0.0 if memory.phase is Phase.WITHDRAW else self.settings.astray_mm * MM
        lost = seen.astray > tolerance or seen.is_past
        step = self.observer.control_step
        return replace(memory, time=memory.time + step, doubt=memory.doubt + step if lost else 0.0)

    def _move_on(self, seen: Seen, memory: Memory) -> Memory:
        """Return the memory in the same phase, or in the next one where this one is done."""
        settings = self.settings
        length = seen.catheter_length
        lost = memory.doubt >= CERTAIN
        if memory.phase is Phase.WITHDRAW:
            if lost:
                # The margin counts from where the way leads ahead again, so as to enter a branch from before its mouth.
                return replace(memory, goal=length - self._find_margin(memory))
            done = length <= max(memory.goal, LENGTH_MIN) or memory.time > 60.0
            return self._enter(memory, Phase.STEER) if done else memory
        if lost:
            memory = replace(memory, attempts=memory.attempts + 1)
            return self._enter(memory, Phase.WITHDRAW, goal=length - self._find_margin(memory))
        if memory.phase is not Phase.STEER and seen.tip_push > settings.force_limit_n:
            return self._enter(memory, Phase.WITHDRAW, goal=length - settings.relief_mm * MM)
        if memory.phase is Phase.STEER:
            dropped = seen.pressure < settings.pressure_low_kpa * KPA + LOW_ENOUGH
            if (dropped and self._is_steered(seen, memory)) or memory.time > 6.0:
                # Not beyond the target, and not so far ahead of a stalled sheath that the drive's interlock acts.
                room = seen.everted_length + self.observer.limits.protrusion - 1.0 * MM - length
                step = min(settings.step_mm * MM, max(seen.distance_to_go, 1.0 * MM), max(room, 0.0))
                return self._enter(memory, Phase.ADVANCE, goal=length + step)
        elif memory.phase is Phase.ADVANCE:
            if length >= memory.goal or memory.time > 15.0:
                return self._enter(memory, Phase.GROW)
        elif memory.phase is Phase.GROW:
            grown = length - seen.everted_length <= GROWN
            stalled = memory.time > 1.5 and seen.growth_rate < STALLED
            if grown or stalled or memory.time > 12.0:
                return self._enter(memory, Phase.STEER)
        return memory

    def _find_margin(self, memory: Memory) -> float:
        """Return how far to back out [m]: farther each time, and as far as the first time after the last."""
        settings = self.settings
        return settings.back_out_mm * MM * (1.0 + (memory.attempts - 1) % (settings.retries + 1))

    @staticmethod
    def _enter(memory: Memory, phase: Phase, goal: float = 0.0) -> Memory:
        return replace(memory, phase=phase, time=0.0, goal=goal)

    # Steering

    def _steer(self, seen: Seen, memory: Memory) -> tuple[float, float]:
        """Return the curvature that takes the tip over the way ahead, x and y at the base [1/m].

        Bending a free robot of length L by a change of curvature k moves a point that lies a ahead of its tip by
        k (L + a)^2 / 2 sideways; a tip that goes on with the curvature it has gets k a^2 / 2 off its axis by itself.
        """
        settings = self.settings
        # After a wrong turning it aims farther ahead, so that it bends earlier; in one, the way first leads back.
        foresight = 1.0 + 0.5 * (memory.attempts % (settings.retries + 1))
        x, y, z = seen.find_way(settings.look_ahead_mm * MM * foresight + 2.0 * seen.astray)
        ahead = max(z, NEAR_MIN)
        # The section frames have no twist, so the tip's lateral directions turn into the base's by the roll alone.
        cos, sin = math.cos(seen.roll), math.sin(seen.roll)
        now = self.observer.find_curvature(seen.tendon_pull)
        bend = np.array([now * cos, now * sin])
        missing = np.array([cos * x - sin * y, sin * x + cos * y]) - 0.5 * bend * ahead**2
        lever = min(settings.lever_mm * MM, seen.catheter_length)
        share = 1.0 - math.exp(-self.observer.control_step / settings.reaction_s)
        bend += share * missing / (0.5 * (lever + ahead) ** 2)
        size = float(np.linalg.norm(bend))
        bend *= min(1.0, self.observer.curvature_max / max(size, 1e-9))
        return float(bend[0]), float(bend[1])

    def _find_turn(self, seen: Seen, memory: Memory) -> float:
        """Return the roll still to be made [rad], -pi..pi."""
        x, y = memory.bend
        return math.remainder(math.atan2(y, x) - seen.roll, 2.0 * math.pi) if math.hypot(x, y) > 1e-6 else 0.0

    def _find_pull(self, seen: Seen, memory: Memory) -> float:
        """Return the pull [m] for the part of the wanted bend that lies on the tendon's side."""
        x, y = memory.bend
        return self.observer.find_pull(math.hypot(x, y) * max(math.cos(self._find_turn(seen, memory)), 0.0))

    def _is_steered(self, seen: Seen, memory: Memory) -> bool:
        turn, pull = self._find_turn(seen, memory), self._find_pull(seen, memory)
        return abs(turn) < TURN_TOLERANCE and abs(pull - seen.tendon_pull) < PULL_TOLERANCE

    # Driving

    def _command(self, seen: Seen, memory: Memory) -> NDArray[np.float32]:
        """Return the action of the phase."""
        settings = self.settings
        low, speed = settings.pressure_low_kpa * KPA, settings.insertion_mm_s * MM
        insertion, pressure = 0.0, low
        if memory.phase is Phase.ADVANCE:
            insertion = speed
        elif memory.phase is Phase.GROW:
            pressure = settings.pressure_high_kpa * KPA
        elif memory.phase is Phase.WITHDRAW and seen.pressure < low + LOW_ENOUGH:
            # A buckled sheath has lost the catheter in it: put that back under its tip before pulling again.
            insertion = speed if seen.buckled else -speed
        roll_rate = self._find_turn(seen, memory) / self.observer.control_step
        return self.observer.make_action(insertion, roll_rate, self._find_pull(seen, memory), pressure)
