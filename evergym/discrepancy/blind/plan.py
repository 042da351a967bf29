"""A planned bench run: the commands that a lab would send, before anything has been measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import COMMANDS, command_index
from evergym.discrepancy.data.dataset import Run

__all__ = ["ROW_S", "PlannedRun", "Profile", "convert_plan"]

Array = NDArray[np.float64]

ROW_S = 0.25
"""Time between two rows of the samples [s]: the rate of a bench camera and of its command log."""


@dataclass(frozen=True, eq=False)
class PlannedRun:
    """One run of the bench: setup, surroundings and commands; columns and units as in a dataset.

    Attributes:
        id: Name, unique in its dataset.
        experiment: Runs of the same experiment are repeats or variants of one another.
        setup: "full", "catheter" or "sheath".
        gravity: [m/s^2].
        initial_everted_length_mm: At the first row.
        time_s: Shape (k,).
        commands: Columns `evergym.discrepancy.data.columns.COMMANDS`, shape (k, 8); tail feed NaN: coupled.
        pegs: Rows x_mm, z_mm, diameter_mm; empty: free space.
    """

    id: str
    experiment: str
    setup: str
    gravity: tuple[float, float, float]
    initial_everted_length_mm: float
    time_s: Array
    commands: Array
    pegs: tuple[tuple[float, float, float], ...] = ()

    @property
    def duration(self) -> float:
        """Robot time [s]."""
        return float(self.time_s[-1])

    @property
    def peg_file(self) -> str:
        """Name of the table with the pegs; empty in free space."""
        return f"pegs-x{self.pegs[0][0]:g}-z{self.pegs[0][1]:g}.csv" if self.pegs else ""

    @property
    def environment(self) -> str:
        """As in a dataset."""
        return f"pegs:{self.peg_file}" if self.pegs else "free"

    def format_pegs(self) -> str:
        """Return the text of the table with the pegs."""
        rows = "".join(f"{x:g},{z:g},{diameter:g}\n" for x, z, diameter in self.pegs)
        return "x_mm,z_mm,diameter_mm\n" + rows

    def rename(self, run_id: str, experiment: str) -> PlannedRun:
        """Return the same run under another name."""
        return replace(self, id=run_id, experiment=experiment)


class Profile:
    """Builds the commands of a run from knots, sampled at the rows and held in between.

    Args:
        duration: [s]; rounded to whole rows.
    """

    def __init__(self, duration: float) -> None:
        self.time: Array = np.linspace(0.0, ROW_S * round(duration / ROW_S), round(duration / ROW_S) + 1)
        self.commands: Array = np.zeros((len(self.time), len(COMMANDS)))

    def hold(self, name: str, value: float) -> Profile:
        """Set a command for the whole run."""
        self.commands[:, command_index(name)] = value
        return self

    def steps(self, name: str, times: Sequence[float], values: Sequence[float]) -> Profile:
        """Set a command that jumps to each value at its time."""
        index = np.searchsorted(np.asarray(times), self.time + 1e-9, side="right") - 1
        self.commands[:, command_index(name)] = np.asarray(values, dtype=float)[np.maximum(index, 0)]
        return self

    def ramps(self, name: str, times: Sequence[float], values: Sequence[float]) -> Profile:
        """Set a command that moves in straight lines between the knots."""
        self.commands[:, command_index(name)] = np.interp(self.time, times, values)
        return self


def convert_plan(plan: PlannedRun, measured: Array | None = None, folder: Path = Path()) -> Run:
    """Return the run as the reader of datasets would give it; without measurements, all of them are NaN.

    Args:
        plan: The run.
        measured: Shape (k, 9).
        folder: Where the tables of pegs are.
    """
    values = np.full((len(plan.time_s), 9), np.nan) if measured is None else measured
    return Run(
        id=plan.id,
        setup=plan.setup,
        gravity=plan.gravity,
        experiment=plan.experiment,
        environment=plan.environment,
        initial_everted_length_mm=plan.initial_everted_length_mm,
        time_s=plan.time_s,
        commands=plan.commands,
        measured=values,
        folder=folder,
    )
