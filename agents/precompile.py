"""``python -m evergym.agents.precompile``: compile the kernels once, at set-up, so that no first run has to wait."""

from __future__ import annotations

import multiprocessing
import sys
import time
from concurrent.futures import ProcessPoolExecutor

from evergym.agents.env_factory import probe_env

__all__ = ["main"]


TASKS = ("MammobotDuct-v0", "MammobotPegs-v0")


def _compile(name: str) -> None:
    probe_env(name, {"observation": "state+image"})


def main() -> int:
    """Make one environment of each task and step it; the kernels stay in the user's cache. Returns the exit code."""
    print("Compiling the simulator (up to five minutes on a slow machine, once)", flush=True)
    start = time.monotonic()
    # The anatomies are of different types, for which kernels are compiled anew: in a process each, at the same time.
    with ProcessPoolExecutor(len(TASKS), multiprocessing.get_context("spawn")) as processes:
        list(processes.map(_compile, TASKS))
    print(f"Compiled in {time.monotonic() - start:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
