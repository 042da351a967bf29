"""Regimes: what the robot was being told to do at each sample, read from the commands alone.

The labels of a sample depend on the dataset's commands and nothing else, so two people who look at the same runs (or at
the noise-free signals behind them) speak of the same cells "channel x regime". A sample has several labels: one of each
family that applies to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.dataset import Run

__all__ = ["REGIMES", "label_regimes"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

INSERTION, TAIL_FEED, ROLL, TENDON, PRESSURE, LOAD = 0, 1, 2, 3, 4, slice(5, 8)

SETTLING_S = 2.0
"""A pressure or roll counts as changing for this long after the command has changed [s]."""

REVERSAL_SHARE = 0.2
"""A drive counts as reversing until it has come back by this share of the way that it covers in the run."""

REGIMES: dict[str, str] = {
    "growing": "the tail is fed",
    "holding": "neither fed nor pulled back",
    "retracting": "the tail is pulled back",
    "tendon pulling": "the pull increases, or was increased last",
    "tendon releasing": "the pull decreases, or was decreased last",
    "tendon reversal": "the pull has just changed its direction",
    "no tendon pull": "the tendon is not pulled",
    "low pressure": "the lowest third of the pressures commanded",
    "middle pressure": "the middle third of the pressures commanded",
    "high pressure": "the highest third of the pressures commanded",
    "pressure changing": "the pressure was commanded to change within the last 2 s",
    "turning": "the roll was commanded to change within the last 2 s",
    "roll reversal": "the roll has just changed its direction",
    "rolled": "the roll is more than 30 degrees away from zero",
    "tip load": "a force is on the tip",
    "short": "the shortest third of the lengths that the commands lead to",
    "long": "the longest third of the lengths that the commands lead to",
    "start of the run": "the first tenth of the run",
    "end of the run": "the last third of the run",
    "obstacles": "pegs or a duct around the robot",
    "catheter alone": "no sheath",
    "sheath alone": "no catheter",
}
"""Every regime and what it means."""


def label_regimes(runs: Sequence[Run]) -> list[dict[str, Mask]]:
    """Return, for every run, the samples (k,) of each regime; regimes without a sample are left out."""
    lengths = [_commanded_length(run) for run in runs]
    pressures = [np.concatenate((run.commands[:1, PRESSURE], run.commands[:-1, PRESSURE])) for run in runs]
    length_edges = _thirds(lengths)
    pressure_edges = _thirds(pressures)
    table = []
    # What a row measures was read before the row's own commands acted: its regime is that of the row before.
    runs = [replace(run, commands=np.vstack((run.commands[:1], run.commands[:-1]))) for run in runs]
    for run, length, pressure in zip(runs, lengths, pressures, strict=True):
        labels = _label_drives(run)
        labels |= _label_levels(pressure, pressure_edges, ("low pressure", "middle pressure", "high pressure"))
        if run.setup != "catheter":
            labels |= _label_levels(length, length_edges, ("short", None, "long"))
        elapsed = (run.time_s - run.time_s[0]) / max(run.time_s[-1] - run.time_s[0], 1e-9)
        labels["start of the run"] = elapsed < 0.1
        labels["end of the run"] = elapsed > 2.0 / 3.0
        everywhere = np.ones(len(run.time_s), dtype=bool)
        labels["obstacles"] = everywhere & (run.environment != "free")
        labels["catheter alone"] = everywhere & (run.setup == "catheter")
        labels["sheath alone"] = everywhere & (run.setup == "sheath")
        table.append({name: labels[name] for name in REGIMES if name in labels and labels[name].any()})
    return table


def _label_drives(run: Run) -> dict[str, Mask]:
    commands, time = run.commands, run.time_s
    tail = np.where(np.isnan(commands[:, TAIL_FEED]), 2.0 * commands[:, INSERTION], commands[:, TAIL_FEED])
    pull, roll = commands[:, TENDON], commands[:, ROLL]
    direction, reversing = _follow(pull)
    _, roll_reversing = _follow(roll)
    pulled = pull > 0.0
    has_sheath = run.setup != "catheter"
    return {
        "growing": has_sheath & (tail > 0.0),
        "holding": (tail == 0.0) if has_sheath else np.zeros(len(time), dtype=bool),
        "retracting": has_sheath & (tail < 0.0),
        "tendon pulling": (direction > 0) & ~reversing & pulled,
        "tendon releasing": (direction < 0) & ~reversing,
        "tendon reversal": reversing,
        "no tendon pull": ~pulled & (direction == 0),
        "pressure changing": _recently_changed(time, commands[:, PRESSURE]),
        "turning": _recently_changed(time, roll),
        "roll reversal": roll_reversing,
        "rolled": np.abs(np.mod(roll + 180.0, 360.0) - 180.0) > 30.0,
        "tip load": np.any(commands[:, LOAD] != 0.0, axis=1),
    }


def _label_levels(value: Array, edges: tuple[float, float], names: tuple[str | None, ...]) -> dict[str, Mask]:
    if edges[0] >= edges[1]:
        return {}
    masks = (value <= edges[0], (value > edges[0]) & (value <= edges[1]), value > edges[1])
    return {name: mask for name, mask in zip(names, masks, strict=True) if name is not None}


def _thirds(values: Sequence[Array]) -> tuple[float, float]:
    """Return the values a third and two thirds of the way through the range (not the samples: those pile up)."""
    low = min((float(np.min(value)) for value in values), default=0.0)
    high = max((float(np.max(value)) for value in values), default=0.0)
    return low + (high - low) / 3.0, low + 2.0 * (high - low) / 3.0


def _commanded_length(run: Run) -> Array:
    """Return the length [mm] that the fed tail could have become; nothing that was measured enters."""
    tail = np.where(np.isnan(run.commands[:, 1]), 2.0 * run.commands[:, 0], run.commands[:, 1])
    fed = np.concatenate(([0.0], np.cumsum(0.5 * tail[:-1] * np.diff(run.time_s))))
    length: Array = np.maximum(run.initial_everted_length_mm + fed, 0.0)
    return length


def _recently_changed(time: Array, value: Array) -> Mask:
    changed = np.concatenate(([False], np.diff(value) != 0.0))
    last = np.maximum.accumulate(np.where(changed, time, -np.inf))
    recent: Mask = time - last <= SETTLING_S
    return recent


def _follow(value: Array) -> tuple[NDArray[np.int64], Mask]:
    """Return the last direction of motion at every sample, and whether it reversed a short way ago."""
    count = len(value)
    direction = np.zeros(count, dtype=np.int64)
    reversing = np.zeros(count, dtype=bool)
    span = float(np.ptp(value))
    sign, turning_point, turned = 0, 0.0, False
    for i in range(1, count):
        step = value[i] - value[i - 1]
        if step != 0.0:
            new = 1 if step > 0.0 else -1
            if sign != 0 and new != sign:
                turning_point, turned = value[i - 1], True
            sign = new
        direction[i] = sign
        reversing[i] = turned and abs(value[i] - turning_point) <= REVERSAL_SHARE * span and sign != 0
    return direction, reversing
