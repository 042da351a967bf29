"""The four drives as a hand sets them: sliders hold a value, keys move it for as long as they are pressed."""

from __future__ import annotations

from enum import Enum

from evergym.envs.drive import DriveLimits
from evergym.units import DEG, KPA, MM

__all__ = ["KEY_SPEED", "KEY_TIME", "DriveName", "Hand"]


class DriveName(Enum):
    """The drives, in the order of the environments' actions."""

    INSERTION = "insertion"
    ROLL = "roll"
    PULL = "pull"
    PRESSURE = "pressure"


KEY_TIME = 0.55
"""How long a velocity lasts after a key [s of robot time]: longer than the half second after which a key repeats."""
KEY_SPEED = 2.0 * MM
"""Insertion velocity of a key [m/s], the duty cycle's."""
_STEP = {DriveName.PULL: 0.1 * MM, DriveName.PRESSURE: 1.0 * KPA}  # of a key; a held one repeats some 30 times a second


class Hand:
    """Set points of a person's drives, SI units.

    A velocity set by a slider stays; one set by a key ends by itself soon after the key is let go, so that nobody who
    looks away drives through a wall.

    Args:
        limits: Of the drives.
    """

    def __init__(self, limits: DriveLimits) -> None:
        self.limits = limits
        self.reset()

    def reset(self) -> None:
        """Let go of everything."""
        self.value = dict.fromkeys(DriveName, 0.0)
        self._left: dict[DriveName, float] = {}

    def set(self, drive: DriveName, value: float) -> None:
        """Set a drive, as a slider does; the value is limited to the drive's range."""
        low, high = self.range(drive)
        self.value[drive] = min(max(value, low), high)
        self._left.pop(drive, None)

    def press(self, drive: DriveName, direction: int) -> None:
        """Take one press (or one repeat) of a drive's key; ``direction`` is +1 or -1."""
        if drive in _STEP:
            self.set(drive, self.value[drive] + direction * _STEP[drive])
            return
        speed = KEY_SPEED if drive is DriveName.INSERTION else self.limits.roll_rate
        self.set(drive, direction * speed)
        self._left[drive] = KEY_TIME

    def stop(self) -> None:
        """Stop what moves: insertion and roll; pull and pressure stay."""
        for drive in (DriveName.INSERTION, DriveName.ROLL):
            self.set(drive, 0.0)

    def pass_time(self, duration: float) -> None:
        """Let robot time pass [s]; a key's velocity ends."""
        for drive, left in list(self._left.items()):
            if left <= duration + 1e-9:
                self.set(drive, 0.0)
            else:
                self._left[drive] = left - duration

    def range(self, drive: DriveName) -> tuple[float, float]:
        """Return the least and the largest value of a drive."""
        limits = self.limits
        return {
            DriveName.INSERTION: (-limits.insertion_velocity, limits.insertion_velocity),
            DriveName.ROLL: (-limits.roll_rate, limits.roll_rate),
            DriveName.PULL: (0.0, limits.tendon_pull),
            DriveName.PRESSURE: (0.0, limits.pressure),
        }[drive]

    @staticmethod
    def unit(drive: DriveName) -> tuple[str, float]:
        """Return the unit that people read a drive in, and its size in SI."""
        return {
            DriveName.INSERTION: ("mm/s", MM),
            DriveName.ROLL: ("deg/s", DEG),
            DriveName.PULL: ("mm", MM),
            DriveName.PRESSURE: ("kPa", KPA),
        }[drive]
