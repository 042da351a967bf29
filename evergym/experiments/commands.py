"""The command ``evergym validate``."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track

from evergym.experiments.comparison import Comparison, compare
from evergym.experiments.paper import EXPERIMENTS, TABLE_EXPERIMENTS, load_experiment
from evergym.experiments.parameter_sets import FITTED_MODEL, ParameterSets, load_parameter_sets
from evergym.experiments.provenance import ParameterRecord, describe_parameters, read_model_text
from evergym.experiments.report import find_misses, make_table, write_report
from evergym.model import load_model

__all__ = ["Validate", "make_json"]

DEFAULT_FOLDER = Path("validation")


@dataclass(frozen=True)
class Validate:
    """Run the paper's experiments through the simulator and compare it with the measured robot."""

    experiment: str | None = None
    """One experiment, such as fig11a (None: all)."""
    model: str | None = None
    """Validate a model of your own, by name or file (None: the shipped parameter sets, all three columns)."""
    json: bool = False
    """Print one JSON object and nothing else."""
    out: Path | None = None
    """Folder of report.html (None: validation/, and with --json no report)."""
    workers: int = -1
    """Processes (-1: one per core)."""

    def run(self) -> int:
        """Compare, print and write the report; returns the exit code."""
        from evergym.experiments.protocols import ASSUMPTIONS, simulate  # the simulator: not for --help

        folder = self.out or (None if self.json else DEFAULT_FOLDER)
        names: tuple[str, ...] = (self.experiment,) if self.experiment else EXPERIMENTS
        experiments = [load_experiment(name) for name in names]
        if folder is None and not self.experiment:
            experiments = [experiment for experiment in experiments if experiment.name in TABLE_EXPERIMENTS]
        sets = load_parameter_sets() if self.model is None else ParameterSets(load_model(self.model))
        parameters = describe_parameters(sets.fitted, read_model_text(self.model or FITTED_MODEL))
        comparison = compare(experiments, sets, simulate, workers=self.workers, follow=_show_progress)
        table = comparison if self.experiment else _select_table(comparison)
        if self.json:
            print(json.dumps(make_json(table, parameters), indent=2))
        else:
            console = Console(width=150)
            console.print(make_table(table))
            for miss in find_misses(table):
                console.print(
                    f"{miss.experiment}, {miss.column.value}: {miss.error:.3g} {miss.unit}, bar {miss.bar:g}. "
                    f"{miss.structure.describe(miss.unit)}",
                    highlight=False,
                )
        if folder is not None:
            path = write_report(
                folder, comparison, parameters, model_name=self.model or FITTED_MODEL, assumptions=ASSUMPTIONS
            )
            print(f"Report: {path}", file=sys.stderr if self.json else sys.stdout)
        return 0


def make_json(comparison: Comparison, parameters: Iterable[ParameterRecord]) -> dict[str, Any]:
    """Return what ``--json`` prints: the rows, the fitted model's parameters by name, and the time it took [s]."""
    return {
        "rows": [result.make_row() for result in comparison.results],
        "parameters": {
            item.name: {key: value for key, value in asdict(item).items() if key != "name"} for item in parameters
        },
        "seconds": comparison.seconds,
    }


def _select_table(comparison: Comparison) -> Comparison:
    rows = tuple(result for result in comparison.results if result.experiment.name in TABLE_EXPERIMENTS)
    return Comparison(rows, comparison.seconds)


def _show_progress(stream: Iterable[Any], count: int) -> Iterable[Any]:
    return track(stream, "Experiments", total=count, console=Console(stderr=True), disable=not sys.stderr.isatty())
