"""The clock: robot time keeps pace with real time, and everything happens in the one thread that calls it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

__all__ = ["Pace", "run_paced"]

_PATIENCE = 0.25  # [s] behind which the clock gives up what it has missed: better slow than jumping


class Pace:
    """How fast frames come.

    Attributes:
        rate: Frames per second over the last second or so.
        busy: Part of the time that is spent working, 0..1.
    """

    def __init__(self) -> None:
        self.rate = 0.0
        self.busy = 0.0
        self._count = 0
        self._work = 0.0
        self._since = time.monotonic()

    def add(self, work: float) -> None:
        """Count a frame that took ``work`` seconds."""
        self._count += 1
        self._work += work
        span = time.monotonic() - self._since
        if span >= 1.0:
            self.rate, self.busy = self._count / span, self._work / span
            self._count, self._work, self._since = 0, 0.0, time.monotonic()


def run_paced(step: Callable[[], None], interval: float, stop: threading.Event, pace: Pace | None = None) -> None:
    """Call ``step`` every ``interval`` seconds until ``stop`` is set.

    Args:
        step: Does what there is to do for one frame.
        interval: [s]
        stop: Ends the loop, from any thread.
        pace: Counts the frames.
    """
    due = time.monotonic()
    while not stop.is_set():
        begin = time.monotonic()
        step()
        now = time.monotonic()
        if pace is not None:
            pace.add(now - begin)
        due = max(due + interval, now - _PATIENCE)
        if due > now:
            stop.wait(due - now)
