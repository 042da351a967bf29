"""Progress with time left: a bar in a terminal, a line every few seconds in a log."""

from __future__ import annotations

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as RichProgress

__all__ = ["ProgressReport", "format_duration"]

_LOG_INTERVAL = 10.0  # [s] between lines when the output is not a terminal


def format_duration(seconds: float) -> str:
    """Write seconds as people say them: ``42 s``, ``3 min 05 s``, ``2 h 10 min``."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


class ProgressReport:
    """Shows how much of a task is done, how fast it goes and how long it will still take.

    Args:
        title: What is being done.
        total: Amount of work in units.
        done: Units finished before (a resumed task); they do not count for the speed.
        unit: Name of a unit, in the plural.
        time_budget: The task ends after this time at the latest [s]; None: no limit.
    """

    def __init__(self, title: str, total: int, done: int = 0, unit: str = "steps", time_budget: float | None = None):
        self._title, self._total, self._unit, self._budget = title, max(total, 1), unit, time_budget
        self._done = self._done_before = done
        self._note = ""
        self._start = self._last_line = time.monotonic()
        self._bar: RichProgress | None = None
        if sys.stderr.isatty():
            columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[text]}"))
            self._bar = RichProgress(*columns, TimeElapsedColumn(), console=Console(stderr=True))
            self._task = self._bar.add_task(title, total=self._total, completed=done, text="")

    def __enter__(self) -> ProgressReport:
        if self._bar is not None:
            self._bar.start()
        else:
            self._write_line()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
        elif kind is None:
            self._write_line()

    def update(self, done: int, note: str = "") -> None:
        """Set the number of finished units and a short note such as the success rate."""
        self._done, self._note = done, note or self._note
        now = time.monotonic()
        if self._bar is not None:
            self._bar.update(self._task, completed=done, text=self._describe())
        elif now - self._last_line >= _LOG_INTERVAL:
            self._write_line()

    def _describe(self) -> str:
        elapsed = time.monotonic() - self._start
        speed = (self._done - self._done_before) / elapsed if elapsed > 0 else 0.0
        parts = [f"{self._done:,}/{self._total:,} {self._unit}"]
        left: list[float] = []
        enough = 0.005 * (self._total - self._done_before)  # the first units say little: workers are starting
        if speed > 0 and self._done - self._done_before >= enough:
            parts.append(f"{speed:,.0f}/s" if speed >= 10 else f"{speed:.2g}/s")
            left.append((self._total - self._done) / speed)
        if self._budget is not None:
            left.append(self._budget - elapsed)
        if left and self._done < self._total:
            parts.append(f"{format_duration(min(left))} left")
        if self._note:
            parts.append(self._note)
        return ", ".join(parts)

    def _write_line(self) -> None:
        self._last_line = time.monotonic()
        share = min(100, int(100 * self._done / self._total))
        print(f"{self._title}: {share:3d} %  {self._describe()}", file=sys.stderr, flush=True)
