"""Read a dataset's folder: ``dataset.toml``, then the samples, then what one says about the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.check import find_impossible_rows
from evergym.discrepancy.data.columns import ANGLES, CHANNELS, COMMANDS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.data.file import DatasetFile, DatasetText, RunEntry, read_dataset_file
from evergym.discrepancy.data.nearest import suggest_nearest
from evergym.discrepancy.data.samples import SampleTable, find_sample_file, read_samples
from evergym.errors import ConfigError
from evergym.robot import RobotConfig

__all__ = ["load_dataset"]

Array = NDArray[np.float64]

LENGTH_FACTORS = (1000.0, 100.0, 10.0)
"""An everted length that begins this many times too short is in m, in dm or in cm."""
LENGTH_SHARE = 0.05
"""... if it is so within this share."""
LENGTH_MIN_MM = 5.0
"""Runs that begin shorter than this are not asked."""
SIGN_SIGMAS = 5.0
"""An angle below minus this many standard deviations of its noise is taken for one with a sign, not for noise."""


def load_dataset(path: str | Path, robot: RobotConfig | None = None) -> Dataset:
    """Read and check a dataset folder.

    Args:
        path: Folder with ``dataset.toml`` and ``samples.csv`` or ``samples.parquet``.
        robot: The robot of the model that the data will be compared with, before the dataset's own ``[robot]`` keys;
            it decides which rows are impossible. None: the default robot.

    Raises:
        ConfigError: bad data; the message names file, row (as in an editor) and column.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise ConfigError(f"There is no folder '{folder}'. Give the folder that holds dataset.toml and samples.csv.")
    text = read_dataset_file(folder / "dataset.toml")
    file = text.content
    rig = text.override(RobotConfig() if robot is None else robot)
    table = read_samples(find_sample_file(folder))
    _check_noise(text, table)
    rows = _find_rows(text, table)
    signed = _has_signed_angles(file, table)
    runs = []
    set_aside: list[tuple[int, str]] = []
    for entry in file.run:
        index = rows[entry.id]
        commands = _hold_commands(table, index)
        measured = _collect(table, index, CHANNELS)
        measured[:, [CHANNELS.index(name) for name in file.ignore]] = np.nan
        for i, why in find_impossible_rows(
            rig, entry.setup, entry.initial_everted_length_mm, table.time[index], commands, measured, file.noise
        ):
            measured[i] = np.nan
            set_aside.append((int(table.row[index[i]]), why))
        _check_length_unit(entry, table, index, measured)
        time = table.time[index]
        for array in (time, commands, measured):
            array.flags.writeable = False
        runs.append(
            Run(
                entry.id,
                entry.setup,
                entry.gravity_mps2,
                entry.experiment or entry.id,
                entry.environment,
                entry.initial_everted_length_mm,
                time,
                commands,
                measured,
                signed,
                folder,
            )
        )
    dataset = Dataset(
        file.name or folder.name,
        file.description,
        dict(file.noise),
        dict(file.robot),
        file.ignore,
        tuple(runs),
        tuple(sorted(set_aside)),
        folder,
    )
    if not dataset.channels:
        raise ConfigError(
            f"{table.path}: no row has a measurement that is to be used. Fill one of: {', '.join(CHANNELS)}."
        )
    return dataset


def _check_length_unit(entry: RunEntry, table: SampleTable, index: NDArray[np.int64], measured: Array) -> None:
    """Refuse an everted length that begins as another power of ten of what the run is said to begin with."""
    everted = measured[:, CHANNELS.index("everted_length_mm")]
    known = np.flatnonzero(np.isfinite(everted))
    if entry.setup == "catheter" or entry.initial_everted_length_mm < LENGTH_MIN_MM or not len(known) or known[0] > 2:
        return
    first = float(everted[known[0]])
    for factor in LENGTH_FACTORS:
        if abs(first * factor / entry.initial_everted_length_mm - 1.0) < LENGTH_SHARE:
            raise ConfigError(
                f"{table.path}, row {int(table.row[index[known[0]]])}, column 'everted_length_mm': run '{entry.id}' "
                f"begins at {first:g} mm, but its initial_everted_length_mm is {entry.initial_everted_length_mm:g}, "
                f"{factor:g} times that. Give lengths in mm."
            )


def _check_noise(text: DatasetText, table: SampleTable) -> None:
    file = text.content
    for name in CHANNELS:
        measured = name in table.columns and np.isfinite(table.columns[name]).any()
        if measured and name not in file.noise and name not in file.ignore:
            row = int(table.row[np.flatnonzero(np.isfinite(table.columns[name]))[0]])
            raise ConfigError(
                f"{text.find('noise')}, [noise]: no noise for the channel '{name}', which {table.path.name} has from "
                f"row {row} on. Add its standard deviation, or put the channel under ignore."
            )


def _find_rows(text: DatasetText, table: SampleTable) -> dict[str, NDArray[np.int64]]:
    """Return the samples of every run, and refuse times that do not increase."""
    rows: dict[str, list[int]] = {entry.id: [] for entry in text.content.run}
    for i, name in enumerate(table.run):
        if name not in rows:
            raise ConfigError(
                f"{table.path}, row {table.row[i]}, column 'run': run '{name}' is not in {text.path.name}."
                f"{suggest_nearest(name, rows)}"
            )
        last = rows[name][-1] if rows[name] else None
        if last is not None and not table.time[i] > table.time[last]:
            raise ConfigError(
                f"{table.path}, row {table.row[i]}, column 'time_s': {table.time[i]:g} s does not come after the "
                f"{table.time[last]:g} s of row {table.row[last]}, the row before in run '{name}'. Time must increase."
            )
        rows[name].append(i)
    for number, (name, found) in enumerate(rows.items()):
        if not found:
            raise ConfigError(
                f"{text.find_run(number)}: run '{name}' has no samples in {table.path.name}, column 'run'. Add them, "
                "or remove the run."
            )
    return {name: np.array(found, dtype=np.int64) for name, found in rows.items()}


def _has_signed_angles(file: DatasetFile, table: SampleTable) -> bool:
    """Whether any angle is negative beyond its noise: the bench then reads angles with a sign."""
    for name in ANGLES:
        values = table.columns.get(name)
        if values is not None and name in file.noise and np.any(values < -SIGN_SIGMAS * file.noise[name]):
            return True
    return False


def _collect(table: SampleTable, index: NDArray[np.int64], names: tuple[str, ...]) -> Array:
    result = np.full((len(index), len(names)), np.nan)
    for j, name in enumerate(names):
        if name in table.columns:
            result[:, j] = table.columns[name][index]
    return result


def _hold_commands(table: SampleTable, index: NDArray[np.int64]) -> Array:
    """Return the commands of a run with empty cells filled, shape (k, 8).

    A command keeps its last value, and is zero before its first. The tail is coupled from its start, and again from any
    row on that commands the insertion and not the tail.
    """
    given = _collect(table, index, COMMANDS)
    tail, insertion = COMMANDS.index("tail_feed_mm_s"), COMMANDS.index("insertion_mm_s")
    given[np.isnan(given[:, tail]) & ~np.isnan(given[:, insertion]), tail] = np.inf  # stands for coupled
    # The row in which each command was last given, or a row of rest before all.
    last = np.where(np.isnan(given), 0, np.arange(1, len(given) + 1)[:, None])
    rest = np.zeros(len(COMMANDS))
    rest[tail] = np.inf
    held = np.take_along_axis(np.vstack((rest, given)), np.maximum.accumulate(last, axis=0), axis=0)
    held[np.isinf(held)] = np.nan
    return held
