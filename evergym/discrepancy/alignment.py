"""Which command a row's measurement belongs to, where a lab has not written what the format says.

The format holds a row's commands from its time on, so its measurements belong to the commands of the row before, and
the robot rests under the first row's commands. Two habits differ, and would pass for a lag or a missing effect:

- from zero: the robot was at rest without any command, and the first row's commands were its first.
- same row: in a table of held points, each row has a command and what was read under it.

A run is taken so only where that explains it far better than the format's own reading does; nothing is shifted by less
than a row of a table.
"""

from __future__ import annotations

import dataclasses
import math
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import CHANNELS, COMMANDS, RATES
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.simulate import simulate_run
from evergym.model import Model

__all__ = ["Alignment", "align_dataset", "find_alignment", "is_table", "realign"]

Array = NDArray[np.float64]

SET_POINTS = [i for i in range(len(COMMANDS)) if i not in RATES]
TAIL = COMMANDS.index("tail_feed_mm_s")
REST_S = 1e-3
"""Time before the first row at which the robot rests without a command [s]."""
TABLE_ROWS = (4, 300)
TABLE_HOLD_S = 0.5
"""Shortest time for which a table's point is held [s]."""
START_SIGMAS = 5.0
"""A start from zero must explain the change from the first row to the second by so much better."""
START_SHARE = 0.5
"""... and leave at most this share of it."""
SHIFT_SHARE = 0.8
"""A shift by a row must leave at most this share of the changes' mean residual. Under a model with a third of the
robot's backlash the right reading leaves 0.6 of the wrong one's, a needless shift 3 times the right one's."""
SHIFT_SIGMAS = 1.0
"""... and at least this much less of it."""


class Alignment(Enum):
    """How the rows of a run are to be read."""

    AS_WRITTEN = "as written"
    FROM_ZERO = "the robot started without any command"
    SAME_ROW = "a row's measurements belong to its own commands"


def align_dataset(model: Model, dataset: Dataset) -> tuple[Dataset, tuple[str, ...]]:
    """Return the dataset with every run as the format means it, and a remark for each run that was read otherwise.

    Args:
        model: With the dataset's overrides.
        dataset: As written.
    """
    runs, remarks = [], []
    for run in dataset.runs:
        alignment = find_alignment(model, dataset, run)
        runs.append(realign(run, alignment))
        if alignment is not Alignment.AS_WRITTEN:
            remarks.append(f"run '{run.id}': {alignment.value}; read so, because it fits far better than the format")
    return dataclasses.replace(dataset, runs=tuple(runs)), tuple(remarks)


def find_alignment(model: Model, dataset: Dataset, run: Run) -> Alignment:
    """Return how a run is to be read, by what ``model`` predicts each way."""
    sigma = np.array([dataset.noise.get(name, np.nan) for name in CHANNELS])
    starts = len(run.time_s) > 1 and bool(np.isfinite(run.measured[:2]).all(axis=0).any())
    starts = starts and bool(np.any(run.commands[0, SET_POINTS] != 0.0))
    table = is_table(run)
    if not starts and not table:
        return Alignment.AS_WRITTEN
    written = _compute_residual(model, run, Alignment.AS_WRITTEN, sigma)
    if table:
        other = _compute_residual(model, run, Alignment.SAME_ROW, sigma)
        both = np.isfinite(written) & np.isfinite(other)  # a robot that the model cannot play is not compared
        if both.any():
            # The absolute value, so that one point that the model misses does not decide.
            as_written, shifted = (float(np.mean(np.abs(residual[both]))) for residual in (written, other))
            if shifted < min(SHIFT_SHARE * as_written, as_written - SHIFT_SIGMAS):
                return Alignment.SAME_ROW
    if starts:
        other = _compute_residual(model, run, Alignment.FROM_ZERO, sigma)
        both = np.isfinite(written[0]) & np.isfinite(other[0])
        if both.any():
            as_written, shifted = (float(np.sqrt(np.mean(residual[0][both] ** 2))) for residual in (written, other))
            if shifted < min(START_SHARE * as_written, as_written - START_SIGMAS):
                return Alignment.FROM_ZERO
    return Alignment.AS_WRITTEN


def is_table(run: Run) -> bool:
    """Whether a run is a table of held points, each row with a command of its own and a measurement."""
    count = len(run.time_s)
    if not TABLE_ROWS[0] <= count <= TABLE_ROWS[1] or np.min(np.diff(run.time_s)) < TABLE_HOLD_S:
        return False
    feeds = np.any(run.commands[:, RATES] > 0.0) or np.any(run.commands[:, RATES] < 0.0)
    changes = np.any(np.diff(run.commands[:, SET_POINTS], axis=0) != 0.0, axis=1)
    measured = np.isfinite(run.measured).any(axis=1)
    return not feeds and 2 * int(changes.sum()) >= count - 1 and 5 * int(measured.sum()) >= 4 * count


def realign(run: Run, alignment: Alignment) -> Run:
    """Return a run with a row before its first, so that it means by the format what ``alignment`` says."""
    if alignment is Alignment.AS_WRITTEN:
        return run
    if alignment is Alignment.FROM_ZERO:
        rest = np.zeros(len(COMMANDS))
        rest[TAIL] = np.nan
        time = np.concatenate(([run.time_s[0] - REST_S], run.time_s))
        commands = np.vstack((rest, run.commands))
    else:
        time = np.concatenate(([2.0 * run.time_s[0] - run.time_s[1]], run.time_s))
        commands = np.vstack((run.commands, run.commands[-1:]))
    measured = np.vstack((np.full(len(CHANNELS), np.nan), run.measured))
    for array in (time, commands, measured):
        array.flags.writeable = False
    return dataclasses.replace(run, time_s=time, commands=commands, measured=measured)


def _compute_residual(model: Model, run: Run, alignment: Alignment, sigma: Array) -> Array:
    """Return what the model misses of the change from each row to the next, in sigmas, shape (k - 1, 9).

    Changes, not values: an effect that the model lacks shifts many rows, a wrong alignment each change.
    """
    aligned = realign(run, alignment)
    difference = (aligned.measured - simulate_run(model, aligned))[len(aligned.time_s) - len(run.time_s) :]
    residual: Array = np.diff(difference, axis=0) / (math.sqrt(2.0) * sigma)
    return residual
