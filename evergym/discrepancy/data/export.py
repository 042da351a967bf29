"""Write runs as a dataset folder that `load_dataset` reads back."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import CHANNELS, COMMANDS
from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.data.samples import SAMPLE_FILES
from evergym.errors import ConfigError
from evergym.whole_file import whole_file, write_whole

__all__ = ["add_noise", "format_csv", "write_dataset", "write_table"]

Array = NDArray[np.float64]


def write_dataset(
    folder: str | Path,
    runs: Sequence[Run],
    noise: Mapping[str, float],
    *,
    name: str = "",
    description: str = "",
    robot: Mapping[str, float] | None = None,
    ignore: Sequence[str] = (),
    parquet: bool = False,
    overwrite: bool = False,
) -> Path:
    """Write ``dataset.toml`` and ``samples.csv`` (or ``.parquet``).

    Columns that no run uses are left out. Files that environments name are the caller's.

    Args:
        folder: Is made where it is missing.
        runs: Their ``folder`` and ``signed_angles`` are not written.
        noise: One standard deviation of every channel that the runs have measured.
        name: Of the dataset; the folder's by default.
        description: Free text.
        robot: Keys of ``[robot]`` that differ on this rig.
        ignore: Channels that the diagnosis shall leave out.
        parquet: Write ``samples.parquet`` instead.
        overwrite: Write over a dataset that is there already.

    Returns:
        The folder.

    Raises:
        ConfigError: the folder holds a dataset already, or a channel has no noise.
    """
    folder = Path(folder)
    present = [path for path in (folder / name for name in ("dataset.toml", *SAMPLE_FILES)) if path.exists()]
    if present and not overwrite:
        raise ConfigError(f"'{present[0]}' is there already. Choose another folder, or allow to overwrite it.")
    measured = [c for c in CHANNELS if any(np.isfinite(run.measured[:, CHANNELS.index(c)]).any() for run in runs)]
    for channel in measured:
        if channel not in noise and channel not in ignore:
            raise ConfigError(f"The channel '{channel}' was measured but has no noise. Give its standard deviation.")
    mapping: dict[str, Any] = {
        "schema": 1,
        "name": name or folder.name,
        "description": description,
        "ignore": list(ignore),
        "noise": {channel: float(noise[channel]) for channel in CHANNELS if channel in noise},
    }
    if robot:
        mapping["robot"] = {key: float(value) for key, value in robot.items()}
    mapping["run"] = [_describe_run(run) for run in runs]
    columns = [*_used_commands(runs), *measured]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"The folder '{folder}' cannot be made: {error.strerror}.") from None
    if parquet:
        _write_parquet(folder / "samples.parquet", columns, runs)
    else:
        rows = ([run.id, *map(_format, row)] for run in runs for row in _table(run, columns))
        write_table(folder / "samples.csv", format_csv(["run", "time_s", *columns], rows))
    write_table(folder / "dataset.toml", tomli_w.dumps(mapping))  # last: a folder without it is no dataset
    for path in present:
        if path.name.startswith("samples.") and path.name != ("samples.parquet" if parquet else "samples.csv"):
            path.unlink()
    return folder


def add_noise(run: Run, noise: Mapping[str, float], rng: np.random.Generator) -> Run:
    """Return the run with white noise on its measurements; a channel without noise becomes unmeasured."""
    sigma = np.array([noise.get(channel, np.nan) for channel in CHANNELS])
    measured = run.measured + sigma * rng.standard_normal(run.measured.shape)
    measured.flags.writeable = False
    return dataclasses.replace(run, measured=measured)


def format_csv(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as CSV text."""
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return stream.getvalue()


def write_table(path: Path, text: str) -> None:
    """Write a file of a dataset, whole or not at all.

    Raises:
        ConfigError: it cannot be written.
    """
    try:
        write_whole(path, text)
    except OSError as error:
        raise ConfigError(f"{path} cannot be written: {error.strerror}.") from None


def _describe_run(run: Run) -> dict[str, Any]:
    return {
        "id": run.id,
        "setup": run.setup,
        "gravity_mps2": [float(value) for value in run.gravity],
        "experiment": run.experiment,
        "environment": run.environment,
        "initial_everted_length_mm": float(run.initial_everted_length_mm),
    }


def _used_commands(runs: Sequence[Run]) -> list[str]:
    """Return the commands that are not at rest at zero in every run."""
    used = []
    for i, name in enumerate(COMMANDS):
        rest = np.isnan if name == "tail_feed_mm_s" else _is_zero
        if not all(rest(run.commands[:, i]).all() for run in runs):
            used.append(name)
    # A row without insertion would let the tail feed keep its last value.
    if "tail_feed_mm_s" in used and "insertion_mm_s" not in used:
        used.insert(0, "insertion_mm_s")
    return used


def _is_zero(values: Array) -> NDArray[np.bool_]:
    return np.equal(values, 0.0)


def _table(run: Run, columns: Sequence[str]) -> Array:
    return np.column_stack(
        [
            run.time_s,
            *(
                run.commands[:, COMMANDS.index(name)] if name in COMMANDS else run.measured[:, CHANNELS.index(name)]
                for name in columns
            ),
        ]
    )


def _format(value: float) -> str:
    return "" if value != value else repr(float(value))


def _write_parquet(path: Path, columns: Sequence[str], runs: Sequence[Run]) -> None:
    import pandas  # slow to import, and rarely needed

    frame = pandas.DataFrame(np.concatenate([_table(run, columns) for run in runs]), columns=["time_s", *columns])
    frame.insert(0, "run", [run.id for run in runs for _ in run.time_s])
    try:
        with whole_file(path) as draft:
            frame.to_parquet(draft, index=False)
    except OSError as error:
        raise ConfigError(f"{path} cannot be written: {error.strerror}.") from None
