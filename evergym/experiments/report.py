"""The report of the validation: one HTML file that holds everything it shows, and the table in the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import jinja2
from rich.table import Table

from evergym.experiments.bars import BARS, find_bar
from evergym.experiments.comparison import Comparison, ExperimentResult
from evergym.experiments.figures import FIGURES, draw_figure, draw_load_parts
from evergym.experiments.parameter_sets import Column
from evergym.experiments.provenance import ParameterRecord
from evergym.experiments.residuals import ResidualStructure, analyse_residual
from evergym.whole_file import write_whole

__all__ = ["Miss", "find_misses", "format_error", "make_table", "write_report"]

SOURCE = "Wu et al., RA-L 8(2):1005-1012, 2023, doi 10.1109/LRA.2023.3234823 (CC BY 4.0), digitised"


@dataclass(frozen=True)
class Miss:
    """A bar that an error did not meet, and what remains.

    Attributes:
        experiment: Name of the experiment.
        unit: Its unit.
        column: The column.
        error: The error.
        bar: The largest that was asked for.
        structure: What remains between model and robot.
    """

    experiment: str
    unit: str
    column: Column
    error: float
    bar: float
    structure: ResidualStructure


def find_misses(comparison: Comparison) -> tuple[Miss, ...]:
    """Return the errors that are above their bars, with what remains."""
    misses = []
    for result in comparison.results:
        experiment = result.experiment
        for column, values in result.values.items():
            bar, error = find_bar(experiment.name, column), experiment.compute_error(values)
            if bar is not None and error > bar:
                structure = analyse_residual(experiment, values)
                misses.append(Miss(experiment.name, experiment.unit, column, error, bar, structure))
    return tuple(misses)


def make_table(comparison: Comparison) -> Table:
    """Return the table for the terminal; errors above their bar are red."""
    table = Table(title="Mean absolute error against the measured robot")
    table.add_column("experiment", no_wrap=True)
    table.add_column("unit")
    for heading in ("paper, printed", "paper, recomputed", "fitted", "predicted", "left out", "resolution", "bar"):
        table.add_column(heading, justify="right")
    for result in comparison.results:
        experiment = result.experiment
        cells = []
        for column in Column:
            error, bar = result.compute_error(column), find_bar(experiment.name, column)
            text = format_error(error)
            cells.append(f"[red]{text}[/red]" if error is not None and bar is not None and error > bar else text)
        paper = (format_error(experiment.paper_printed), format_error(experiment.paper_recomputed))
        table.add_row(
            experiment.name,
            experiment.unit,
            *paper,
            *cells,
            format_error(experiment.resolution),
            describe_bar(experiment.name),
        )
    return table


def describe_bar(experiment: str) -> str:
    """Return the bars of an experiment: ``0.45; predicted 1.1``."""
    bar = BARS.get(experiment)
    if bar is None:
        return "-"
    if bar.other is None or bar.column is None:
        return f"{bar.fitted:g}"
    return f"{bar.fitted:g}; {bar.column.value.replace('_', ' ')} {bar.other:g}"


def format_error(value: float | None) -> str:
    """Return an error with three digits, a dash for none."""
    if value is None:
        return "-"
    return f"{value:#.3g}" if value >= 0.1 else f"{value:.3f}"


def write_report(
    folder: Path,
    comparison: Comparison,
    parameters: Sequence[ParameterRecord],
    *,
    model_name: str,
    assumptions: Sequence[str] = (),
) -> Path:
    """Write ``report.html`` into a folder, which is made if need be.

    Args:
        folder: Where to.
        comparison: The results.
        parameters: The fitted model's values with their provenance.
        model_name: Name of the fitted model.
        assumptions: What the protocols assume where the paper says nothing.
    """
    misses = find_misses(comparison)
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("evergym.experiments"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["error"] = format_error
    drawn = ((FIGURES[name].title, FIGURES[name].experiments, draw_figure(name, comparison)) for name in FIGURES)
    html = environment.get_template("validation.html").render(
        source=SOURCE,
        model_name=model_name,
        headline=describe_result(comparison, model_name),
        columns=list(Column),
        rows=[_make_report_row(result) for result in comparison.results],
        figures=[(title, image, _describe_experiments(comparison, names)) for title, names, image in drawn if image],
        load_parts=draw_load_parts(comparison),
        other=_describe_experiments(comparison, ("tip_position",)),
        misses=misses,
        parameters=parameters,
        assumptions=assumptions,
        seconds=comparison.seconds,
    )
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / "report.html"
    write_whole(target, html)
    return target


def describe_result(comparison: Comparison, model_name: str) -> str:
    """Return the result in a sentence: in how many experiments the model is closer than the paper's simulator."""
    pairs = [
        (error, result.experiment.paper_recomputed)
        for result in comparison.results
        if (error := result.compute_error(Column.FITTED)) is not None and result.experiment.paper_recomputed is not None
    ]
    closer = sum(error < paper for error, paper in pairs)
    bars = sum(
        find_bar(result.experiment.name, column) is not None
        for result in comparison.results
        for column in result.values
    )
    text = f"In {closer} of {len(pairs)} experiments {model_name} is closer to the measured robot"
    text += " than the paper's own simulator."
    missed = len(find_misses(comparison))
    return f"{text} It meets {bars - missed} of the {bars} bars that were set beforehand." if bars else text


def _make_report_row(result: ExperimentResult) -> dict[str, object]:
    name = result.experiment.name
    cells = []
    for column in Column:
        error, bar = result.compute_error(column), find_bar(name, column)
        met = "" if error is None or bar is None else ("met" if error <= bar else "missed")
        cells.append((error, met))
    return {"experiment": result.experiment, "cells": cells, "bar": describe_bar(name)}


def _describe_experiments(comparison: Comparison, names: Sequence[str]) -> list[tuple[str, str, str]]:
    """Return name, what remains and note of the experiments of a figure."""
    found = [result for result in map(comparison.find, names) if result is not None]
    return [
        (
            result.experiment.name,
            analyse_residual(result.experiment, result.values[Column.FITTED]).describe(result.experiment.unit),
            result.experiment.note,
        )
        for result in found
        if Column.FITTED in result.values
    ]
