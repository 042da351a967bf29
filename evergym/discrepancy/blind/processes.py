"""Processes of a campaign: started in a group of their own, so that one that is stopped leaves nothing running."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from evergym.errors import RunError

__all__ = ["Ended", "Processes"]


class Ended(NamedTuple):
    """How a process ended."""

    code: int
    output: str
    message: str


class Processes:
    """Runs modules with this interpreter, and can stop all that run."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def run(
        self,
        module: str,
        words: Sequence[str],
        place: Path | None = None,
        environment: Mapping[str, str] | None = None,
        time_limit: float | None = None,
    ) -> Ended:
        """Run a module to its end.

        Args:
            module: Import path.
            words: Its arguments.
            place: Working folder; None: this process's.
            environment: None: this process's.
            time_limit: [s]; then it is killed.

        Raises:
            RunError: All processes have been stopped.
        """
        arguments = [sys.executable, "-m", module, *words]
        with self._lock:
            if self._stopped:
                raise RunError("The campaign was stopped.")
            # A session of its own: Ctrl-C reaches the campaign only, which then ends its processes in order.
            process = subprocess.Popen(  # noqa: S603  (this interpreter, words of our own)
                arguments,
                cwd=place,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
            self._running.add(process)
        try:
            output, message = process.communicate(timeout=time_limit)
        except subprocess.TimeoutExpired:
            _kill(process)
            output, message = process.communicate()
            message += f"\nStopped after {time_limit:g} s."
        finally:
            with self._lock:
                self._running.discard(process)
        if self._stopped:
            raise RunError("The campaign was stopped.")
        return Ended(process.returncode, output, message)

    def stop(self) -> None:
        """Kill what runs and refuse to start anything more."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                _kill(process)


def _kill(process: subprocess.Popen[str]) -> None:
    try:
        os.killpg(process.pid, signal.SIGKILL)  # with the processes that it has started
    except ProcessLookupError:
        return
