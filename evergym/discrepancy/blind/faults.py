"""Bad data: every fault of the contract's list, put into a dataset that was good."""

# ruff: noqa: ARG001  (all faults are called alike)
from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable
from dataclasses import dataclass

from numpy.random import Generator

__all__ = ["FAULTS", "Spoiled"]

Files = dict[str, str]
Table = list[list[str]]


@dataclass(frozen=True)
class Spoiled:
    """A dataset with a fault in it.

    Attributes:
        files: The texts of its files.
        words: What the message must name: the file, the row as in an editor, the column; "" where there is none.
    """

    files: Files
    words: tuple[str, ...]


def _read(files: Files) -> Table:
    return [list(row) for row in csv.reader(io.StringIO(files["samples.csv"]))]


def _write(files: Files, table: Table) -> Files:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(table)
    return {**files, "samples.csv": text.getvalue()}


def _measured_cell(generator: Generator, table: Table, column: str, least: float = -math.inf) -> int:
    """Return the index of a row, not the first of the table, in which a column has a value above ``least``."""
    place = table[0].index(column)
    rows = [i for i in range(2, len(table)) if table[i][place] and float(table[i][place]) > least]
    return int(generator.choice(rows))


def _set(
    generator: Generator, files: Files, column: str, change: Callable[[str], str], least: float = -math.inf
) -> Spoiled:
    table = _read(files)
    row = _measured_cell(generator, table, column, least)
    place = table[0].index(column)
    table[row][place] = change(table[row][place])
    return Spoiled(_write(files, table), ("samples.csv", f"row {row + 1}", column))


def misspell_column(generator: Generator, files: Files) -> Spoiled:
    """A column has a name that is not known."""
    table = _read(files)
    table[0][table[0].index("tip_x_mm")] = "tip_x_m"
    return Spoiled(_write(files, table), ("samples.csv", "row 1", "tip_x_m", "tip_x_mm"))


def turn_time_back(generator: Generator, files: Files) -> Spoiled:
    """The time of one sample lies before that of the sample before it."""
    table = _read(files)
    place = table[0].index("time_s")
    rows = [i for i in range(3, len(table)) if table[i][0] == table[i - 1][0] == table[i - 2][0]]
    row = int(generator.choice(rows))
    table[row][place] = f"{float(table[row - 1][place]) - 0.1:g}"
    return Spoiled(_write(files, table), ("samples.csv", f"row {row + 1}", "time_s"))


def change_pressure_unit(generator: Generator, files: Files) -> Spoiled:
    """A pressure is in pascals: one above 2 kPa, since less passes for a high pressure in kPa."""
    return _set(generator, files, "pressure_kpa", lambda cell: repr(float(cell) * 1000.0), least=2.0)


def change_length_unit(generator: Generator, files: Files) -> Spoiled:
    """A length is in micrometres."""
    return _set(generator, files, "tip_z_mm", lambda cell: repr(float(cell) * 1000.0))


def write_text(generator: Generator, files: Files) -> Spoiled:
    """A cell holds a word."""
    return _set(generator, files, "tip_x_mm", lambda _: "lost")


def write_nan(generator: Generator, files: Files) -> Spoiled:
    """A cell holds a number that is none."""
    return _set(generator, files, "tip_z_mm", lambda _: "inf")


def write_decimal_comma(generator: Generator, files: Files) -> Spoiled:
    """A cell has a decimal comma, in quotes."""
    return _set(generator, files, "everted_length_mm", lambda cell: cell.replace(".", ","))


def forget_noise(generator: Generator, files: Files) -> Spoiled:
    """A measured channel has no noise."""
    lines = files["dataset.toml"].splitlines(keepends=True)
    kept = [line for line in lines if not line.startswith("tip_z_mm")]
    return Spoiled({**files, "dataset.toml": "".join(kept)}, ("dataset.toml", "tip_z_mm"))


def forget_samples(generator: Generator, files: Files) -> Spoiled:
    """A run has no samples."""
    table = _read(files)
    runs = sorted({row[0] for row in table[1:]})
    gone = str(generator.choice(runs))
    return Spoiled(_write(files, [row for row in table if row[0] != gone]), ("dataset.toml", gone))


def name_unknown_run(generator: Generator, files: Files) -> Spoiled:
    """The samples hold a run that the dataset does not name."""
    table = _read(files)
    row = int(generator.integers(2, len(table)))
    table[row][0] = "r99"
    return Spoiled(_write(files, table), ("samples.csv", f"row {row + 1}", "r99"))


def repeat_run_id(generator: Generator, files: Files) -> Spoiled:
    """Two runs have the same id."""
    return Spoiled(
        {**files, "dataset.toml": files["dataset.toml"].replace('id = "r02"', 'id = "r01"')}, ("dataset.toml", "r01")
    )


def raise_schema(generator: Generator, files: Files) -> Spoiled:
    """The dataset is of a schema of the future."""
    text = files["dataset.toml"].replace("schema = 1\n", "schema = 7\n")
    return Spoiled({**files, "dataset.toml": text}, ("dataset.toml", "schema"))


def use_semicolons(generator: Generator, files: Files) -> Spoiled:
    """The table is separated by semicolons."""
    return Spoiled({**files, "samples.csv": files["samples.csv"].replace(",", ";")}, ("samples.csv", "row 1"))


def remove_table(generator: Generator, files: Files) -> Spoiled:
    """There is no table of samples."""
    return Spoiled({name: text for name, text in files.items() if name != "samples.csv"}, ("samples.csv",))


def add_impossible_rows(generator: Generator, files: Files) -> Spoiled:
    """Three readings lie farther from the port than the robot is long: no fault of the format, the rest is used."""
    table = _read(files)
    place = table[0].index("tip_z_mm")
    rows = [i for i in range(2, len(table)) if table[i][place]]
    chosen = sorted(int(row) for row in generator.choice(rows, size=3, replace=False))
    for row in chosen:
        table[row][place] = f"{float(table[row][place]) + 900.0:.4f}"
    return Spoiled(_write(files, table), tuple(str(row + 1) for row in chosen))


FAULTS: dict[str, Callable[[Generator, Files], Spoiled]] = {
    function.__name__: function
    for function in (
        misspell_column,
        turn_time_back,
        change_pressure_unit,
        forget_noise,
        forget_samples,
        add_impossible_rows,
        change_length_unit,
        write_text,
        write_nan,
        write_decimal_comma,
        name_unknown_run,
        repeat_run_id,
        raise_schema,
        use_semicolons,
        remove_table,
    )
}
"""Every fault by name; all but ``add_impossible_rows`` must be refused."""
