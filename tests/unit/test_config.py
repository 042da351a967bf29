"""Strict TOML: what is read is what was written; what the schema does not know is refused with a useful message."""

from __future__ import annotations

import dataclasses
import enum
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evergym.config import (
    ParameterInfo,
    build,
    check,
    dump_toml,
    iterate_parameters,
    load_toml,
    parameter,
    to_mapping,
)
from evergym.errors import ConfigError


class Material(enum.StrEnum):
    NITINOL = "nitinol"
    LDPE = "ldpe"


@dataclasses.dataclass(frozen=True)
class Sheath:
    wall_um: float = parameter(35.0, unit="um", low=0.0, high=200.0, low_open=True, source="Table I")
    fibre_count: int = parameter(8, low=3, high=64)
    material: Material = Material.LDPE


@dataclasses.dataclass(frozen=True)
class Robot:
    name: str = parameter(help="how the robot is called in reports")
    sheath: Sheath = dataclasses.field(default_factory=Sheath)
    gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)
    stations_mm: tuple[float, ...] = parameter((), unit="mm", low=0.0, high=300.0)
    mesh: Path | None = None
    mass_g: float | None = parameter(None, unit="g", low=0.0)
    lubricated: bool = False
    loads_n: dict[str, float] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Interval:
    low: float = 0.0
    high: float = 1.0

    def __post_init__(self) -> None:
        if self.low > self.high:
            raise ConfigError(f"low is {self.low}, above high, which is {self.high}.")


@dataclasses.dataclass(frozen=True)
class Holder:
    interval: Interval = dataclasses.field(default_factory=Interval)


def refusal(mapping: Any, cls: type = Robot) -> str:
    """The message with which a mapping is refused."""
    with pytest.raises(ConfigError) as caught:
        build(cls, mapping, "my.toml")
    return str(caught.value)


# -- what is accepted


def test_keys_left_out_take_their_defaults() -> None:
    assert build(Robot, {"name": "m"}, "my.toml") == Robot("m")


def test_nested_tables_lists_enums_paths_and_optional_values() -> None:
    mapping = {
        "name": "m",
        "sheath": {"wall_um": 40, "material": "nitinol"},
        "gravity": [0, 0, -9.81],
        "stations_mm": [1.5, 2],
        "mesh": "duct.stl",
        "mass_g": 0.2,
        "lubricated": True,
        "loads_n": {"tip": 1},
    }
    robot = build(Robot, mapping, "my.toml")
    assert robot == Robot(
        "m",
        Sheath(40.0, 8, Material.NITINOL),
        (0.0, 0.0, -9.81),
        (1.5, 2.0),
        Path("duct.stl"),
        0.2,
        True,
        {"tip": 1.0},
    )


def test_a_whole_number_becomes_a_float() -> None:
    wall = build(Sheath, {"wall_um": 40}, "my.toml").wall_um
    assert type(wall) is float


@pytest.mark.parametrize("value", [np.float64(40.0), np.float32(40.0), np.int64(40)])
def test_numpy_scalars_become_python_numbers(value: Any) -> None:
    assert type(build(Sheath, {"wall_um": value}, "call").wall_um) is float


def test_instances_are_accepted_in_place_of_tables_and_still_checked() -> None:
    assert build(Robot, {"name": "m", "sheath": Sheath(50.0)}, "call").sheath.wall_um == 50.0
    assert "sheath.wall_um is 500.0 um" in refusal({"name": "m", "sheath": Sheath(500.0)})


# -- what is refused, and how


def test_an_unknown_key_suggests_the_nearest_and_says_where() -> None:
    message = refusal({"name": "m", "sheath": {"wal_um": 40}})
    assert message == "my.toml: unknown key 'wal_um' in [sheath]. Did you mean 'wall_um'?"


def test_an_unknown_key_unlike_any_lists_the_known_ones() -> None:
    message = refusal({"name": "m", "sheath": {"zzz": 1}})
    assert "Known keys: fibre_count, material, wall_um." in message


def test_a_missing_key_is_named() -> None:
    assert "'name' is missing" in refusal({})


@pytest.mark.parametrize(
    ("mapping", "part"),
    [
        ({"sheath": {"wall_um": 200.1}}, "sheath.wall_um is 200.1 um, but it must be above 0 and at most 200 um."),
        ({"sheath": {"wall_um": 0}}, "sheath.wall_um is 0.0 um"),
        ({"sheath": {"wall_um": -1.0}}, "sheath.wall_um is -1.0 um"),
        ({"sheath": {"wall_um": math.nan}}, "sheath.wall_um is nan um"),
        ({"sheath": {"wall_um": 10**400}}, "sheath.wall_um is 1000"),
        ({"sheath": {"fibre_count": 2}}, "sheath.fibre_count is 2, but it must be at least 3 and at most 64."),
        ({"gravity": [0.0, math.inf, 0.0]}, "gravity[1] is inf, but it must be finite."),
        ({"stations_mm": [1.0, 301.0]}, "stations_mm[1] is 301.0 mm"),
        ({"mass_g": -0.1}, "mass_g is -0.1 g, but it must be at least 0 g."),
        ({"loads_n": {"tip": math.inf}}, "loads_n.tip is inf"),
    ],
)
def test_values_out_of_bounds_say_value_limit_and_unit(mapping: dict[str, Any], part: str) -> None:
    assert part in refusal({"name": "m", **mapping})


@pytest.mark.parametrize(
    ("mapping", "part"),
    [
        ({"name": 3}, "name must be a text, not 3 (int)."),
        ({"name": "m", "lubricated": 1}, "lubricated must be true or false, not 1 (int)."),
        ({"name": "m", "sheath": {"wall_um": True}}, "sheath.wall_um must be a number, not True (bool)."),
        ({"name": "m", "sheath": {"wall_um": "40"}}, "sheath.wall_um must be a number, not '40' (str)."),
        ({"name": "m", "sheath": {"fibre_count": 8.0}}, "sheath.fibre_count must be a whole number, not 8.0 (float)."),
        ({"name": "m", "sheath": {"fibre_count": False}}, "sheath.fibre_count must be a whole number"),
        ({"name": "m", "sheath": 3}, "sheath must be a table of keys, not 3 (int)."),
        ({"name": "m", "gravity": 9.81}, "gravity must be a list"),
        ({"name": "m", "gravity": [0.0, 1.0]}, "gravity has 2 values, but it must have 3."),
        ({"name": "m", "gravity": [0.0, "x", 1.0]}, "gravity[1] must be a number"),
        ({"name": "m", "loads_n": [1.0]}, "loads_n must be a table of keys, not a list."),
        ({"name": "m", "mesh": 3}, "mesh must be a path (text), not 3 (int)."),
        ({"name": "m", "sheath": {"material": "LDPE"}}, "must be one of 'nitinol', 'ldpe'."),
        ({"name": "m", "sheath": {"material": "nitinl"}}, "Did you mean 'nitinol'?"),
        ([], "must be a table of keys"),
    ],
)
def test_wrong_types_are_refused(mapping: Any, part: str) -> None:
    message = refusal(mapping)
    assert message.startswith("my.toml: ")
    assert part in message


def test_a_rule_between_keys_is_reported_with_its_place() -> None:
    message = refusal({"interval": {"low": 2.0}}, Holder)
    assert message == "my.toml: [interval] low is 2.0, above high, which is 1.0."


def test_check_refuses_what_python_code_made() -> None:
    check(Sheath(), "call")
    with pytest.raises(ConfigError, match=r"call: wall_um is 1000\.0 um"):
        check(Sheath(1000.0), "call")


# -- files


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml' does not exist"):
        load_toml(tmp_path / "none.toml", Robot)


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load_toml(tmp_path, Robot)


@pytest.mark.parametrize(
    ("content", "place"),
    [
        (b'name = "m"\nsheath = = 3\n', "line 2"),
        (b'name = "m"\n\n[sheath', "line 3"),
        (b'name = "m"\nname = "n"\n', "line 2"),
        (b'name = "m"\n# \xff\n', "line 2"),
        (b"name = " + b"[" * 100_000, "TOML"),
    ],
)
def test_bad_toml_says_file_and_line(tmp_path: Path, content: bytes, place: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        load_toml(path, Robot)
    assert str(caught.value).startswith(f"{path}")
    assert place in str(caught.value)


def test_a_wrong_value_in_a_file_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text('name = "m"\nweight = 3\n')
    with pytest.raises(ConfigError, match=r"bad\.toml: unknown key 'weight'"):
        load_toml(path, Robot)


# -- round trip

finite = st.floats(allow_nan=False, allow_infinity=False)
sheaths = st.builds(
    Sheath,
    wall_um=st.floats(0.0, 200.0, exclude_min=True),
    fibre_count=st.integers(3, 64),
    material=st.sampled_from(Material),
)
robots = st.builds(
    Robot,
    name=st.text(),
    sheath=sheaths,
    gravity=st.tuples(finite, finite, finite),
    stations_mm=st.lists(st.floats(0.0, 300.0)).map(tuple),
    mesh=st.none() | st.sampled_from([Path("a/b.stl"), Path("/x y/ü.obj")]),
    mass_g=st.none() | st.floats(0.0, 1e9),
    lubricated=st.booleans(),
    loads_n=st.dictionaries(st.text(), finite),
)


@given(robots)
def test_a_file_gives_back_the_instance_to_the_last_bit(tmp_path_factory: pytest.TempPathFactory, robot: Robot) -> None:
    path = tmp_path_factory.getbasetemp() / "round_trip.toml"
    path.write_bytes(dump_toml(robot).encode())
    again = load_toml(path, Robot)
    assert again == robot
    assert repr(again) == repr(robot)  # tells -0.0 from 0.0, and a float from an int


@given(st.recursive(st.none() | st.booleans() | finite | st.text(), lambda inner: st.dictionaries(st.text(), inner)))
def test_no_content_escapes_as_another_error(content: object) -> None:
    try:
        build(Robot, {"name": "m", "sheath": content}, "my.toml")
    except ConfigError as error:
        assert str(error).startswith("my.toml: ")


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 500.0])
def test_what_could_not_be_read_is_not_written(wrong: float) -> None:
    with pytest.raises(ConfigError, match="wall_um"):
        dump_toml(Robot("m", Sheath(wrong)))


def test_none_is_left_out() -> None:
    assert "mesh" not in to_mapping(Robot("m"))


# -- the schema itself


def test_parameters_are_listed_with_paths_units_and_defaults() -> None:
    listed = {path: (info, default) for path, info, default in iterate_parameters(Robot)}
    assert listed["sheath.wall_um"] == (ParameterInfo("um", 0.0, 200.0, True, "Table I"), 35.0)
    assert listed["loads_n"] == (ParameterInfo(), {})
    assert listed["name"][1] is dataclasses.MISSING


def test_a_default_out_of_its_own_bounds_is_a_programming_error() -> None:
    with pytest.raises(ValueError, match="out of its own bounds"):
        parameter(0.0, low=0.0, low_open=True)


@dataclasses.dataclass
class Mutable:
    x: float = 0.0


@dataclasses.dataclass(frozen=True)
class OptionalWithValue:
    x: float | None = 1.0


@dataclasses.dataclass(frozen=True)
class Ambiguous:
    x: int | str = 0


@dataclasses.dataclass(frozen=True)
class HoleInList:
    x: tuple[float | None, ...] = ()


@dataclasses.dataclass(frozen=True)
class Unreadable:
    x: complex = 0j


@pytest.mark.parametrize("cls", [Mutable, OptionalWithValue, Ambiguous, HoleInList, Unreadable, int])
def test_classes_that_cannot_be_schemas_are_programming_errors(cls: type) -> None:
    with pytest.raises(TypeError):
        build(cls, {}, "my.toml")
