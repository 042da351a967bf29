"""Run every experiment with every parameter set, and put the errors beside the paper's."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import joblib
import numpy as np
from numpy.typing import NDArray

from evergym.errors import SimulationDiverged
from evergym.experiments.experiment import Experiment
from evergym.experiments.parameter_sets import Column, ParameterSets
from evergym.model import Model

__all__ = ["Comparison", "ExperimentResult", "Simulate", "compare"]

Simulate = Callable[[Model, str], NDArray[np.float64]]
"""A model and the name of an experiment -> its values, in the experiment's unit and the order of its points."""


@dataclass(frozen=True, eq=False)
class ExperimentResult:
    """An experiment and what the models give for it.

    Attributes:
        experiment: The experiment.
        values: Values of the columns that have one for every point [the experiment's unit], shape (n,).
    """

    experiment: Experiment
    values: dict[Column, NDArray[np.float64]]

    def compute_error(self, column: Column) -> float | None:
        """Return the error of a column, None where it has no values."""
        values = self.values.get(column)
        return None if values is None else self.experiment.compute_error(values)

    def make_row(self) -> dict[str, Any]:
        """Return the row of the table, as ``--json`` prints it."""
        experiment = self.experiment
        return {
            "experiment": experiment.name,
            "unit": experiment.unit,
            "paper_printed": experiment.paper_printed,
            "paper_recomputed": experiment.paper_recomputed,
            **{column.value: self.compute_error(column) for column in Column},
            "resolution": experiment.resolution,
        }


@dataclass(frozen=True, eq=False)
class Comparison:
    """The results of all experiments, in their order, and the time that took [s]."""

    results: tuple[ExperimentResult, ...]
    seconds: float

    def find(self, name: str) -> ExperimentResult | None:
        """Return the result of an experiment, None where it was not run."""
        return next((result for result in self.results if result.experiment.name == name), None)


class _Job(NamedTuple):
    result: int
    column: Column
    set_name: str
    model: Model
    experiment: str
    rows: list[int]


def compare(
    experiments: Sequence[Experiment],
    sets: ParameterSets,
    simulate: Simulate,
    *,
    workers: int = 1,
    follow: Callable[[Iterable[Any], int], Iterable[Any]] | None = None,
) -> Comparison:
    """Simulate the experiments with all parameter sets.

    Args:
        experiments: What to compare.
        sets: The models.
        simulate: Runs an experiment's bench protocol through the simulator.
        workers: Processes; 1: this one.
        follow: Wraps the stream of finished simulations, whose number is its second argument, to show progress.

    Raises:
        SimulationDiverged: A protocol did not run to its end; the message names it and the parameter set.
        ConfigError: A protocol returned another number of values, or none that is finite.
    """
    start = time.perf_counter()
    values = [
        {column: np.full(len(experiment.points), np.nan) for column in Column if sets.assign(column, experiment)}
        for experiment in experiments
    ]
    jobs = [
        _Job(index, column, set_name, model, experiment.name, rows)
        for index, experiment in enumerate(experiments)
        for column in Column
        for set_name, (model, rows) in sets.assign(column, experiment).items()
    ]
    if workers == 1 or len(jobs) < 2:
        stream: Iterable[Any] = (_run(simulate, job) for job in jobs)
    else:
        stream = joblib.Parallel(n_jobs=workers, return_as="generator")(
            joblib.delayed(_run)(simulate, job) for job in jobs
        )
    for job, simulated in zip(jobs, follow(stream, len(jobs)) if follow else stream, strict=True):
        experiments[job.result].compute_deviations(simulated)  # the right number of values, all finite
        values[job.result][job.column][job.rows] = simulated[job.rows]
    results = tuple(
        ExperimentResult(experiment, {column: array for column, array in own.items() if np.isfinite(array).all()})
        for experiment, own in zip(experiments, values, strict=True)
    )
    return Comparison(results, time.perf_counter() - start)


def _run(simulate: Simulate, job: _Job) -> NDArray[np.float64]:
    try:
        return np.asarray(simulate(job.model, job.experiment), dtype=np.float64)
    except SimulationDiverged as error:
        raise SimulationDiverged(f"Experiment {job.experiment}, parameter set {job.set_name!r}: {error}") from error
