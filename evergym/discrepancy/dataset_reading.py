"""Read a dataset's folder: ``dataset.toml``, then the samples, then what one says about the other."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evergym.config import build, parameter
from evergym.discrepancy.columns import ANGLES, CHANNELS, COMMANDS
from evergym.discrepancy.dataset import Dataset, Run
from evergym.discrepancy.dataset_check import find_impossible_rows
from evergym.discrepancy.nearest import suggest_nearest
from evergym.discrepancy.rig import override_robot
from evergym.discrepancy.samples import SampleTable, find_sample_file, read_samples
from evergym.discrepancy.surroundings import read_peg_table
from evergym.duct_models.duct_file import read_duct_file
from evergym.errors import ConfigError
from evergym.robot import RobotConfig

__all__ = ["DatasetFile", "RunEntry", "read_dataset"]

Array = NDArray[np.float64]

SETUPS = ("full", "catheter", "sheath")
SIGN_SIGMAS = 5.0
"""An angle below minus this many standard deviations of its noise is taken for one with a sign, not for noise."""


@dataclass(frozen=True)
class RunEntry:
    """A ``[[run]]`` of ``dataset.toml``."""

    id: str = parameter()
    setup: str = parameter("full")
    gravity_mps2: tuple[float, float, float] = parameter((0.0, -9.81, 0.0), unit="m/s^2", low=-100.0, high=100.0)
    experiment: str = parameter("")
    environment: str = parameter("free")
    initial_everted_length_mm: float = parameter(10.0, unit="mm", low=0.0, high=1e4)


@dataclass(frozen=True)
class DatasetFile:
    """The content of ``dataset.toml``."""

    schema: int = parameter()
    name: str = parameter("")
    description: str = parameter("")
    ignore: tuple[str, ...] = parameter(())
    noise: dict[str, float] = field(default_factory=dict)
    robot: dict[str, float] = field(default_factory=dict)
    run: tuple[RunEntry, ...] = parameter(())


def read_dataset(folder: Path, robot: RobotConfig) -> Dataset:
    """Read and check a dataset; see `evergym.discrepancy.dataset.load_dataset`."""
    if not folder.is_dir():
        raise ConfigError(f"There is no folder '{folder}'. Give the folder that holds dataset.toml and samples.csv.")
    path = folder / "dataset.toml"
    file = _read_file(path)
    _check_names(path, file)
    rig = override_robot(robot, file.robot, f"{path} [robot]", {entry.setup for entry in file.run})
    table = read_samples(find_sample_file(folder))
    _check_noise(path, file, table)
    rows = _find_rows(path, file, table)
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


def _read_file(path: Path) -> DatasetFile:
    try:
        mapping: dict[str, Any] = tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except FileNotFoundError:
        raise ConfigError(f"'{path.parent}' holds no dataset.toml. Add the file that names the runs.") from None
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise ConfigError(f"{path}, row {line}: the file is not text in UTF-8. Save it as UTF-8.") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}.") from None
    schema = mapping.get("schema")
    if schema != 1 or isinstance(schema, bool):
        said = "names no schema" if schema is None else f"has schema {schema!r}"
        raise ConfigError(f"{path} {said}, but this version reads schema 1. Write schema = 1, or update evergym.")
    return build(DatasetFile, mapping, str(path))


def _check_names(path: Path, file: DatasetFile) -> None:
    """Hold names in ``dataset.toml`` against what they can be."""
    for where, names in (("ignore", file.ignore), ("[noise]", tuple(file.noise))):
        for name in names:
            if name not in CHANNELS:
                raise ConfigError(f"{path}, {where}: unknown channel '{name}'.{suggest_nearest(name, CHANNELS)}")
    for name, sigma in file.noise.items():
        if not 0.0 < sigma < math.inf:
            raise ConfigError(
                f"{path}, [noise]: {name} is {sigma:g}, but a standard deviation must be above 0. Give the "
                "sensor's, or its resolution / sqrt(12)."
            )
    if not file.run:
        raise ConfigError(f"{path} names no run. Add a [[run]] with an id for every run in the samples.")
    seen: set[str] = set()
    for number, entry in enumerate(file.run, start=1):
        where = f"{path}, [[run]] number {number} (id '{entry.id}')"
        if not entry.id.strip() or entry.id != entry.id.strip():
            raise ConfigError(f"{where}: the id must be a text without spaces at its ends.")
        if entry.id in seen:
            raise ConfigError(f"{where}: the id is there twice. Give every run an id of its own.")
        seen.add(entry.id)
        if entry.setup not in SETUPS:
            raise ConfigError(f"{where}: unknown setup '{entry.setup}'.{suggest_nearest(entry.setup, SETUPS)}")
        _check_environment(path.parent, where, entry.environment)


def _check_environment(folder: Path, where: str, environment: str) -> None:
    kind, _, name = environment.partition(":")
    if environment != "free" and not (kind in ("pegs", "duct") and name):
        raise ConfigError(
            f"{where}: unknown environment '{environment}'. Write free, pegs:<table.csv> or duct:<duct.toml>."
        )
    if name and not (folder / name).is_file():
        raise ConfigError(f"{where}: the file '{folder / name}' of environment '{environment}' does not exist.")
    if kind == "pegs":
        read_peg_table(folder / name)
    if kind == "duct":
        read_duct_file(folder / name)


def _check_noise(path: Path, file: DatasetFile, table: SampleTable) -> None:
    for name in CHANNELS:
        measured = name in table.columns and np.isfinite(table.columns[name]).any()
        if measured and name not in file.noise and name not in file.ignore:
            row = int(table.row[np.flatnonzero(np.isfinite(table.columns[name]))[0]])
            raise ConfigError(
                f"{path}, [noise]: no noise for the channel '{name}', which {table.path.name} measures from row {row} "
                "on. Add its standard deviation, or put the channel under ignore."
            )


def _find_rows(path: Path, file: DatasetFile, table: SampleTable) -> dict[str, NDArray[np.int64]]:
    """Return the samples of every run, and refuse times that do not increase."""
    rows: dict[str, list[int]] = {entry.id: [] for entry in file.run}
    for i, name in enumerate(table.run):
        if name not in rows:
            raise ConfigError(
                f"{table.path}, row {table.row[i]}, column 'run': run '{name}' is not in {path.name}."
                f"{suggest_nearest(name, rows)}"
            )
        last = rows[name][-1] if rows[name] else None
        if last is not None and not table.time[i] > table.time[last]:
            raise ConfigError(
                f"{table.path}, row {table.row[i]}, column 'time_s': {table.time[i]:g} s does not come after the "
                f"{table.time[last]:g} s of row {table.row[last]}, the row before in run '{name}'. Time must increase."
            )
        rows[name].append(i)
    for name, found in rows.items():
        if not found:
            raise ConfigError(
                f"{path}: run '{name}' has no samples in {table.path.name}, column 'run'. Add them, or remove the run."
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
