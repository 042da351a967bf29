"""The digitised data: the paper's own errors come out of them, and their conditions are what the paper states."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from evergym.errors import ConfigError
from evergym.experiments.experiment import ErrorMeasure, Experiment
from evergym.experiments.paper import EXPERIMENTS, READING_LENGTH, TABLE_EXPERIMENTS, load_experiment, read_table
from evergym.units import DEG, GRAM_FORCE, KPA, MM

# The errors of the paper's simulator as recomputed when the figures were digitised, to the digits given there.
RECOMPUTED = {
    "fig6_toward": (0.426, 5e-4),
    "fig6_opposite": (0.721, 5e-4),
    "fig6_90deg": (0.061, 5e-4),
    "fig7": (0.581, 5e-4),
    "fig8b": (11.85, 5e-3),
    "fig8c": (0.470, 5e-4),
    "fig9": (6.37, 5e-3),
    "fig10": (0.0654, 5e-5),
    "fig11a": (1.133, 5e-4),
    "fig11b": (0.456, 5e-4),
    "fig11c": (1.014, 5e-4),
    "fig11d": (0.950, 5e-4),
}
POINT_COUNTS = {
    "fig6_toward": 6,
    "fig6_opposite": 6,
    "fig6_90deg": 6,
    "fig7": 33,
    "fig8a": 76,
    "fig8b": 8,
    "fig8c": 8,
    "fig9": 5,
    "fig10": 5,
    "fig11a": 20,
    "fig11b": 20,
    "fig11c": 20,
    "fig11d": 20,
    "tip_position": 10,
}


@pytest.mark.parametrize("name", RECOMPUTED)
def test_the_papers_errors_come_out_of_the_data(name: str) -> None:
    value, rounding = RECOMPUTED[name]
    assert load_experiment(name).paper_recomputed == pytest.approx(value, abs=rounding)


@pytest.mark.parametrize("name", sorted(set(RECOMPUTED) - {"fig7", "fig11c"}))
def test_the_papers_errors_agree_with_its_table(name: str) -> None:
    # Two digits were printed, and the simulated points are read to about 1 % of the error; the two excepted are known.
    experiment = load_experiment(name)
    assert experiment.paper_printed is not None
    assert experiment.paper_recomputed == pytest.approx(experiment.paper_printed, rel=0.025)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_is_complete(name: str) -> None:
    experiment = load_experiment(name)
    assert experiment.name == name
    assert len(experiment.points) == POINT_COUNTS[name] == len(experiment.measured)
    assert not experiment.points.isna().any(axis=None)
    assert experiment.resolution > 0.0
    assert (experiment.paper_simulated is None) == (name == "fig8a")
    assert experiment.compute_error(experiment.measured) == 0.0
    with pytest.raises(ValueError, match="read-only"):
        experiment.measured[0] = 1.0


def test_the_table_has_a_row_for_every_printed_error() -> None:
    assert [load_experiment(name).paper_printed is not None for name in EXPERIMENTS] == [
        name in TABLE_EXPERIMENTS for name in EXPERIMENTS
    ]


@pytest.mark.parametrize("name", [name for name in TABLE_EXPERIMENTS if load_experiment(name).unit == "1/m"])
def test_curvatures_are_readings_of_whole_degrees(name: str) -> None:
    angle = load_experiment(name).measured * READING_LENGTH / DEG
    np.testing.assert_allclose(angle, np.round(angle), atol=1e-9)


@pytest.mark.parametrize(
    ("file", "curvature", "angle"),
    [
        ("fig6", "measured_curvature_1_per_mm", "measured_angle_deg"),
        ("fig7", "curvature_1_per_mm", "angle_deg"),
        ("fig10", "measured_curvature_1_per_mm", "measured_angle_deg"),
        ("fig11", "measured_curvature_1_per_mm", "measured_angle_deg"),
    ],
)
def test_plotted_curvatures_and_readings_are_the_same(file: str, curvature: str, angle: str) -> None:
    table = read_table(file)
    # The curvatures are stored to 1e-6 1/mm.
    np.testing.assert_allclose(table[curvature], table[angle] * DEG / (READING_LENGTH / MM), atol=6e-7)


def test_conditions_are_si_and_gauge() -> None:
    points = load_experiment("fig11d").points
    assert sorted(set(np.round(points.pressure / KPA, 6))) == [8.7, 18.7, 28.7, 38.7, 48.7]
    assert sorted(set(points.load)) == pytest.approx([grams * GRAM_FORCE for grams in (2, 3, 4, 5)])
    assert set(points.tendon_pull) == {4.9 * MM}
    assert set(load_experiment("fig11a").points.tendon_pull) == {0.0}
    assert load_experiment("fig7").points.tendon_pull.max() == pytest.approx(2.768 * MM)
    assert load_experiment("fig8a").points.feed_velocity.unique() == pytest.approx([2.9 * MM, 5.8 * MM])


def test_growth_ends_where_length_and_mean_speed_say() -> None:
    lengths, speeds = load_experiment("fig8b"), load_experiment("fig8c")
    np.testing.assert_allclose(lengths.measured / lengths.points.end_time, speeds.measured)
    assert list(lengths.points.curve[:2]) == ["v1_120", "v2_120"]
    assert set(lengths.points.curve) == set(load_experiment("fig8a").points.curve)


def test_tip_positions_are_those_of_arcs() -> None:
    experiment = load_experiment("tip_position")
    assert experiment.measure is ErrorMeasure.DISTANCE
    lateral, axial = experiment.measured[:2]
    radius = 95.0 / (61.0 * DEG)
    assert (radius - lateral) ** 2 + axial**2 == pytest.approx(radius**2)  # on the circle through the base
    assert np.arctan2(lateral, axial) == pytest.approx(0.5 * 61.0 * DEG)  # the chord makes half the tip's angle
    assert experiment.compute_error(experiment.measured + np.array([3.0, 4.0] * 5)) == pytest.approx(5.0)
    assert len(experiment.compute_deviations(experiment.measured)) == 5


def test_errors_are_means_of_absolute_values() -> None:
    measured = np.array([1.0, 2.0])
    experiment = Experiment("case", "a case", "mm", 0.5, pd.DataFrame({"load": [0.0, 1.0]}), measured, None, None)
    assert experiment.compute_error(np.array([0.0, 4.0])) == 1.5
    assert experiment.compute_deviations(np.array([0.0, 4.0])).tolist() == [-1.0, 2.0]
    assert experiment.paper_recomputed is None


def test_mistakes_are_named() -> None:
    with pytest.raises(ConfigError, match="Unknown experiment 'fig12'"):
        load_experiment("fig12")
    experiment = load_experiment("fig10")
    with pytest.raises(ConfigError, match=r"fig10 has 5 values.*\(4,\)"):
        experiment.compute_error(np.zeros(4))
    with pytest.raises(ConfigError, match="fig10, row 2: the value is nan"):
        experiment.compute_error(np.array([0.0, 0.0, np.nan, 0.0, 0.0]))
