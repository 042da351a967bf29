"""Where the values of a model come from: the comments of its file, else the sources of the defaults."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from evergym.config import iterate_parameters, to_mapping
from evergym.model import MODEL_NAMES, Model

__all__ = ["ParameterRecord", "describe_parameters", "read_model_text"]

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
