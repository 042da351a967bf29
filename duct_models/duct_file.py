"""duct.toml: which mesh a duct is made of, and how it is placed."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Any

from evergym.errors import GeometryError
from evergym.units import DEG, MM

__all__ = ["read_duct_file"]

_KEYS = {
    "mesh": str,
    "name": str,
    "unit": str,
    "scale": float,
    "port_mm": list,
    "direction": list,
    "roll_deg": float,
    "robot_outer_diameter_mm": float,
}
_TABLES = {"pose": ("port_mm", "direction", "roll_deg")}


def read_duct_file(path: Path) -> dict[str, Any]:
    """Read a ``duct.toml``.

        mesh = "lobe.stl"              # beside this file, or an absolute path
        name = "LB-03"                 # optional, as are all keys below
        unit = "mm"                    # of the mesh file: m, cm, mm, um, inch
        scale = 1.1
        robot_outer_diameter_mm = 3.0
        [pose]
        port_mm = [0.0, 1.5, -20.0]    # where the robot enters, in the mesh's frame after unit and scale
        direction = [0.0, 0.0, 1.0]    # of insertion
        roll_deg = 0.0                 # about it, of the placed mesh

    Args:
        path: The file.

    Returns:
        The keyword arguments of ``load_duct``, and the mesh's path as "mesh".

    Raises:
        GeometryError: If the file is missing, no TOML, or has an unknown key or a value of the wrong kind.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise GeometryError(
            f"Duct file '{path}' does not exist. Give a mesh file or a duct.toml that names one."
        ) from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise GeometryError(f"Duct file '{path}' cannot be read as TOML: {error}.") from None
    flat: dict[str, Any] = {}
    for key, value in data.items():
        if key in _TABLES:
            if not isinstance(value, dict):
                raise GeometryError(f"Duct file '{path}': '{key}' must be a table ([{key}]).")
            for inner, part in value.items():
                _check_key(path, inner, _TABLES[key], f"[{key}] ")
                flat[inner] = _check_value(path, inner, part)
        else:
            _check_key(path, key, [name for name in _KEYS if name not in _TABLES["pose"]] + list(_TABLES), "")
            flat[key] = _check_value(path, key, value)
    if "mesh" not in flat:
        raise GeometryError(f"Duct file '{path}' names no mesh. Add: mesh = \"lobe.stl\"")
    result: dict[str, Any] = {key: flat[key] for key in ("name", "unit", "scale", "direction") if key in flat}
    # a relative path is relative to the file that holds it, wherever it is read from
    result["mesh"] = path.parent / flat["mesh"]
    if "port_mm" in flat:
        result["port"] = [value * MM for value in flat["port_mm"]]
    if "roll_deg" in flat:
        result["roll"] = flat["roll_deg"] * DEG
    if "robot_outer_diameter_mm" in flat:
        result["robot_outer_diameter"] = flat["robot_outer_diameter_mm"] * MM
    return result


def _check_key(path: Path, key: str, known: list[str] | tuple[str, ...], table: str) -> None:
    if key in known:
        return
    close = difflib.get_close_matches(key, known, n=1)
    hint = f" Did you mean '{close[0]}'?" if close else f" Known keys: {', '.join(known)}."
    raise GeometryError(f"Duct file '{path}': unknown key {table}'{key}'.{hint}")


def _check_value(path: Path, key: str, value: Any) -> Any:
    kind = _KEYS[key]
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if kind is str and isinstance(value, str):
        return value
    numbers = isinstance(value, list) and len(value) == 3
    if kind is list and numbers and all(isinstance(x, int | float) and not isinstance(x, bool) for x in value):
        return [float(x) for x in value]
    expected = {float: "a number", str: "a text", list: "three numbers"}[kind]
    raise GeometryError(f"Duct file '{path}': '{key}' must be {expected}: got {value!r}.")
