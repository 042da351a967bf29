"""The table of samples: a CSV or Parquet file read into columns, every cell checked where it stands."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import COLUMNS, KEYS
from evergym.discrepancy.data.nearest import suggest_nearest
from evergym.errors import ConfigError

__all__ = ["SAMPLE_FILES", "SampleTable", "find_sample_file", "read_samples"]

Array = NDArray[np.float64]

SAMPLE_FILES = ("samples.csv", "samples.parquet")
"""Names of the table in a dataset's folder; one of them is there."""
TIME_LIMIT = 1e7
"""Latest time of a sample [s]: four months. Beyond, a clock was written instead of the time since the run's start."""


@dataclass(frozen=True, eq=False)
class SampleTable:
    """The samples as they stand in the file.

    Attributes:
        path: The file.
        row: Number of each sample's row as an editor shows it (a Parquet file: counted from 1), shape (n,).
        run: Id of each sample's run.
        time: [s], shape (n,).
        columns: The number columns that the file has, each of shape (n,); NaN: empty cell.
    """

    path: Path
    row: NDArray[np.int64]
    run: tuple[str, ...]
    time: Array
    columns: dict[str, Array]


def find_sample_file(folder: Path) -> Path:
    """Return the table of samples in a dataset's folder.

    Raises:
        ConfigError: there is none, or there are two.
    """
    found = [folder / name for name in SAMPLE_FILES if (folder / name).is_file()]
    if not found:
        raise ConfigError(f"'{folder}' holds no {' or '.join(SAMPLE_FILES)}. Add the table of samples.")
    if len(found) > 1:
        raise ConfigError(f"'{folder}' holds both {' and '.join(SAMPLE_FILES)}. Keep one of them.")
    return found[0]


def read_samples(path: Path) -> SampleTable:
    """Read a table of samples.

    Raises:
        ConfigError: a file that is no such table, an unknown column (the nearest is named), or a cell that is no finite
            number or outside any physical range; with file, row and column.
    """
    header, rows, numbers = _read_parquet(path) if path.suffix == ".parquet" else _read_csv(path)
    if not rows:
        raise ConfigError(f"{path} holds no samples, only the names of the columns. Add one row per sample.")
    place = {name: i for i, name in enumerate(header)}
    run = tuple(row[place["run"]] for row in rows)
    for number, name in zip(numbers, run, strict=True):
        if not name:
            raise ConfigError(f"{path}, row {number}, column 'run': the cell is empty. Name the sample's run.")
    columns = {
        name: _read_column(path, name, [row[i] for row in rows], numbers)
        for name, i in place.items()
        if i >= 0 and name != "run"
    }
    time = columns.pop("time_s")
    return SampleTable(path, np.array(numbers, dtype=np.int64), run, time, columns)


def _read_csv(path: Path) -> tuple[list[str], list[list[str]], list[int]]:
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise ConfigError(f"{path}, row {line}: the file is not text in UTF-8. Save it as CSV in UTF-8.") from None
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}.") from None
    reader = csv.reader(io.StringIO(text, newline=""))
    header: list[str] = []
    rows: list[list[str]] = []
    numbers: list[int] = []
    try:
        for cells in reader:
            stripped = [cell.strip() for cell in cells]
            if not any(stripped):
                continue  # a blank line, or the empty rows that spreadsheets append
            if not header:
                header = stripped
                _check_separator(path, reader.line_num, header)
                _check_header(path, reader.line_num, header)
                continue
            if len(stripped) != len(header):
                raise ConfigError(
                    f"{path}, row {reader.line_num}: {len(stripped)} cells, but the header names {len(header)} "
                    "columns. Separate cells by commas, write decimals with a point, and leave no cell out."
                )
            rows.append(stripped)
            numbers.append(reader.line_num)
    except csv.Error as error:
        raise ConfigError(f"{path}, row {reader.line_num}: not valid CSV: {error}.") from None
    if not header:
        raise ConfigError(f"{path} is empty. Its first row names the columns: run, time_s, ...")
    return header, rows, numbers


def _check_separator(path: Path, line: int, header: Sequence[str]) -> None:
    for separator, name in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars")):
        if any(separator in cell for cell in header):
            raise ConfigError(
                f"{path}, row {line}: the columns are separated by {name}. Save the table as CSV with commas, and "
                "decimals with a point."
            )


def _read_parquet(path: Path) -> tuple[list[str], list[list[str]], list[int]]:
    import pandas

    try:
        frame = pandas.read_parquet(path)
    except Exception as error:  # noqa: BLE001  (every engine has its own kinds)
        raise ConfigError(f"{path} cannot be read as Parquet: {error}. Write it again, or use samples.csv.") from None
    header = [str(name).strip() for name in frame.columns]
    _check_header(path, 1, header)
    missing = frame.isna().to_numpy()
    rows = [
        ["" if lost else str(cell).strip() for cell, lost in zip(row, gaps, strict=True)]
        for row, gaps in zip(frame.itertuples(index=False, name=None), missing, strict=True)
    ]
    return header, rows, list(range(1, len(rows) + 1))


def _check_header(path: Path, line: int, header: Sequence[str]) -> None:
    known = [*KEYS, *COLUMNS]
    for i, name in enumerate(header):
        if not name:
            raise ConfigError(f"{path}, row {line}: column {i + 1} has no name. Name it, or remove it.")
        if name not in known:
            raise ConfigError(f"{path}, row {line}: unknown column '{name}'.{suggest_nearest(name, known)}")
        if name in header[:i]:
            raise ConfigError(f"{path}, row {line}: the column '{name}' is there twice. Keep one of them.")
    for name in KEYS:
        if name not in header:
            raise ConfigError(
                f"{path}, row {line}: the column '{name}' is missing. Every sample needs its run and time."
            )


def _read_column(path: Path, name: str, cells: Sequence[str], numbers: Sequence[int]) -> Array:
    filled = np.array([bool(cell) for cell in cells])
    if name == "time_s" and not filled.all():
        row = numbers[int(np.argmin(filled))]
        raise ConfigError(f"{path}, row {row}, column 'time_s': the cell is empty. Every sample has a time.")
    values = _convert(cells)
    low, high = (-TIME_LIMIT, TIME_LIMIT) if name == "time_s" else COLUMNS[name][1:3]
    if values is None or not np.all((values >= low) & (values <= high) | ~filled):
        # Something is wrong: cell by cell, to say where.
        values = np.array(
            [_read_number(path, name, cell, row) if cell else np.nan for cell, row in zip(cells, numbers, strict=True)]
        )
    return values


def _convert(cells: Sequence[str]) -> Array | None:
    """Return the numbers of a column, NaN for empty cells; None where a cell is no number."""
    if any("_" in cell for cell in cells):
        return None
    try:
        return np.array([cell or "nan" for cell in cells], dtype=np.float64)
    except ValueError:
        return None


def _read_number(path: Path, name: str, cell: str, row: int) -> float:
    where = f"{path}, row {row}, column '{name}'"
    try:
        value = float(cell) if "_" not in cell else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ConfigError(
            f"{where}: '{cell}' is no finite number. Write numbers with a decimal point, and leave a cell empty where "
            "nothing was commanded or measured."
        )
    if name == "time_s":
        if abs(value) > TIME_LIMIT:
            raise ConfigError(f"{where}: {value:g} s is no time since a run's start (limit {TIME_LIMIT:g} s).")
        return value
    unit, low, high, meaning = COLUMNS[name]
    if not low <= value <= high:
        raise ConfigError(
            f"{where}: {value:g} {unit} is out of any physical range ({low:g} to {high:g} {unit}; {meaning}). Check "
            "the unit."
        )
    return value
