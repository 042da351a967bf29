"""Datasets as labs write them: what is read, and how every fault is named by file, row and column."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evergym.discrepancy.data.columns import CHANNELS, COLUMNS, COMMANDS
from evergym.discrepancy.data.dataset import Dataset
from evergym.discrepancy.data.reading import load_dataset
from evergym.errors import ConfigError
from evergym.robot import RobotConfig

TOML = """\
schema = 1
name = "bench"
description = "two runs"
ignore = []

[noise]
tip_x_mm = 0.3
tip_z_mm = 0.3
everted_length_mm = 0.5

[[run]]
id = "r01"
setup = "full"
gravity_mps2 = [0.0, -9.81, 0.0]
experiment = "steps"
environment = "free"
initial_everted_length_mm = 10.0

[[run]]
id = "r02"
"""
CSV = """\
run,time_s,insertion_mm_s,tail_feed_mm_s,pressure_kpa,tendon_pull_mm,tip_x_mm,tip_z_mm,everted_length_mm
r01,0.0,2.9,,30,0,0.1,10.0,10.1
r01,0.5,2.9,4.0,,1,0.2,10.5,
r01,1.0,,,20,,0.3,11.0,11.2
r02,0.0,,,5,0.5,0.1,10.0,10.0
r02,2.0,1.0,,,,,,
"""


def write(folder: Path, toml: str = TOML, csv: str = CSV) -> Path:
    (folder / "dataset.toml").write_text(toml, encoding="utf-8")
    (folder / "samples.csv").write_text(csv, encoding="utf-8", newline="")
    return folder


def column(dataset: Dataset, run: int, name: str) -> list[float]:
    where = dataset.runs[run]
    values = where.commands[:, COMMANDS.index(name)] if name in COMMANDS else where.measured[:, CHANNELS.index(name)]
    return values.tolist()


# -- good data


def test_runs_are_read_with_their_conditions(tmp_path: Path) -> None:
    dataset = load_dataset(write(tmp_path))
    assert (dataset.name, dataset.description, dataset.path) == ("bench", "two runs", tmp_path)
    assert dataset.noise == {"tip_x_mm": 0.3, "tip_z_mm": 0.3, "everted_length_mm": 0.5}
    assert dataset.channels == ("tip_x_mm", "tip_z_mm", "everted_length_mm")
    first, second = dataset.runs
    assert (first.id, first.setup, first.experiment, first.environment) == ("r01", "full", "steps", "free")
    assert first.gravity == (0.0, -9.81, 0.0)
    assert second.experiment == "r02"  # a run that names none is an experiment of its own
    assert first.time_s.tolist() == [0.0, 0.5, 1.0]
    assert column(dataset, 0, "tip_z_mm") == [10.0, 10.5, 11.0]
    np.testing.assert_equal(column(dataset, 0, "everted_length_mm"), [10.1, np.nan, 11.2])
    assert np.isnan(column(dataset, 1, "tip_x_mm")[1])
    assert dataset.duration == 3.0
    assert dataset.set_aside == ()


def test_an_empty_command_keeps_its_last_value_and_starts_at_zero(tmp_path: Path) -> None:
    dataset = load_dataset(write(tmp_path))
    assert column(dataset, 0, "pressure_kpa") == [30.0, 30.0, 20.0]
    assert column(dataset, 0, "tendon_pull_mm") == [0.0, 1.0, 1.0]
    assert column(dataset, 0, "insertion_mm_s") == [2.9, 2.9, 2.9]
    assert column(dataset, 1, "insertion_mm_s") == [0.0, 1.0]
    assert column(dataset, 1, "roll_deg") == [0.0, 0.0]


def test_the_tail_is_coupled_again_by_an_insertion_without_feed(tmp_path: Path) -> None:
    csv = (
        "run,time_s,insertion_mm_s,tail_feed_mm_s,tip_x_mm\nr01,0,1,,0\nr01,1,1,5,0\nr01,2,,,0\nr01,3,2,,0\nr02,0,,,0\n"
    )
    dataset = load_dataset(write(tmp_path, csv=csv))
    np.testing.assert_equal(column(dataset, 0, "tail_feed_mm_s"), [np.nan, 5.0, 5.0, np.nan])


def test_arrays_are_read_only(tmp_path: Path) -> None:
    run = load_dataset(write(tmp_path)).runs[0]
    for array in (run.time_s, run.commands, run.measured):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_ignored_channels_are_not_measured(tmp_path: Path) -> None:
    dataset = load_dataset(write(tmp_path, TOML.replace("ignore = []", 'ignore = ["tip_x_mm"]')))
    assert dataset.channels == ("tip_z_mm", "everted_length_mm")


def test_an_ignored_channel_needs_no_noise(tmp_path: Path) -> None:
    toml = TOML.replace("ignore = []", 'ignore = ["tip_x_mm"]').replace("tip_x_mm = 0.3\n", "")
    assert "tip_x_mm" not in load_dataset(write(tmp_path, toml)).channels


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text + "\n\n,,,,,,,,\n",
        lambda text: text.replace(",", " , "),
    ],
    ids=["byte order mark", "windows line ends", "empty rows at the end", "spaces around commas"],
)
def test_what_spreadsheets_do_to_a_table_does_no_harm(tmp_path: Path, change: object) -> None:
    (tmp_path / "plain").mkdir()
    (tmp_path / "changed").mkdir()
    plain = load_dataset(write(tmp_path / "plain"))
    changed = load_dataset(write(tmp_path / "changed", csv=change(CSV)))  # type: ignore[operator]
    for one, other in zip(plain.runs, changed.runs, strict=True):
        np.testing.assert_array_equal(one.commands, other.commands)
        np.testing.assert_array_equal(one.measured, other.measured)


def test_a_byte_order_mark_before_the_toml_does_no_harm(tmp_path: Path) -> None:
    assert load_dataset(write(tmp_path, "\ufeff" + TOML.replace("\n", "\r\n"))).name == "bench"


def test_columns_may_come_in_any_order(tmp_path: Path) -> None:
    lines = [line.split(",") for line in CSV.splitlines()]
    turned = "\n".join(",".join(reversed(cells)) for cells in lines)
    dataset = load_dataset(write(tmp_path, csv=turned))
    assert column(dataset, 0, "tip_z_mm") == [10.0, 10.5, 11.0]


def test_rows_of_runs_may_be_interleaved(tmp_path: Path) -> None:
    header, *rows = CSV.splitlines()
    dataset = load_dataset(write(tmp_path, csv="\n".join([header, rows[3], rows[0], rows[1], rows[4], rows[2]])))
    assert dataset.runs[0].time_s.tolist() == [0.0, 0.5, 1.0]
    assert dataset.runs[1].time_s.tolist() == [0.0, 2.0]


def test_parquet_is_read_like_csv(tmp_path: Path) -> None:
    (tmp_path / "csv").mkdir()
    (tmp_path / "parquet").mkdir()
    write(tmp_path / "csv")
    pd.read_csv(tmp_path / "csv" / "samples.csv").to_parquet(tmp_path / "parquet" / "samples.parquet")
    (tmp_path / "parquet" / "dataset.toml").write_text(TOML)
    for one, other in zip(load_dataset(tmp_path / "csv").runs, load_dataset(tmp_path / "parquet").runs, strict=True):
        np.testing.assert_array_equal(one.time_s, other.time_s)
        np.testing.assert_array_equal(one.commands, other.commands)
        np.testing.assert_array_equal(one.measured, other.measured)


def test_negative_angles_beyond_noise_are_signs(tmp_path: Path) -> None:
    toml = TOML.replace("[noise]\n", "[noise]\ntip_angle_deg = 1.0\n")
    for value, signed in (("-20", True), ("-2", False), ("20", False)):
        csv = f"run,time_s,tip_angle_deg\nr01,0,{value}\nr02,0,1\n"
        assert load_dataset(write(tmp_path, toml, csv)).runs[0].signed_angles is signed


# -- rows that the robot cannot have produced


def test_rows_beyond_the_robot_are_set_aside_and_counted(tmp_path: Path) -> None:
    csv = CSV.replace("r01,0.5,2.9,4.0,,1,0.2,10.5,", "r01,0.5,2.9,4.0,,1,0.2,400,")
    dataset = load_dataset(write(tmp_path, csv=csv))
    ((row, why),) = dataset.set_aside
    assert row == 3
    assert "tip farther from the port than the sheath is long" in why
    assert np.isnan(dataset.runs[0].measured[1]).all()
    assert column(dataset, 0, "tendon_pull_mm") == [0.0, 1.0, 1.0]  # its commands were given all the same
    assert column(dataset, 0, "tip_z_mm")[2] == 11.0


def test_the_robot_of_the_rig_decides_what_is_impossible(tmp_path: Path) -> None:
    csv = CSV.replace("r01,0.5,2.9,4.0,,1,0.2,10.5,", "r01,0.5,2.9,4.0,,1,0.2,400,")
    toml = TOML.replace("[[run]]", "[robot]\nsheath_material_length_mm = 1000.0\n\n[[run]]", 1)
    assert load_dataset(write(tmp_path, toml, csv)).set_aside == ()
    assert load_dataset(write(tmp_path, TOML, csv), RobotConfig(sheath_material_length_mm=1000.0)).set_aside == ()


def test_a_catheter_without_sheath_is_as_long_as_it_is(tmp_path: Path) -> None:
    toml = TOML.replace('setup = "full"', 'setup = "catheter"')
    csv = "run,time_s,tip_z_mm\nr01,0,94\nr01,1,120\nr02,0,120\n"
    ((row, why),) = load_dataset(write(tmp_path, toml, csv)).set_aside
    assert row == 3
    assert "than the catheter is long (120.0 of 95.0 mm)" in why


def test_a_catheter_pushed_out_of_the_sheath_may_reach_farther(tmp_path: Path) -> None:
    csv = "run,time_s,insertion_mm_s,tip_z_mm\nr01,0,5,10\nr01,40,0,200\nr02,0,0,200\n"
    ((row, _),) = load_dataset(write(tmp_path, csv=csv)).set_aside
    assert row == 4  # the run that inserted nothing


@pytest.mark.parametrize("value", ["160", "-20"])
def test_an_everted_length_beyond_the_sheath_is_set_aside(tmp_path: Path, value: str) -> None:
    csv = f"run,time_s,everted_length_mm\nr01,0,10\nr01,1,{value}\nr02,0,10\n"
    ((row, why),) = load_dataset(write(tmp_path, csv=csv)).set_aside
    assert row == 3
    assert "everted length" in why


# -- bad data: (what is changed in the toml, what in the samples, what the message must say)


def in_toml(old: str, new: str) -> tuple[str, str]:
    assert old in TOML
    return TOML.replace(old, new, 1), CSV


def in_csv(old: str, new: str) -> tuple[str, str]:
    assert old in CSV
    return TOML, CSV.replace(old, new, 1)


BAD = {
    "unknown column": (in_csv("tip_z_mm", "tip_z"), ["samples.csv, row 1", "unknown column 'tip_z'", "'tip_z_mm'"]),
    "column with another unit": (in_csv("pressure_kpa", "pressure_pa"), ["'pressure_pa'", "'pressure_kpa'"]),
    "column twice": (in_csv("tip_z_mm", "tip_x_mm"), ["row 1", "'tip_x_mm' is there twice"]),
    "column without name": (in_csv("tip_z_mm", ""), ["row 1", "column 8 has no name"]),
    "no time column": ((TOML, "run,tip_x_mm\nr01,1\n"), ["row 1", "'time_s' is missing"]),
    "no run column": ((TOML, "time_s,tip_x_mm\n0,1\n"), ["row 1", "'run' is missing"]),
    "time backwards": (in_csv("r01,1.0", "r01,0.4"), ["row 4", "'time_s'", "0.4 s", "row 3", "must increase"]),
    "time twice": (in_csv("r01,1.0", "r01,0.5"), ["row 4", "'time_s'", "must increase"]),
    "no time": (in_csv("r01,1.0", "r01,"), ["row 4", "'time_s'", "empty"]),
    "a date for a time": (in_csv("r01,1.0", "r01,1700000000"), ["row 4", "'time_s'", "limit"]),
    "pascal for kilopascal": (in_csv(",30,", ",30000,"), ["row 2", "'pressure_kpa'", "30000 kPa", "unit"]),
    "micrometre for millimetre": (in_csv("11.2", "11200"), ["row 4", "'everted_length_mm'", "11200 mm", "unit"]),
    "metre for millimetre": (in_csv("10.1", "0.0101"), ["row 2", "'everted_length_mm'", "0.0101 mm", "in mm"]),
    "centimetre for millimetre": (in_csv("10.1", "1.01"), ["row 2", "'everted_length_mm'", "10 times", "in mm"]),
    "text in a cell": (in_csv("11.2", "long"), ["row 4", "'everted_length_mm'", "'long' is no finite number"]),
    "nan in a cell": (in_csv("11.2", "nan"), ["row 4", "'everted_length_mm'", "'nan'", "leave a cell empty"]),
    "infinity in a cell": (in_csv("11.2", "-inf"), ["row 4", "'everted_length_mm'", "'-inf'"]),
    "a digit separator": (in_csv("11.2", "1_1.2"), ["row 4", "'everted_length_mm'", "'1_1.2'"]),
    "nan for a command": (in_csv(",20,", ",NaN,"), ["row 4", "'pressure_kpa'", "'NaN'"]),
    "decimal comma": (in_csv("11.2", '"11,2"'), ["row 4", "'everted_length_mm'", "'11,2'", "decimal point"]),
    "a cell too many": (in_csv("11.2", "11.2,7"), ["row 4", "10 cells", "9 columns"]),
    "a cell too few": (in_csv("r02,2.0,1.0,,,,,,", "r02,2.0,1.0"), ["row 6", "3 cells", "9 columns"]),
    "semicolons": ((TOML, CSV.replace(",", ";")), ["samples.csv, row 1", "semicolons", "commas"]),
    "tabs": ((TOML, CSV.replace(",", "\t")), ["row 1", "tabs"]),
    "run not in the toml": (in_csv("r02,2.0", "r03,2.0"), ["row 6", "'run'", "'r03'", "dataset.toml", "'r02'"]),
    "row without run": (in_csv("r02,2.0", ",2.0"), ["row 6", "'run'", "empty"]),
    "run without samples": (
        in_toml('id = "r02"', 'id = "r02"\n[[run]]\nid = "r09"'),
        ["row 22, [[run]]", "'r09' has no samples", "'run'"],
    ),
    "no samples": ((TOML, CSV.splitlines()[0]), ["samples.csv", "no samples"]),
    "empty file": ((TOML, ""), ["samples.csv is empty"]),
    "nothing measured": ((TOML, "run,time_s,tip_x_mm\nr01,0,\nr02,0,\n"), ["samples.csv", "no row has a measurement"]),
    "channel without noise": (
        in_toml("tip_z_mm = 0.3\n", ""),
        ["dataset.toml, row 6, [noise]", "'tip_z_mm'", "from row 2"],
    ),
    "noise of zero": (in_toml("tip_z_mm = 0.3", "tip_z_mm = 0.0"), ["row 8, [noise]", "tip_z_mm is 0", "above 0"]),
    "noise below zero": (in_toml("tip_z_mm = 0.3", "tip_z_mm = -0.3"), ["row 8, [noise]", "tip_z_mm is -0.3"]),
    "noise that is text": (in_toml("tip_z_mm = 0.3", 'tip_z_mm = "small"'), ["row 8: noise.tip_z_mm", "a number"]),
    "noise of an unknown channel": (in_toml("tip_z_mm = 0.3", "tip_mm = 0.3"), ["row 8, [noise]", "'tip_mm'", "'tip_"]),
    "unknown ignored channel": (in_toml("ignore = []", 'ignore = ["tipx"]'), ["row 4, ignore", "'tipx'", "'tip_x_mm'"]),
    "no schema": (in_toml("schema = 1\n", ""), ["dataset.toml, row 1: names no schema", "schema = 1"]),
    "another schema": (in_toml("schema = 1", "schema = 2"), ["dataset.toml, row 1: the schema is 2", "reads 1"]),
    "unknown key": (in_toml("description", "descripton"), ["dataset.toml, row 3:", "'descripton'", "'description'"]),
    "unknown key of a run": (in_toml("experiment =", "experment ="), ["row 15:", "'experment'", "'experiment'"]),
    "run twice": (in_toml('id = "r02"', 'id = "r01"'), ["row 20, [[run]] 'r01'", "twice"]),
    "run without id": (in_toml('id = "r02"\n', ""), ["row 19:", "run[1].id", "missing"]),
    "no run": ((TOML.split("[[run]]")[0], CSV), ["dataset.toml names no run"]),
    "unknown setup": (in_toml('"full"', '"ful"'), ["row 13, [[run]] 'r01'", "'ful'", "'full'"]),
    "gravity of two numbers": (in_toml("[0.0, -9.81, 0.0]", "[0.0, -9.81]"), ["row 14:", "gravity_mps2", "2 values"]),
    "gravity in mm/s^2": (in_toml("-9.81", "-9810.0"), ["row 14:", "gravity_mps2", "-9810"]),
    "unknown environment": (in_toml('"free"', '"water"'), ["row 16, [[run]] 'r01'", "'water'", "pegs:"]),
    "missing environment file": (
        in_toml('"free"', '"pegs:pegs.csv"'),
        ["row 16, [[run]] 'r01'", "pegs.csv", "does not exist"],
    ),
    "unknown robot key": (
        in_toml("[[run]]", "[robot]\ncatheter_lenght_mm = 55.0\n[[run]]"),
        ["dataset.toml, row 12, [robot]", "'catheter_lenght_mm'", "'catheter_length_mm'"],
    ),
    "impossible robot": (
        in_toml("[[run]]", "[robot]\ncatheter_length_mm = -55.0\n[[run]]"),
        ["dataset.toml, row 12, [robot]", "catheter_length_mm is -55.0 mm", "at least 1"],
    ),
    "a start beyond the sheath": (
        in_toml("= 10.0", "= 200.0"),
        ["dataset.toml, row 17, [[run]] 'r01'", "initial_everted_length_mm is 200 mm", "140 mm at most"],
    ),
    "no toml": (in_toml('name = "bench"', 'name = "bench'), ["dataset.toml", "not valid TOML", "row 2"]),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_data_is_named_with_file_row_and_column(tmp_path: Path, case: str) -> None:
    (toml, csv), fragments = BAD[case]
    write(tmp_path, toml, csv)
    with pytest.raises(ConfigError) as caught:
        load_dataset(tmp_path)
    for fragment in fragments:
        assert fragment in str(caught.value)
    assert str(tmp_path) in str(caught.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["dataset.toml", "samples.csv"]


@pytest.mark.parametrize(
    ("names", "fragment"),
    [
        ([], "holds no dataset.toml"),
        (["dataset.toml"], "holds no samples.csv or samples.parquet"),
        (["dataset.toml", "samples.csv", "samples.parquet"], "holds both"),
    ],
)
def test_missing_files_are_named(tmp_path: Path, names: list[str], fragment: str) -> None:
    for name in names:
        (tmp_path / name).write_text(TOML if name.endswith("toml") else CSV)
    with pytest.raises(ConfigError, match=fragment):
        load_dataset(tmp_path)


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="There is no folder"):
        load_dataset(tmp_path / "nowhere")


def test_files_that_are_no_text_are_named_with_their_line(tmp_path: Path) -> None:
    write(tmp_path)
    (tmp_path / "samples.csv").write_bytes(CSV.encode() + b"r02,3.0,\xff\n")
    with pytest.raises(ConfigError, match=r"samples\.csv, row 7: .*UTF-8"):
        load_dataset(tmp_path)
    (tmp_path / "dataset.toml").write_bytes(b"schema = 1\nname = '\xe4'\n")
    with pytest.raises(ConfigError, match=r"dataset\.toml, row 2: .*UTF-8"):
        load_dataset(tmp_path)


def test_a_parquet_that_is_none_is_named(tmp_path: Path) -> None:
    (tmp_path / "dataset.toml").write_text(TOML)
    (tmp_path / "samples.parquet").write_text(CSV)
    with pytest.raises(ConfigError, match=r"samples\.parquet cannot be read as Parquet"):
        load_dataset(tmp_path)


def test_infinity_in_a_parquet_is_named_with_its_row(tmp_path: Path) -> None:
    (tmp_path / "dataset.toml").write_text(TOML)
    frame = pd.DataFrame({"run": ["r01", "r02"], "time_s": [0.0, 0.0], "tip_x_mm": [1.0, np.inf]})
    frame.to_parquet(tmp_path / "samples.parquet")
    with pytest.raises(ConfigError, match=r"samples\.parquet, row 2, column 'tip_x_mm': 'inf'"):
        load_dataset(tmp_path)


@pytest.mark.parametrize("name", COLUMNS)
def test_every_column_has_limits_that_a_bench_respects(tmp_path: Path, name: str) -> None:
    limits = COLUMNS[name]
    noise = "" if name in COMMANDS else f"[noise]\n{name} = 1.0\n"
    toml = f'schema = 1\nignore = ["tip_angle_deg"]\n{noise}\n[[run]]\nid = "a"\n'
    for value in (1.01 * limits.low - 1.0, 1.01 * limits.high + 1.0):
        with pytest.raises(ConfigError, match=rf"row 2, column '{name}': .*out of any physical range") as caught:
            load_dataset(write(tmp_path, toml, f"run,time_s,{name}\na,0,{value}\n"))
        assert re.search(re.escape(limits.unit), str(caught.value))
