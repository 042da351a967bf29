"""Simulate runs in several processes at once."""

from __future__ import annotations

import dataclasses
import multiprocessing
import signal
import traceback
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import COMMANDS
from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.data.rig import Fidelity, choose_numerics
from evergym.discrepancy.hook import UserEffect
from evergym.discrepancy.setting import Setting
from evergym.discrepancy.simulate import Prediction, try_simulate_run
from evergym.errors import ConfigError, EvergymError

__all__ = ["Workers", "simulate_setting"]

Array = NDArray[np.float64]

Task = tuple[Setting, int, Fidelity]

PULL = COMMANDS.index("tendon_pull_mm")
PIECES = 4
"""Pieces of work per process and call: enough for slow runs to even out."""


class Workers:
    """Processes that know the runs of a dataset.

    They are forked, so that nothing is imported or compiled again; a system that cannot fork works in one process.

    Args:
        runs: Of the dataset.
        user_effects: The user's own effects by name.
        jobs: Number of processes.
    """

    def __init__(self, runs: Sequence[Run], user_effects: Mapping[str, UserEffect], jobs: int) -> None:
        self.jobs = jobs
        self._pool: ProcessPoolExecutor | None = None
        if jobs > 1 and "fork" in multiprocessing.get_all_start_methods():
            context = multiprocessing.get_context("fork")
            self._pool = ProcessPoolExecutor(jobs, context, _remember, (tuple(runs), dict(user_effects)))

    @property
    def active(self) -> bool:
        """Whether there are processes beside this one."""
        return self._pool is not None

    def simulate(self, tasks: Sequence[Task]) -> list[Prediction]:
        """Return the predictions of (setting, index of the run, fidelity), in order."""
        assert self._pool is not None
        size = max(1, len(tasks) // (self.jobs * PIECES))
        return list(self._pool.map(_simulate, tasks, chunksize=size))

    def close(self) -> None:
        """End the processes."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None


def simulate_setting(
    setting: Setting, run: Run, fidelity: Fidelity, user_effects: Mapping[str, UserEffect]
) -> Prediction:
    """Return what a model with the user's own effects predicts for a run."""
    hooks = tuple(user_effects[name].create_hook(dict(values)) for name, values in setting.user)
    numerics = choose_numerics(setting.model, run.setup, fidelity)
    run = _limit_pull(run, setting.pull_limit_mm)
    if not hooks:
        return try_simulate_run(setting.model, run, numerics)
    try:
        return try_simulate_run(setting.model, run, numerics, hooks)
    except EvergymError:
        raise
    except Exception as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        names = " or ".join(name for name, _ in setting.user)
        raise ConfigError(
            f"{frame.filename}, line {frame.lineno}: your own effect {names} failed in run '{run.id}': "
            f"{type(error).__name__}: {error}. Mend it, or leave it out of EFFECTS."
        ) from error


def _limit_pull(run: Run, limit_mm: float) -> Run:
    """Return a run as a tendon drive does it that goes no farther than ``limit_mm``."""
    if not np.any(run.commands[:, PULL] > limit_mm):
        return run
    commands = run.commands.copy()
    commands[:, PULL] = np.minimum(commands[:, PULL], limit_mm)
    return dataclasses.replace(run, commands=commands)


_known: dict[str, tuple[tuple[Run, ...], dict[str, UserEffect]]] = {}


def _remember(runs: tuple[Run, ...], user_effects: dict[str, UserEffect]) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # whoever started this process ends it so, without a word
    _known["dataset"] = runs, user_effects


def _simulate(task: Task) -> Prediction:
    setting, index, fidelity = task
    runs, user_effects = _known["dataset"]
    return simulate_setting(setting, runs[index], fidelity, user_effects)
