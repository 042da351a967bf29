"""Strict TOML files <-> frozen dataclasses: the only place where a file's keys become values.

A dataclass is the file's schema: its field names are the keys, nested dataclasses are tables, and ``parameter`` gives a
field its unit, bounds and source. Whatever the schema does not know is an error, so that a misspelt key never runs with
the default in its place. None has no form in TOML: an optional field that is None is left out, so its default is None.
"""

from __future__ import annotations

import dataclasses
import difflib
import enum
import functools
import math
import numbers
import re
import tomllib
import types
import typing
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import tomli_w

from evergym.errors import ConfigError

__all__ = [
    "ParameterInfo",
    "build",
    "check",
    "dump_toml",
    "iterate_parameters",
    "load_toml",
    "parameter",
    "to_mapping",
]

T = TypeVar("T")

_METADATA_KEY = "evergym"


@dataclasses.dataclass(frozen=True)
class ParameterInfo:
    """What is known about one key beside its type.

    Attributes:
        unit: The unit of the value and of its limits, as people write it ("mm", "kPa"); empty for pure numbers.
        low: Smallest value allowed; None for no limit.
        high: Largest value allowed; None for no limit.
        low_open: The limit ``low`` itself is not allowed.
        source: Where the default comes from.
        prior: The default has no source and is a guess.
        help: One sentence for people.
    """

    unit: str = ""
    low: float | None = None
    high: float | None = None
    low_open: bool = False
    source: str = ""
    prior: bool = False
    help: str = ""

    def allows(self, value: float) -> bool:
        """Whether a number is finite and within the limits."""
        if not math.isfinite(value) or (self.high is not None and value > self.high):
            return False
        return self.low is None or value > self.low or (value == self.low and not self.low_open)

    def describe_limits(self) -> str:
        """The limits in words, such as "above 0 and at most 50 kPa"."""
        limits = []
        if self.low is not None:
            limits.append(f"{'above' if self.low_open else 'at least'} {self.low:g}")
        if self.high is not None:
            limits.append(f"at most {self.high:g}")
        return " and ".join(limits or ["finite"]) + (f" {self.unit}" if self.unit else "")


def parameter(
    default: Any = dataclasses.MISSING,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    low_open: bool = False,
    source: str = "",
    prior: bool = False,
    help: str = "",  # noqa: A002  (the word that command lines use)
) -> Any:
    """A dataclass field with unit, bounds and source; without a default the key must be given.

    Bounds hold for every element of a tuple field.

    Raises:
        ValueError: The default itself is out of bounds.
    """
    info = ParameterInfo(unit, low, high, low_open, source, prior, help)
    for value in default if isinstance(default, tuple) else (default,):
        if _is_real(value) and not info.allows(value):
            raise ValueError(f"The default {value!r} is out of its own bounds: {info.describe_limits()}.")
    return dataclasses.field(default=default, metadata={_METADATA_KEY: info})


def iterate_parameters(cls: type, prefix: str = "") -> Iterator[tuple[str, ParameterInfo, Any]]:
    """Every key of a schema, depth first, as (path such as "robot.sheath.wall_um", information, default)."""
    for field, annotation in _fields(cls).values():
        path = f"{prefix}{field.name}"
        if isinstance(annotation, type) and dataclasses.is_dataclass(annotation):
            yield from iterate_parameters(annotation, f"{path}.")
        else:
            default = field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
            yield path, _info(field), default


def load_toml(path: str | Path, cls: type[T]) -> T:
    """Read a TOML file into a frozen dataclass.

    Raises:
        ConfigError: The file is missing, unreadable or not TOML (with the line), or its content does not fit ``cls``.
    """
    path = Path(path)
    try:
        text = path.read_bytes().decode("utf-8")
    except FileNotFoundError:
        raise ConfigError(f"File '{path}' does not exist. Check the path, or create the file.") from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise ConfigError(
            f"{path}, line {line}: the file is not text in UTF-8. Save it as UTF-8, or choose another file."
        ) from None
    except OSError as error:
        raise ConfigError(f"File '{path}' cannot be read: {error.strerror}.") from None
    try:
        mapping = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        reason, _, position = str(error).rpartition(" (at ")
        found = re.match(r"line (\d+), column (\d+)", position)
        where = f"line {found[1]}, column {found[2]}" if found else f"line {max(1, len(text.splitlines()))}"
        raise ConfigError(f"{path}, {where}: not valid TOML: {reason or error}.") from None
    except RecursionError:
        raise ConfigError(f"{path}: not valid TOML: brackets are nested too deeply.") from None
    return build(cls, mapping, str(path))


def build(cls: type[T], mapping: Mapping[str, Any], where: str) -> T:
    """Make a frozen dataclass from nested mappings; keys that are left out take their defaults.

    Whole numbers are accepted for floats, lists for tuples, strings for enums and paths; nothing else is converted.

    Args:
        cls: The schema: a frozen dataclass of bool, int, float, str, enums, paths, tuples, dicts with string keys,
            optional values (``X | None``) and further frozen dataclasses.
        mapping: The content, as ``tomllib`` gives it.
        where: The start of every message, usually the file.
    Raises:
        ConfigError: Unknown or missing key, wrong type, value out of bounds or not finite.
    """
    return typing.cast(T, _build_table(cls, mapping, where, ""))


def check(instance: object, where: str) -> None:
    """Hold an instance that was made in Python to the bounds and types of its schema.

    Raises:
        ConfigError: As ``build``.
    """
    _build_table(type(instance), to_mapping(instance), where, "")


def to_mapping(instance: object) -> dict[str, Any]:
    """The nested mapping that ``build`` turns back into an equal instance; None is left out."""
    cls: type = type(instance)
    fields = _fields(cls)
    pairs = ((name, getattr(instance, name)) for name in fields)
    return {name: _to_plain(value) for name, value in pairs if value is not None}


def dump_toml(instance: object) -> str:
    """The TOML text that ``load_toml`` reads back into an equal instance, to the last bit.

    Raises:
        ConfigError: The instance holds values that ``load_toml`` would refuse.
    """
    check(instance, type(instance).__name__)
    return tomli_w.dumps(to_mapping(instance))


def _build_table(cls: type, mapping: object, where: str, path: str) -> object:
    if not isinstance(mapping, Mapping):
        raise ConfigError(f"{where}: {path or cls.__name__} must be a table of keys, not {_describe(mapping)}.")
    fields = _fields(cls)
    for key in mapping:
        if key not in fields:
            raise ConfigError(_unknown_key_message(str(key), list(fields), where, path))
    values = {}
    for name, (field, annotation) in fields.items():
        key_path = f"{path}.{name}" if path else name
        if name in mapping:
            values[name] = _build_value(annotation, mapping[name], _info(field), where, key_path)
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise ConfigError(f"{where}: the key '{key_path}' is missing and has no default. Add it.")
    try:
        return cls(**values)
    except (ConfigError, ValueError) as error:  # from __post_init__: rules between keys
        raise ConfigError(f"{where}: {f'[{path}] ' if path else ''}{error}") from error


def _build_value(annotation: Any, value: object, info: ParameterInfo, where: str, path: str) -> object:
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin in (types.UnionType, typing.Union):
        (inner,) = (argument for argument in arguments if argument is not types.NoneType)
        return None if value is None else _build_value(inner, value, info, where, path)
    if origin is tuple:
        return _build_tuple(arguments, value, info, where, path)
    if origin is dict:
        if not isinstance(value, Mapping):
            raise ConfigError(f"{where}: {path} must be a table of keys, not {_describe(value)}.")
        return {str(k): _build_value(arguments[1], v, info, where, f"{path}.{k}") for k, v in value.items()}
    if dataclasses.is_dataclass(annotation) and isinstance(annotation, type):
        mapping = to_mapping(value) if type(value) is annotation else value
        return _build_table(annotation, mapping, where, path)
    if annotation in (int, float):
        return _build_number(annotation, value, info, where, path)
    if issubclass(annotation, enum.Enum):
        return _build_choice(annotation, value, where, path)
    wanted: tuple[type, ...] = (str, Path) if annotation is Path else (annotation,)
    if not isinstance(value, wanted):
        raise ConfigError(f"{where}: {path} must be {_TYPE_NAMES[annotation]}, not {_describe(value)}.")
    return annotation(value)


def _build_number(annotation: type, value: object, info: ParameterInfo, where: str, path: str) -> float:
    kind = numbers.Integral if annotation is int else numbers.Real
    if not isinstance(value, kind) or isinstance(value, bool):
        raise ConfigError(f"{where}: {path} must be {_TYPE_NAMES[annotation]}, not {_describe(value)}.")
    try:
        number = annotation(value)
        allowed = info.allows(number)
    except OverflowError:
        number, allowed = value, False
    if not allowed:
        unit = f" {info.unit}" if info.unit else ""
        raise ConfigError(f"{where}: {path} is {number}{unit}, but it must be {info.describe_limits()}.")
    return typing.cast(float, number)


def _build_tuple(arguments: tuple[Any, ...], value: object, info: ParameterInfo, where: str, path: str) -> object:
    if not isinstance(value, list | tuple):
        raise ConfigError(f"{where}: {path} must be a list, not {_describe(value)}.")
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        arguments = (arguments[0],) * len(value)
    if len(arguments) != len(value):
        raise ConfigError(f"{where}: {path} has {len(value)} values, but it must have {len(arguments)}.")
    pairs = enumerate(zip(arguments, value, strict=True))
    return tuple(_build_value(inner, element, info, where, f"{path}[{i}]") for i, (inner, element) in pairs)


def _build_choice(annotation: type[enum.Enum], value: object, where: str, path: str) -> enum.Enum:
    if isinstance(value, annotation):
        return value
    try:
        return annotation(value)
    except ValueError:
        choices = [str(member.value) for member in annotation]
        raise ConfigError(
            f"{where}: {path} is {value!r}, but it must be one of {', '.join(map(repr, choices))}."
            + _suggestion(str(value), choices)
        ) from None


_TYPE_NAMES: dict[type, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a text",
    Path: "a path (text)",
}


@functools.cache
def _fields(cls: type) -> dict[str, tuple[dataclasses.Field[Any], Any]]:
    """The keys of a schema with their resolved types; TypeError where a class cannot be one (a programming error)."""
    if not dataclasses.is_dataclass(cls) or not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]
        raise TypeError(f"{cls.__name__} is no schema: it must be a frozen dataclass.")
    hints = typing.get_type_hints(cls)
    fields = {field.name: (field, hints[field.name]) for field in dataclasses.fields(cls) if field.init}
    for field, annotation in fields.values():
        _require_supported(annotation, field, f"{cls.__name__}.{field.name}")
    return fields


def _require_supported(annotation: Any, field: dataclasses.Field[Any], where: str) -> None:
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin in (types.UnionType, typing.Union):
        if len(arguments) != 2 or types.NoneType not in arguments:
            raise TypeError(f"{where}: of unions only 'X | None' can be read from a file.")
        if field.default is not None:
            raise TypeError(f"{where}: TOML cannot write None, so an optional key must have None as its default.")
        inner = [argument for argument in arguments if argument is not types.NoneType]
    elif origin is tuple:
        inner = [argument for argument in arguments if argument is not Ellipsis]
    elif origin is dict and arguments[0] is str:
        inner = [arguments[1]]
    elif annotation in _TYPE_NAMES or (
        isinstance(annotation, type) and (issubclass(annotation, enum.Enum) or dataclasses.is_dataclass(annotation))
    ):
        inner = []
    else:
        raise TypeError(f"{where}: values of type {annotation} cannot be read from a file.")
    for argument in inner:
        if typing.get_origin(argument) in (types.UnionType, typing.Union):
            raise TypeError(f"{where}: TOML cannot write None inside a list or table.")
        _require_supported(argument, field, where)


def _info(field: dataclasses.Field[Any]) -> ParameterInfo:
    info: ParameterInfo = field.metadata.get(_METADATA_KEY, ParameterInfo())
    return info


def _is_real(value: object) -> typing.TypeGuard[float]:
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def _to_plain(value: object) -> object:
    if dataclasses.is_dataclass(value):
        return to_mapping(value)
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, tuple | list):
        return [_to_plain(element) for element in value]
    if isinstance(value, Mapping):
        return {key: _to_plain(element) for key, element in value.items()}
    return value


def _unknown_key_message(key: str, known: list[str], where: str, path: str) -> str:
    table = f" in [{path}]" if path else ""
    hint = _suggestion(key, known) or f" Known keys: {', '.join(sorted(known))}."
    return f"{where}: unknown key '{key}'{table}.{hint}"


def _suggestion(word: str, known: list[str]) -> str:
    nearest = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f" Did you mean '{nearest[0]}'?" if nearest else ""


def _describe(value: object) -> str:
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, list | tuple):
        return "a list"
    return f"{value!r} ({type(value).__name__})"
