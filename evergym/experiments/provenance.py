"""Where the values of a model come from: the comments of its file, else the sources of the defaults."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from evergym.config import dump_toml, iterate_parameters, to_mapping
from evergym.errors import ConfigError
from evergym.model import MODEL_NAMES, Model

__all__ = ["ParameterRecord", "describe_parameters", "dump_model", "read_model_text"]

_HEADER = re.compile(r"\s*\[([^\[\]]+)\]")
_ENTRY = re.compile(r"\s*([A-Za-z0-9_]+)\s*=\s*(?:\"[^\"]*\"|[^#\"]*)#\s*(.*\S)")
_SPREAD = re.compile(r"(?:\+-|±|\+/-)\s*([0-9]+(?:\.[0-9]*)?(?:[eE][+-]?[0-9]+)?)")


@dataclass(frozen=True)
class ParameterRecord:
    """One value of a model.

    Attributes:
        name: Path of the key, such as "effects.root_kink.moment_n_m".
        value: The value, in the unit of the model file.
        unit: Its unit.
        uncertainty: One standard deviation, in the same unit; None where none is known.
        provenance: Where the value comes from, in words.
        is_default: Whether it is the package's default.
    """

    name: str
    value: Any
    unit: str
    uncertainty: float | None
    provenance: str
    is_default: bool


def describe_parameters(model: Model, text: str = "") -> tuple[ParameterRecord, ...]:
    """Return every parameter of a model with its provenance.

    Args:
        model: The model.
        text: Content of its file; the comment behind a value is its provenance, and a number after ``+-`` in it its
            uncertainty.
    """
    comments = _read_comments(text)
    records = []
    for name, info, default in iterate_parameters(Model):
        if "." not in name:
            continue  # the schema's version and the model's name
        value: Any = to_mapping(model)
        for key in name.split("."):
            value = value[key]
        comment = comments.get(name)
        spread = _SPREAD.search(comment) if comment else None
        own = " ".join(part for part in ("prior" if info.prior else "", info.source) if part) or "no source given"
        provenance = comment or (own if value == default else "set in the model file, without a source")
        uncertainty = float(spread.group(1)) if spread else None
        records.append(ParameterRecord(name, value, info.unit, uncertainty, provenance, value == default))
    return tuple(records)


def dump_model(model: Model, provenance: Mapping[str, str]) -> str:
    """Return the text of a model file with the provenance of its values behind them, as `describe_parameters` reads it.

    Args:
        model: The model.
        provenance: Words by path of the key, such as "effects.root_kink.moment_n_m"; an uncertainty (one standard
            deviation in the unit of the file) goes in as ``+- 0.05``.

    Raises:
        ConfigError: A key is unknown, or the words take more than a line.
    """
    known = {name for name, _, _ in iterate_parameters(Model)}
    for name, words in provenance.items():
        if name not in known:
            raise ConfigError(f"There is no parameter {name!r} in a model: its provenance cannot be written.")
        if "\n" in words:
            raise ConfigError(f"The provenance of {name!r} has several lines; a comment has one.")
    lines, table = [], ""
    for line in dump_toml(model).splitlines():
        key, _, _ = line.partition(" = ")
        if header := _HEADER.match(line):
            table = f"{header.group(1).strip()}."
        elif words := provenance.get(f"{table}{key}", ""):
            line = f"{line}  # {words}"
        lines.append(line)
    return "\n".join(lines) + "\n"


def read_model_text(name_or_path: str) -> str:
    """Return the text of a model file: a shipped one by name, or a file."""
    if name_or_path in MODEL_NAMES:
        return (resources.files("evergym") / "models" / f"{name_or_path}.toml").read_text(encoding="utf-8")
    return Path(name_or_path).read_text(encoding="utf-8")


def _read_comments(text: str) -> dict[str, str]:
    """Return the comments that stand behind values, by the path of the key."""
    comments, table = {}, ""
    for line in text.splitlines():
        if header := _HEADER.match(line):
            table = f"{header.group(1).strip()}."
        elif entry := _ENTRY.match(line):
            comments[f"{table}{entry.group(1)}"] = entry.group(2)
    return comments
