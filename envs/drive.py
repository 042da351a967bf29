"""From an action in -1..1 to the commands of the drive: scaling, clipping and the rate limits of the set points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evergym.robot import RobotConfig
from evergym.simulator import Command
from evergym.units import DEG, KPA, MM

__all__ = ["ACTION_NAMES", "Drive", "DriveLimits", "check_action"]

ACTION_NAMES = ("insertion velocity", "catheter roll rate", "tendon pull", "pressure")
"""What each component of the action sets, in order."""

HOLD_MAX = 0.25
"""Longest time a command is held [s]: longer control steps are cut, so that ramps stay ramps."""


@dataclass(frozen=True)
class DriveLimits:
    """Largest commands of the drive and the rates of its set points (SI).

    Attributes:
        insertion_velocity: Catheter insertion [m/s].
        tendon_pull: Tendon pull [m].
        pressure: Gauge pressure [Pa].
        roll_rate: Catheter roll rate at the base [rad/s].
        tendon_pull_rate: Rate of the tendon pull set point [m/s].
        protrusion: How far the catheter may be ahead of the sheath [m]; beyond it an interlock holds the catheter and
            feeds tail only, since a bare catheter poking through a duct is what the sheath is there to prevent.
        pressure_rate: Rate of the pressure set point [Pa/s].
    """

    insertion_velocity: float
    tendon_pull: float
    pressure: float
    roll_rate: float = 45.0 * DEG  # prior: half a turn in 4 s; no source gives the drive's rate
    tendon_pull_rate: float = 2.0 * MM  # prior: a full pull in 2.5 s
    protrusion: float = 10.0 * MM  # prior: two 5 mm steps of the duty cycle
    pressure_rate: float = 50.0 * KPA  # prior: a full ramp in 1 s; the line's own lag is an effect of the model

    @classmethod
    def from_robot(cls, robot: RobotConfig) -> DriveLimits:
        """Return a robot's limits: everting 1 mm takes 2 mm of tail, so the catheter moves at half the tail's speed."""
        return cls(
            insertion_velocity=0.5 * robot.feed_max_mm_s * MM,
            tendon_pull=robot.tendon_max_pull_mm * MM,
            pressure=robot.pressure_max_kpa * KPA,
        )


def check_action(action: Any) -> list[float]:
    """Return the four components of an action, clipped to -1..1.

    Raises:
        ValueError: If the shape is not (4,) or a component is not finite; the message names the component.
    """
    values: list[float] = np.asarray(action, dtype=np.float64).tolist()
    if not isinstance(values, list) or len(values) != len(ACTION_NAMES) or isinstance(values[0], list):
        raise ValueError(f"The action has shape {np.shape(action)}; it must be ({len(ACTION_NAMES)},).")
    for index, value in enumerate(values):
        if not math.isfinite(value):
            raise ValueError(
                f"action[{index}] ({ACTION_NAMES[index]}) is {value}; every component must be a finite number in -1..1."
            )
        values[index] = -1.0 if value < -1.0 else min(value, 1.0)
    return values


class Drive:
    """The set points of the drive between base station and robot.

    Velocities act at once; tendon pull and pressure follow their set points at a limited rate.
    """

    __slots__ = ("insertion_velocity", "limits", "pressure", "roll", "tendon_pull")

    def __init__(self, limits: DriveLimits) -> None:
        self.limits = limits
        self.reset()

    def reset(self, *, roll: float = 0.0, tendon_pull: float = 0.0, pressure: float = 0.0) -> None:
        """Set the state at the start of an episode (SI)."""
        self.insertion_velocity = 0.0
        self.roll = roll
        self.tendon_pull = tendon_pull
        self.pressure = pressure

    def command(self, action: list[float], duration: float, catheter_length: float, everted_length: float) -> Command:
        """Move the set points for ``duration`` and return the command to hold meanwhile.

        Args:
            action: Four numbers in -1..1, see ``check_action``.
            duration: How long the command is held [s].
            catheter_length: Inserted length of the catheter [m]; it cannot be withdrawn beyond the port.
            everted_length: Everted length [m].
        """
        limits = self.limits
        self.insertion_velocity = max(action[0] * limits.insertion_velocity, -catheter_length / duration)
        # Wrapping would command a whole turn: the angle counts on, only its sine and cosine are observed.
        self.roll += action[1] * limits.roll_rate * duration
        pull = 0.5 * (action[2] + 1.0) * limits.tendon_pull
        pressure = 0.5 * (action[3] + 1.0) * limits.pressure
        self.tendon_pull = _approach(self.tendon_pull, pull, limits.tendon_pull_rate * duration)
        self.pressure = _approach(self.pressure, pressure, limits.pressure_rate * duration)
        tail = None
        room = everted_length + limits.protrusion - catheter_length
        if self.insertion_velocity > 0.0 and self.insertion_velocity * duration > room:
            tail = 2.0 * self.insertion_velocity
            self.insertion_velocity = max(room, 0.0) / duration
        return Command(
            insertion_velocity=self.insertion_velocity,
            tail_feed_velocity=tail,
            roll=self.roll,
            tendon_pull=self.tendon_pull,
            pressure=self.pressure,
        )

    def action_for(
        self, insertion_velocity: float, roll_rate: float, pull: float, pressure: float
    ) -> NDArray[np.float32]:
        """Return the action that commands these SI values, clipped to the drive's limits."""
        limits = self.limits
        values = (
            insertion_velocity / limits.insertion_velocity,
            roll_rate / limits.roll_rate,
            2.0 * pull / limits.tendon_pull - 1.0,
            2.0 * pressure / limits.pressure - 1.0,
        )
        return np.clip(np.array(values, dtype=np.float32), -1.0, 1.0)


def _approach(value: float, target: float, step: float) -> float:
    """Return ``value`` moved towards ``target`` by at most ``step``."""
    if target > value:
        return min(value + step, target)
    return max(value - step, target)
