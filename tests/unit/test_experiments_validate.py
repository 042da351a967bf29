"""The comparison with the measured robot, with a stand-in for the protocols: the table, the columns and the report."""

from __future__ import annotations

import dataclasses
import html.parser
import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from evergym.errors import ConfigError, SimulationDiverged
from evergym.experiments.bars import BARS, find_bar
from evergym.experiments.commands import make_json
from evergym.experiments.comparison import Comparison, compare
from evergym.experiments.figures import FIGURES, draw_figure
from evergym.experiments.paper import EXPERIMENTS, READING_LENGTH, TABLE_EXPERIMENTS, load_experiment
from evergym.experiments.parameter_sets import PREDICTED_EXPERIMENTS, Column, ParameterSets, override
from evergym.experiments.provenance import describe_parameters, dump_model, read_model_text
from evergym.experiments.report import find_misses, make_table, write_report
from evergym.experiments.residuals import analyse_residual, split_by_load
from evergym.model import Model, load_model
from evergym.units import DEG, GRAM_FORCE


def make_model(offset: float) -> Model:
    """A model that carries an offset for `simulate` in a parameter that no experiment here reads."""
    model = load_model("mammobot_2023")
    return dataclasses.replace(model, robot=dataclasses.replace(model.robot, fluid_density_kg_m3=1000.0 + offset))


def simulate(model: Model, name: str) -> NDArray[np.float64]:
    """Stand-in for the protocols: the measured values and the model's offset."""
    return load_experiment(name).measured + (model.robot.fluid_density_kg_m3 - 1000.0)


def compare_names(names: tuple[str, ...], sets: ParameterSets, workers: int = 1) -> Comparison:
    return compare([load_experiment(name) for name in names], sets, simulate, workers=workers)


# -- columns


def test_each_column_has_the_errors_of_its_own_model() -> None:
    sets = ParameterSets(make_model(1.0), make_model(2.0), {"fig11": make_model(3.0)})
    (result,) = compare_names(("fig11a",), sets).results
    assert {column: result.compute_error(column) for column in Column} == pytest.approx(
        {Column.FITTED: 1.0, Column.PREDICTED: 2.0, Column.LEFT_OUT: 3.0}
    )


def test_only_system_experiments_are_predicted() -> None:
    sets = ParameterSets(make_model(1.0), make_model(2.0))
    comparison = compare_names(EXPERIMENTS, sets)
    predicted = {result.experiment.name for result in comparison.results if Column.PREDICTED in result.values}
    assert predicted == set(PREDICTED_EXPERIMENTS)


def test_growth_is_left_out_curve_by_curve() -> None:
    curves = list(dict.fromkeys(load_experiment("fig8a").points.curve))
    sets = ParameterSets(make_model(0.0), None, {f"fig8_{c}": make_model(1.0 + n) for n, c in enumerate(curves)})
    (result,) = compare_names(("fig8b",), sets).results
    wanted = [1.0 + curves.index(curve) for curve in result.experiment.points.curve]
    assert (result.values[Column.LEFT_OUT] - result.experiment.measured).tolist() == pytest.approx(wanted)


def test_a_column_that_lacks_a_point_stays_empty() -> None:
    sets = ParameterSets(make_model(0.0), None, {"fig8_v1_120": make_model(1.0)})
    (result,) = compare_names(("fig8b",), sets).results
    assert result.compute_error(Column.LEFT_OUT) is None
    assert result.compute_error(Column.FITTED) == 0.0


def test_a_panel_is_left_out_by_its_own_set_before_its_figures() -> None:
    sets = ParameterSets(make_model(0.0), None, {"fig11": make_model(1.0), "fig11b": make_model(2.0)})
    first, second = compare_names(("fig11a", "fig11b"), sets).results
    assert first.compute_error(Column.LEFT_OUT) == pytest.approx(1.0)
    assert second.compute_error(Column.LEFT_OUT) == pytest.approx(2.0)


def test_processes_change_nothing() -> None:
    sets = ParameterSets(make_model(0.25), make_model(0.5))
    names = ("fig7", "fig11d")
    one, two = compare_names(names, sets), compare_names(names, sets, workers=2)
    assert [result.make_row() for result in one.results] == [result.make_row() for result in two.results]


def test_values_override_a_model() -> None:
    model = override(load_model("mammobot_2023"), {"effects": {"root_kink": {"moment_n_m": 1.2e-4}}}, "fig9.toml")
    assert model.effects.root_kink.moment_n_m == 1.2e-4
    assert model.robot == load_model("mammobot_2023").robot
    with pytest.raises(ConfigError, match=r"fig9\.toml.*moment"):
        override(model, {"effects": {"root_kink": {"moment": 1.0}}}, "fig9.toml")
    with pytest.raises(ConfigError, match="'effects' is 3; it must be a table"):
        override(model, {"effects": 3}, "fig9.toml")


# -- failures


def test_a_protocol_that_diverges_is_named() -> None:
    def diverge(model: Model, name: str) -> NDArray[np.float64]:
        raise SimulationDiverged("no equilibrium at 1.0 s.")

    with pytest.raises(SimulationDiverged, match="Experiment fig9, parameter set 'fitted': no equilibrium"):
        compare([load_experiment("fig9")], ParameterSets(make_model(0.0)), diverge)


def test_a_protocol_with_the_wrong_number_of_values_is_named() -> None:
    with pytest.raises(ConfigError, match="fig9 has 5 values"):
        compare([load_experiment("fig9")], ParameterSets(make_model(0.0)), lambda model, name: np.zeros(3))


# -- the table


def test_json_has_the_keys_of_the_table() -> None:
    model = make_model(0.05)
    comparison = compare_names(TABLE_EXPERIMENTS, ParameterSets(model, make_model(0.1)))
    text = json.dumps(make_json(comparison, describe_parameters(model)))
    loaded = json.loads(text)
    assert sorted(loaded) == ["parameters", "rows", "seconds"]
    assert [row["experiment"] for row in loaded["rows"]] == [
        "fig6_toward",
        "fig6_opposite",
        "fig6_90deg",
        "fig7",
        "fig8b",
        "fig8c",
        "fig9",
        "fig10",
        "fig11a",
        "fig11b",
        "fig11c",
        "fig11d",
        "tip_position",
    ]
    keys = ["experiment", "unit", "paper_printed", "paper_recomputed", "fitted", "predicted", "left_out", "resolution"]
    assert all(list(row) == keys for row in loaded["rows"])
    first = loaded["rows"][0]
    assert first["paper_printed"] == 0.43
    assert first["fitted"] == pytest.approx(0.05)
    assert first["predicted"] is None
    assert loaded["parameters"]["robot.tendon_arm_mm"]["value"] == 0.75


def test_bars_are_looked_up_by_column() -> None:
    assert find_bar("fig11a", Column.FITTED) == 0.45
    assert find_bar("fig11a", Column.PREDICTED) == 1.1
    assert find_bar("fig11a", Column.LEFT_OUT) is None
    assert find_bar("fig8b", Column.LEFT_OUT) == 12.0
    assert find_bar("tip_position", Column.FITTED) is None
    assert set(BARS) <= set(TABLE_EXPERIMENTS)


def test_missed_bars_are_found() -> None:
    sets = ParameterSets(make_model(0.42), make_model(0.42))
    comparison = compare_names(("fig11a", "fig11b", "fig9"), sets)
    misses = find_misses(comparison)
    assert [(miss.experiment, miss.column) for miss in misses] == [("fig11b", Column.FITTED)]
    assert misses[0].error - misses[0].bar == pytest.approx(0.02)
    assert misses[0].structure.bias == pytest.approx(0.42)
    assert make_table(comparison).row_count == 3


# -- what remains


def test_a_residual_that_goes_with_the_load_is_found() -> None:
    experiment = load_experiment("fig11c")
    load = experiment.points.load.to_numpy() / GRAM_FORCE
    structure = analyse_residual(experiment, experiment.measured + 0.3 * (load - 2.0))
    assert structure.dependences[0].condition == "tip load"
    assert structure.dependences[0].share == pytest.approx(1.0)
    assert [label for label, _ in structure.dependences[0].means] == ["2 g", "3 g", "4 g", "5 g"]
    assert [mean for _, mean in structure.dependences[0].means] == pytest.approx([0.0, 0.3, 0.6, 0.9])
    assert structure.dependences[1].share == pytest.approx(0.0, abs=1e-12)  # pressures are crossed with loads
    assert structure.bias == pytest.approx(0.45)
    assert "Tip load holds 100 % of it" in structure.describe("1/m")


def test_a_step_with_the_pressure_is_found() -> None:
    experiment = load_experiment("fig11a")
    step = np.where(experiment.points.pressure > 15e3, 0.4, 0.0)
    structure = analyse_residual(experiment, experiment.measured + step)
    assert (structure.dependences[0].condition, structure.dependences[0].share) == (
        "gauge pressure",
        pytest.approx(1.0),
    )


def test_nothing_is_found_in_noise() -> None:
    experiment = load_experiment("fig11c")
    noise = np.random.default_rng(3).normal(0.0, 0.3, len(experiment.measured))
    text = analyse_residual(experiment, experiment.measured + noise).describe("1/m")
    assert text.endswith("The scatter goes with none of the conditions that were varied.")


def test_nothing_is_claimed_below_the_reading() -> None:
    experiment = load_experiment("fig10")
    trend = np.linspace(-0.02, 0.02, 5)
    text = analyse_residual(experiment, experiment.measured + trend).describe("1/m")
    assert "nothing is left that the readings resolve" in text


def test_a_trend_needs_no_repeats() -> None:
    experiment = load_experiment("fig9")
    pressure = experiment.points.pressure.to_numpy() / 1e3
    trending = analyse_residual(experiment, experiment.measured + 0.1 * pressure)
    assert trending.dependences[0].share == pytest.approx(1.0)
    alternating = analyse_residual(experiment, experiment.measured + np.array([1.0, -1.0, 1.0, -1.0, 1.0]))
    assert alternating.dependences[0].share < 0.1


def test_many_values_of_a_condition_are_grouped() -> None:
    experiment = load_experiment("fig7")
    structure = analyse_residual(experiment, experiment.measured + experiment.points.tendon_pull.to_numpy() * 100.0)
    (pull,) = [item for item in structure.dependences if item.condition == "tendon pull"]
    assert len(pull.means) <= 8
    assert pull.share > 0.9


def test_the_bias_of_the_straight_robot_steps_with_the_pressure() -> None:
    opposite, toward = load_experiment("fig11a"), load_experiment("fig11b")
    parts = split_by_load(opposite.measured, toward.measured, toward.points.pressure.to_numpy())
    degrees = READING_LENGTH / DEG
    # Read off the data when they were digitised: 25.3, 23.3, 24.3, 23.8, 24.6 and 0, then -2.4 to -3.3 degrees.
    assert parts.odd * degrees == pytest.approx([25.25, 23.25, 24.25, 23.75, 24.625], abs=0.2)
    assert parts.even[0] * degrees == pytest.approx(0.0, abs=0.2)
    assert all(-3.4 < even < -2.3 for even in parts.even[1:] * degrees)


# -- provenance


def test_comments_of_a_model_file_are_its_provenance() -> None:
    text = (
        'schema = 1\nname = "x"  # not a parameter\n[robot]\n'
        "tendon_arm_mm = 0.9  # fitted to Figs. 7 and 11: 0.9 +- 0.05\n"
        "[effects.eversion_yield]\nstatic_kpa = 14.0\n"
    )
    model = override(load_model("mammobot_2023"), {"robot": {"tendon_arm_mm": 0.9}}, "test")
    model = override(model, {"effects": {"eversion_yield": {"static_kpa": 14.0}}}, "test")
    records = {record.name: record for record in describe_parameters(model, text)}
    arm = records["robot.tendon_arm_mm"]
    assert (arm.value, arm.uncertainty, arm.unit, arm.is_default) == (0.9, 0.05, "mm", False)
    assert arm.provenance.startswith("fitted to Figs. 7 and 11")
    assert records["effects.eversion_yield.static_kpa"].provenance == "set in the model file, without a source"
    assert records["robot.catheter_length_mm"].provenance == "paper, Table I"
    assert records["robot.catheter_damping_time_ms"].provenance.startswith("prior")
    assert "name" not in records


def test_provenance_is_written_and_read_back(tmp_path: Path) -> None:
    model = override(load_model("mammobot_2023"), {"robot": {"tendon_arm_mm": 0.9}}, "test")
    words = {"robot.tendon_arm_mm": "Figs. 7, 11 +- 0.05", "effects.wall_wrinkling.enabled": "Comer and Levy 1963"}
    path = tmp_path / "model.toml"
    path.write_text(dump_model(model, words))
    assert load_model(path) == model
    records = {record.name: record for record in describe_parameters(load_model(path), read_model_text(str(path)))}
    assert {name: records[name].provenance for name in words} == words
    assert records["robot.tendon_arm_mm"].uncertainty == 0.05
    with pytest.raises(ConfigError, match=r"no parameter 'robot\.arm'"):
        dump_model(model, {"robot.arm": "x"})
    with pytest.raises(ConfigError, match="several lines"):
        dump_model(model, {"robot.tendon_arm_mm": "x\ny"})


def test_shipped_comments_are_found() -> None:
    text = read_model_text("mammobot_2021")
    records = {record.name: record for record in describe_parameters(load_model("mammobot_2021"), text)}
    assert records["robot.catheter_inner_diameter_mm"].provenance == "2021 paper"


# -- the report


class _Reader(html.parser.HTMLParser):
    """Collects image addresses and text; an HTML file that refers to anything outside itself fails."""

    def __init__(self) -> None:
        super().__init__()
        self.images: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        values = dict(attributes)
        assert "href" not in values
        if "src" in values:
            self.images.append(str(values["src"]))

    def handle_data(self, data: str) -> None:
        self.text += data


def test_the_report_holds_everything(tmp_path: Path) -> None:
    model = make_model(0.42)
    sets = ParameterSets(model, make_model(0.1), {"fig9": make_model(5.0)})
    comparison = compare_names(EXPERIMENTS, sets)
    path = write_report(
        tmp_path / "new",
        comparison,
        describe_parameters(model),
        model_name="some_model",
        assumptions=("Loads are dead weights.",),
    )
    assert [file.name for file in path.parent.iterdir()] == ["report.html"]
    reader = _Reader()
    reader.feed(path.read_text(encoding="utf-8"))
    assert len(reader.images) == len(FIGURES) + 1  # and Fig. 11 taken apart
    assert all(image.startswith("data:image/svg+xml;base64,") for image in reader.images)
    for name in TABLE_EXPERIMENTS:
        assert name in reader.text
    assert "Loads are dead weights." in reader.text
    assert "fig11b, fitted: 0.420 1/m, 0.020 1/m above the bar of 0.4" in reader.text
    assert "fig9, left out: 5.00 deg, 1.00 deg above the bar of 4.0" in reader.text
    assert "robot.tendon_arm_mm" in reader.text
    assert "10.1109/LRA.2023.3234823" in reader.text


def test_figures_of_experiments_that_were_not_run_are_left_out() -> None:
    comparison = compare_names(("fig6_toward", "fig9"), ParameterSets(make_model(0.1)))
    drawn = [name for name in FIGURES if draw_figure(name, comparison)]
    assert drawn == ["fig6", "fig9"]
