"""A dataset of measured runs: ``dataset.toml`` and ``samples.csv`` (or ``.parquet``), as the diagnosis takes them.

`evergym.discrepancy.data.reading.load_dataset` reads one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import CHANNELS, COMMANDS

__all__ = ["CHANNELS", "COMMANDS", "Dataset", "Run"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Run:
    """One measured run; its arrays are read-only.

    The robot rests under the commands of the first row when the run begins. Each row's commands hold until the next
    row (zero-order hold), and each row's measurements are taken at its time, before its own commands act.

    Attributes:
        id: Name, unique in its dataset.
        setup: "full", "catheter" (no sheath) or "sheath" (no catheter).
        gravity: [m/s^2].
        experiment: Runs of the same experiment are repeats or variants of one another.
        environment: "free", "pegs:<file>" or "duct:<file>", the file relative to ``folder``.
        initial_everted_length_mm: At the first row.
        time_s: Shape (k,).
        commands: Columns `COMMANDS`, in their units, already held forward, shape (k, 8); tail feed NaN: coupled.
        measured: Columns `CHANNELS`, in their units, shape (k, 9); NaN: not measured, ignored, or set aside.
        signed_angles: Angles and curvatures carry a sign, positive towards +x; else they are 0 to 180 degrees.
        folder: The dataset's, to which the environment's file is relative.
    """

    id: str
    setup: str
    gravity: tuple[float, float, float]
    experiment: str
    environment: str
    initial_everted_length_mm: float
    time_s: Array
    commands: Array
    measured: Array
    signed_angles: bool = False
    folder: Path = Path()


@dataclass(frozen=True, eq=False)
class Dataset:
    """Measured runs of one robot.

    Attributes:
        name: Of the dataset.
        description: Free text.
        noise: One standard deviation of each measured channel, in the channel's unit.
        robot: Keys of the model file's ``[robot]`` that differ on this rig.
        ignore: Channels left out; they are NaN in every run.
        runs: In the order of ``dataset.toml``.
        set_aside: (row as in an editor, why) of rows that the robot cannot have produced; their measurements are NaN.
        path: The folder.
    """

    name: str
    description: str
    noise: Mapping[str, float]
    robot: Mapping[str, float]
    ignore: tuple[str, ...]
    runs: tuple[Run, ...]
    set_aside: tuple[tuple[int, str], ...]
    path: Path

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that at least one run has measured, in the order of `CHANNELS`."""
        return tuple(
            name for i, name in enumerate(CHANNELS) if any(np.isfinite(run.measured[:, i]).any() for run in self.runs)
        )

    @property
    def duration(self) -> float:
        """Robot time of all runs together [s]."""
        return float(sum(run.time_s[-1] - run.time_s[0] for run in self.runs))
