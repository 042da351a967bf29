"""The four drives as a hand sets them: sliders hold a value, keys move it for as long as they are pressed.

Keys count in the hand's own time, not in the robot's, which may run eight times as fast.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from enum import Enum

from evergym.envs.drive import DriveLimits
from evergym.units import DEG, KPA, MM

__all__ = ["HOLD_GAP", "KEY_SPEED", "KEY_TIME", "DriveName", "Hand"]


class DriveName(Enum):
    """The drives, in the order of the environments' actions."""

    INSERTION = "insertion"
    ROLL = "roll"
    PULL = "pull"
    PRESSURE = "pressure"


KEY_TIME = 0.55
"""How long a velocity lasts after a key [s of real time]: longer than the half second after which a key repeats."""
KEY_SPEED = 2.0 * MM
"""Insertion velocity of a key [m/s], the duty cycle's."""
HOLD_GAP = 0.12
"""A key that comes again within this time is held [s of real time]: longer than between repeats, shorter than taps."""
_STEP = {DriveName.PULL: 0.1 * MM, DriveName.PRESSURE: 1.0 * KPA}  # of a tap
_RATE = {DriveName.PULL: 2.0 * MM, DriveName.PRESSURE: 20.0 * KPA}  # while held, a second: the whole range in 2.5 s


class Hand:
    """Set points of a person's drives, SI units.

    A velocity set by a slider stays; one set by a key ends by itself soon after the key is let go, so that nobody who
    looks away drives through a wall. A tap moves pull or pressure by a step; a key that is held moves it at a rate,
    however often the keyboard repeats it.

    Args:
        limits: Of the drives.
        clock: Real time [s].
    """

    def __init__(self, limits: DriveLimits, clock: Callable[[], float] = time.monotonic) -> None:
        self.limits = limits
        self._clock = clock
        self.reset()

    def reset(self) -> None:
        """Let go of everything."""
        self.value = dict.fromkeys(DriveName, 0.0)
        self._end: dict[DriveName, float] = {}
        self._pressed: dict[DriveName, tuple[float, int]] = {}

    def set(self, drive: DriveName, value: float) -> None:
        """Set a drive, as a slider does; the value is limited to the drive's range."""
        low, high = self.range(drive)
        self.value[drive] = min(max(value, low), high)
        self._end.pop(drive, None)
        self._pressed.pop(drive, None)

    def press(self, drive: DriveName, direction: int, at: float | None = None) -> None:
        """Take one press (or one repeat) of a drive's key.

        Args:
            drive: The drive.
            direction: +1 or -1.
            at: When the key was pressed, by the clock [s]; None: now.
        """
        now = self._clock()
        if drive in _STEP:
            at = now if at is None else at
            before, towards = self._pressed.get(drive, (at - HOLD_GAP, 0))
            held = towards == direction and at - before < HOLD_GAP
            self.set(drive, self.value[drive] + direction * (_RATE[drive] * (at - before) if held else _STEP[drive]))
            self._pressed[drive] = at, direction
            return
        speed = KEY_SPEED if drive is DriveName.INSERTION else self.limits.roll_rate
        self.set(drive, direction * speed)
        self._end[drive] = now + KEY_TIME

    def stop(self) -> None:
        """Stop what moves: insertion and roll; pull and pressure stay."""
        for drive in (DriveName.INSERTION, DriveName.ROLL):
            self.set(drive, 0.0)

    def let_go(self) -> None:
        """End the velocities of keys that have not been pressed for a while."""
        now = self._clock()
        for drive, end in list(self._end.items()):
            if now >= end:
                self.set(drive, 0.0)

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
