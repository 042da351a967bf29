"""One experiment: its conditions, what was measured, what the paper's simulator gave, and how far another is off."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evergym.errors import ConfigError

__all__ = ["ErrorMeasure", "Experiment"]


class ErrorMeasure(Enum):
    """How the difference between two sets of values becomes one number."""

    ABSOLUTE = "mean absolute error"
    DISTANCE = "mean distance"
    """The values are pairs of coordinates (lateral, axial), one pair after the other."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """An experiment of the paper. Values are in `unit`, the one of the paper's Table II; conditions are SI.

    Attributes:
        name: Name in tables, options and files.
        title: What was done, in words.
        unit: Unit of the values and errors.
        resolution: Half the step of the authors' reading, in `unit`.
        points: One row per value, in order; columns are the conditions [SI].
        measured: Values of the real robot, shape (n,), read-only.
        paper_simulated: Values of the paper's simulator, shape (n,), read-only; None where the paper shows none.
        paper_printed: The error that the paper prints in Table II; None where it prints none.
        measure: How errors are computed.
        note: What must be known to read the numbers; empty if nothing.
    """

    name: str
    title: str
    unit: str
    resolution: float
    points: pd.DataFrame
    measured: NDArray[np.float64]
    paper_simulated: NDArray[np.float64] | None
    paper_printed: float | None
    measure: ErrorMeasure = ErrorMeasure.ABSOLUTE
    note: str = ""

    def __post_init__(self) -> None:
        for values in (self.measured, self.paper_simulated):
            if values is not None:
                self._check(values)
                values.setflags(write=False)

    @property
    def paper_recomputed(self) -> float | None:
        """Error of the paper's simulator on these data; None where the paper shows no simulation."""
        return None if self.paper_simulated is None else self.compute_error(self.paper_simulated)

    def compute_deviations(self, simulated: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return simulated minus measured for each value, shape (n,), or the distance of each pair, shape (n / 2,).

        Raises:
            ConfigError: ``simulated`` has another number of values, or one that is not finite.
        """
        self._check(simulated)
        difference = np.asarray(simulated, dtype=np.float64) - self.measured
        if self.measure is ErrorMeasure.DISTANCE:
            return np.hypot(difference[0::2], difference[1::2])
        return difference

    def compute_error(self, simulated: NDArray[np.float64]) -> float:
        """Return the mean absolute error, or the mean distance, against the real robot.

        Raises:
            ConfigError: ``simulated`` has another number of values, or one that is not finite.
        """
        return float(np.mean(np.abs(self.compute_deviations(simulated))))

    def _check(self, values: NDArray[np.float64]) -> None:
        if np.shape(values) != (len(self.points),):
            raise ConfigError(
                f"Experiment {self.name} has {len(self.points)} values, but an array of shape {np.shape(values)} was "
                f"given. Give one value [{self.unit}] per row of its points, in their order."
            )
        if not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values))[0])
            raise ConfigError(
                f"Experiment {self.name}, row {row}: the value is {values[row]}. Every value must be a finite number "
                f"[{self.unit}]."
            )
