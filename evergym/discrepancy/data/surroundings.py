"""The surroundings of a run: free space, pegs from a table, or a duct from a mesh."""

from __future__ import annotations

import csv
import functools
from pathlib import Path

import numpy as np

from evergym.discrepancy.data.dataset import Run
from evergym.duct_models.field import WallField
from evergym.duct_models.importer import load_duct
from evergym.duct_models.pegs import Array
from evergym.errors import ConfigError
from evergym.units import MM
from evergym.world import World

__all__ = ["open_world", "read_peg_table"]

PEG_COLUMNS = ("x_mm", "z_mm", "diameter_mm")


def open_world(run: Run) -> World:
    """Return the world of a run; files are read once in a process.

    Raises:
        ConfigError: an unknown kind of environment, or a peg table that is missing or wrong.
        GeometryError: a duct that cannot be used.
    """
    gravity = np.array(run.gravity)
    if run.environment == "free":
        return World.free(gravity)
    kind, _, name = run.environment.partition(":")
    path = run.folder / name
    if kind == "pegs":
        return World(pegs=read_peg_table(path), gravity=gravity)
    if kind == "duct":
        return World(wall=_read_wall(path, _find_age(path)), gravity=gravity)
    raise ConfigError(f"Run '{run.id}': environment '{run.environment}' must be free, pegs:<file> or duct:<file>.")


def read_peg_table(path: Path) -> Array:
    """Return the pegs of a table with x_mm, z_mm, diameter_mm as rows (point, axis, radius) [m], shape (k, 7).

    Raises:
        ConfigError: the file is missing, or a row or column of it is wrong.
    """
    return _read_pegs(path, _find_age(path))


def _find_age(path: Path) -> int:
    """Return when a file was changed, so that what is kept of it is not older; -1 where it is missing."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return -1


@functools.lru_cache(maxsize=32)
def _read_pegs(path: Path, age: int) -> Array:
    del age
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"The table of pegs '{path}' cannot be read: {error}.") from None
    reader = csv.reader(lines)
    try:
        header = [cell.strip() for cell in next(reader, [])]
        rows = [(reader.line_num, cells) for cells in reader]
    except csv.Error as error:
        raise ConfigError(f"{path}, row {reader.line_num}: this is no table of pegs: {error}.") from None
    if sorted(header) != sorted(PEG_COLUMNS):
        raise ConfigError(f"{path}, row 1: the columns are {header}, but must be {', '.join(PEG_COLUMNS)}.")
    pegs = []
    for line, cells in rows:
        if not any(cell.strip() for cell in cells):
            continue
        try:
            row = dict(zip(header, map(float, cells), strict=True))
        except ValueError:
            raise ConfigError(f"{path}, row {line}: needs three numbers, got {cells}.") from None
        if not (np.isfinite(list(row.values())).all() and row["diameter_mm"] > 0.0):
            raise ConfigError(f"{path}, row {line}: needs finite numbers and a diameter above 0: {row}.")
        pegs.append((row["x_mm"] * MM, 0.0, row["z_mm"] * MM, 0.0, 1.0, 0.0, 0.5 * row["diameter_mm"] * MM))
    if not pegs:
        raise ConfigError(f'{path} holds no pegs. Add rows, or write environment = "free".')
    table = np.array(pegs)
    table.flags.writeable = False
    return table


@functools.lru_cache(maxsize=4)
def _read_wall(path: Path, age: int) -> WallField:
    del age
    return load_duct(path).field
