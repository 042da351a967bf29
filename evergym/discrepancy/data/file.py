"""The file ``dataset.toml``: what is in it, and where in it something is wrong."""

from __future__ import annotations

import math
import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from evergym.config import build, parameter
from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.nearest import suggest_nearest
from evergym.discrepancy.data.rig import override_robot
from evergym.discrepancy.data.surroundings import read_peg_table
from evergym.discrepancy.data.toml_rows import add_row, find_row
from evergym.duct_models.duct_file import read_duct_file
from evergym.errors import ConfigError
from evergym.robot import RobotConfig

__all__ = ["DatasetFile", "DatasetText", "RunEntry", "read_dataset_file"]

SETUPS = ("full", "catheter", "sheath")


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


@dataclass(frozen=True)
class DatasetText:
    """A ``dataset.toml`` that was read."""

    path: Path
    text: str
    content: DatasetFile

    def find(self, table: str = "", key: str = "", index: int = 0) -> str:
        """Return the start of a message: the file, and the row of a key or its table if that is there."""
        row = find_row(self.text, table, key, index)
        return str(self.path) if row is None else f"{self.path}, row {row}"

    def find_run(self, number: int, key: str = "id") -> str:
        """Return the start of a message about the run with this number, from 0."""
        return f"{self.find('run', key, number)}, [[run]] '{self.content.run[number].id}'"

    def override(self, robot: RobotConfig) -> RobotConfig:
        """Return ``robot`` with the overrides of ``[robot]``.

        Raises:
            ConfigError: an unknown key, an impossible value, or a run that starts longer than the sheath.
        """
        content = self.content
        setups = {entry.setup for entry in content.run}
        try:
            rig = override_robot(robot, content.robot, f"{self.path} [robot]", setups)
        except ConfigError as error:
            key = next((key for key in content.robot if re.search(rf"\b{re.escape(key)}\b", str(error))), "")
            message = str(error).replace(f"{self.path} [robot]", f"{self.find('robot', key)}, [robot]")
            raise ConfigError(message) from None
        limit = 0.5 * rig.sheath_material_length_mm
        for number, entry in enumerate(content.run):
            if entry.setup != "catheter" and entry.initial_everted_length_mm > limit:
                raise ConfigError(
                    f"{self.find_run(number, 'initial_everted_length_mm')}: initial_everted_length_mm is "
                    f"{entry.initial_everted_length_mm:g} mm, but the sheath everts {limit:g} mm at most. Check it, or "
                    "give the rig's sheath_material_length_mm under [robot]."
                )
        return rig


def read_dataset_file(path: Path) -> DatasetText:
    """Read a ``dataset.toml`` and check what can be checked without the samples.

    Raises:
        ConfigError: the file is missing or wrong; with its row.
    """
    try:
        text = path.read_bytes().decode("utf-8-sig")
        mapping: dict[str, Any] = tomllib.loads(text)
    except FileNotFoundError:
        raise ConfigError(f"'{path.parent}' holds no dataset.toml. Add the file that names the runs.") from None
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise ConfigError(f"{path}, row {line}: the file is not text in UTF-8. Save it as UTF-8.") from None
    except tomllib.TOMLDecodeError as error:
        reason, _, place = str(error).rpartition(" (at ")
        found = re.match(r"line (\d+), column (\d+)", place)
        where = f"row {found[1]}, column {found[2]}" if found else f"row {max(1, len(text.splitlines()))}"
        raise ConfigError(f"{path}, {where}: not valid TOML: {reason or error}.") from None
    schema = mapping.get("schema")
    if schema != 1 or isinstance(schema, bool):
        row = find_row(text, "", "schema") or 1
        said = "names no schema" if schema is None else f"the schema is {schema!r}"
        raise ConfigError(f"{path}, row {row}: {said}; this version reads 1. Write schema = 1, or update evergym.")
    try:
        content = build(DatasetFile, mapping, str(path))
    except ConfigError as error:
        raise ConfigError(add_row(str(error), str(path), text)) from None
    found_text = DatasetText(path, text, content)
    _check_channels(found_text)
    _check_runs(found_text)
    return found_text


def _check_channels(file: DatasetText) -> None:
    for name in file.content.ignore:
        if name not in CHANNELS:
            hint = suggest_nearest(name, CHANNELS)
            raise ConfigError(f"{file.find('', 'ignore')}, ignore: unknown channel '{name}'.{hint}")
    for name, sigma in file.content.noise.items():
        where = f"{file.find('noise', name)}, [noise]"
        if name not in CHANNELS:
            raise ConfigError(f"{where}: unknown channel '{name}'.{suggest_nearest(name, CHANNELS)}")
        if not 0.0 < sigma < math.inf:
            raise ConfigError(
                f"{where}: {name} is {sigma:g}, but a standard deviation must be above 0. Give the sensor's, or its "
                "resolution / sqrt(12)."
            )


def _check_runs(file: DatasetText) -> None:
    if not file.content.run:
        raise ConfigError(f"{file.path} names no run. Add a [[run]] with an id for every run in the samples.")
    seen: dict[str, int] = {}
    for number, entry in enumerate(file.content.run):
        if not entry.id.strip() or entry.id != entry.id.strip():
            raise ConfigError(f"{file.find_run(number)}: the id must be a text without spaces at its ends.")
        if entry.id in seen:
            raise ConfigError(f"{file.find_run(number)}: the id is there twice. Give every run an id of its own.")
        seen[entry.id] = number
        if entry.setup not in SETUPS:
            known = ", ".join(map(repr, SETUPS))
            where = file.find_run(number, "setup")
            raise ConfigError(f"{where}: unknown setup '{entry.setup}'. Write one of: {known}.")
        _check_environment(file.path.parent, file.find_run(number, "environment"), entry.environment)


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
