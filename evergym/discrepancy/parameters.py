"""Read and replace single parameters of a model by their path, such as "effects.tendon_stretch.compliance_mm_per_n"."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any

from evergym.config import ParameterInfo, iterate_parameters
from evergym.errors import ConfigError
from evergym.model import Model

__all__ = ["find_info", "get_value", "list_paths", "set_values"]


@functools.cache
def _table() -> dict[str, ParameterInfo]:
    return {path: info for path, info, _ in iterate_parameters(Model)}


def list_paths() -> list[str]:
    """Return the paths of all parameters of a model, in the order of its file."""
    return list(_table())


def find_info(path: str) -> ParameterInfo:
    """Return what is known about a parameter: unit, limits, source.

    Raises:
        ConfigError: no model has such a parameter.
    """
    info = _table().get(path)
    if info is None:
        raise ConfigError(f"A model has no parameter '{path}'.")
    return info


def get_value(model: Model, path: str) -> Any:
    """Return the value of a parameter, in the unit of the model file."""
    find_info(path)
    value: Any = model
    for name in path.split("."):
        value = getattr(value, name)
    return value


def set_values(model: Model, values: Mapping[str, Any]) -> Model:
    """Return the model with some parameters replaced (in the units of the model file); limits are not checked."""
    nested: dict[str, Any] = {}
    for path, value in values.items():
        find_info(path)
        *tables, name = path.split(".")
        place = nested
        for table in tables:
            place = place.setdefault(table, {})
        place[name] = value
    result: Model = _replace(model, nested)
    return result


def _replace(instance: Any, values: Mapping[str, Any]) -> Any:
    changes = {
        name: _replace(getattr(instance, name), value) if isinstance(value, dict) else value
        for name, value in values.items()
    }
    return dataclasses.replace(instance, **changes)
