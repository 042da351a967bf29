"""The parts of a diagnosis that need no simulator: noise, whitening, fits, folds, regimes."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.fit import solve_normal
from evergym.discrepancy.hold_out import choose_held_out
from evergym.discrepancy.locate import SIGNIFICANCE, locate
from evergym.discrepancy.noise import ChannelNoise, estimate_noise, find_repeats, whitening_matrix
from evergym.discrepancy.regimes import REGIMES, label_regimes
from evergym.discrepancy.residual import Measurement

TIME = 0.2 * np.arange(60)


def make_run(name: str, experiment: str, pull: np.ndarray, measured: np.ndarray | None = None) -> Run:
    commands = np.zeros((len(TIME), 8))
    commands[:, 1] = np.nan
    commands[:, 3] = pull
    commands[:, 4] = 20.0
    table = np.full((len(TIME), len(CHANNELS)), np.nan)
    if measured is not None:
        table[:, 0] = measured
    return Run(name, "full", (0.0, -9.81, 0.0), experiment, "free", 50.0, TIME, commands, table)


def make_dataset(runs: list[Run], noise: float = 0.3) -> Dataset:
    return Dataset("test", "", {"tip_x_mm": noise}, {}, (), tuple(runs), (), Path())


def draw_noise(rng: np.random.Generator, white: float, wander: float, time_s: float, offset: float) -> np.ndarray:
    share = np.exp(-0.2 / time_s)
    slow = np.empty(len(TIME))
    slow[0] = rng.normal()
    for i in range(1, len(TIME)):
        slow[i] = share * slow[i - 1] + np.sqrt(1.0 - share**2) * rng.normal()
    return white * rng.normal(size=len(TIME)) + wander * slow + offset * rng.normal()


def test_repeats_show_the_noise_whatever_they_have_in_common() -> None:
    rng = np.random.default_rng(0)
    runs = []
    for experiment in range(20):
        signal = 30.0 * rng.normal() * np.sin(TIME)
        pull = np.full(len(TIME), 0.1 * experiment)
        runs += [
            make_run(f"{experiment}-{k}", f"e{experiment}", pull, signal + draw_noise(rng, 0.3, 0.4, 2.0, 0.3))
            for k in range(2)
        ]
    noise = estimate_noise(make_dataset(runs, 0.1)).channels["tip_x_mm"]
    # 20 differences of 60 samples: the white part is known to 3 %, the slow parts to 20-30 %.
    assert noise.white == pytest.approx(0.3, rel=0.1)
    assert noise.total == pytest.approx(np.sqrt(0.3**2 + 0.4**2 + 0.3**2), rel=0.2)
    assert np.hypot(noise.wander, noise.offset) == pytest.approx(0.5, rel=0.3)
    assert noise.repeats == 20


def test_declared_noise_is_the_floor() -> None:
    rng = np.random.default_rng(1)
    runs = [make_run(str(k), "e", np.zeros(len(TIME)), 0.05 * rng.normal(size=len(TIME))) for k in range(3)]
    assert estimate_noise(make_dataset(runs, 0.3)).channels["tip_x_mm"].total == pytest.approx(0.3, rel=1e-6)


def test_runs_with_other_commands_are_no_repeats() -> None:
    runs = [make_run("a", "e", np.zeros(60)), make_run("b", "e", np.full(60, 0.1)), make_run("c", "e", np.zeros(60))]
    assert find_repeats(runs) == [[0, 2]]


def test_whitened_noise_is_independent_with_unit_variance() -> None:
    noise = ChannelNoise(white=0.3, wander=0.4, wander_time_s=2.0, offset=0.3, repeats=0)
    matrix = whitening_matrix(noise, TIME)
    np.testing.assert_allclose(matrix @ noise.covariance(TIME) @ matrix.T, np.eye(len(TIME)), atol=1e-4)


def test_scaling_undoes_whitening() -> None:
    rng = np.random.default_rng(2)
    runs = [make_run(str(k), "e", np.full(60, 0.1 * k), rng.normal(size=60)) for k in range(3)]
    dataset = make_dataset(runs)
    measurement = Measurement(dataset, estimate_noise(dataset))
    np.testing.assert_allclose(
        measurement.scale(measurement.whiten(measurement.value)), measurement.value / measurement.sigma, rtol=1e-9
    )


def test_what_is_doubted_counts_less_and_only_there() -> None:
    runs = [make_run(str(k), "e", np.full(60, 0.1 * k), np.zeros(60)) for k in range(2)]
    dataset = make_dataset(runs)
    plain = Measurement(dataset, estimate_noise(dataset))
    doubt = np.where(plain.run == 0, 5.0, 0.0)
    doubted = plain.add_doubt(doubt)
    off = np.random.default_rng(1).normal(size=plain.size)
    before, after = plain.whiten(off) ** 2, doubted.whiten(off) ** 2
    assert np.sum(after[plain.run == 0]) < 0.01 * np.sum(before[plain.run == 0])
    np.testing.assert_allclose(after[plain.run == 1], before[plain.run == 1])
    np.testing.assert_allclose(doubted.restore(doubted.whiten(off)), off)


def test_samples_taken_one_by_one_have_the_same_sigma() -> None:
    rng = np.random.default_rng(3)
    runs = [make_run(f"r{k}", "e", np.zeros(60), draw_noise(rng, 0.3, 0.6, 2.0, 0.5)) for k in range(6)]
    dataset = make_dataset(runs)
    numerics = np.full(360, 0.4)
    whole = Measurement(dataset, estimate_noise(dataset), numerics)
    apart = whole.as_independent()
    np.testing.assert_allclose(apart.sigma, whole.sigma)
    values = rng.normal(size=360)
    np.testing.assert_allclose(apart.whiten(values), values / whole.sigma, rtol=1e-5)
    assert np.abs(whole.whiten(values) - values / whole.sigma).max() > 0.1


def test_what_discretisation_does_is_no_disagreement() -> None:
    runs = [make_run(str(k), "e", np.full(60, 0.1 * k), np.zeros(60)) for k in range(2)]
    dataset = make_dataset(runs)
    noise = estimate_noise(dataset)
    known = Measurement(dataset, noise, np.full(120, 0.1))
    course = np.tile(3.0 * np.sin(np.arange(60) / 9.0), 2)
    wider = known.widen(np.where(known.run == 0, course, 0.0))
    # Along its course it is an error of about one sigma in all, however many samples show it; across it, it is not.
    first = wider.run == 0
    assert np.sum(known.whiten(course)[first] ** 2) > 500.0
    assert np.sum(wider.whiten(course)[first] ** 2) < 1.5
    across = np.where(np.arange(120) % 2 == 0, 1.0, -1.0)
    assert np.sum(wider.whiten(across)[first] ** 2) > 0.9 * np.sum(known.whiten(across)[first] ** 2)
    np.testing.assert_allclose(wider.whiten(course)[~first], known.whiten(course)[~first])  # never narrower


def test_step_within_limits_is_the_constrained_minimum() -> None:
    rng = np.random.default_rng(3)
    jacobian, residual = rng.normal(size=(40, 3)), 5.0 * rng.normal(size=40)
    precision, z = np.ones(3), np.zeros(3)
    limits = np.full(3, -0.05), np.full(3, 0.05)
    step = solve_normal(jacobian.T @ jacobian, jacobian.T @ residual, precision, z, limits)

    def cost(d: np.ndarray) -> float:
        rest = residual - jacobian @ d
        return float(rest @ rest + d @ d)

    assert np.all(np.abs(step) <= 0.05 + 1e-9)
    assert max(np.abs(step)) == pytest.approx(0.05)
    for _ in range(200):
        other = np.clip(step + 0.02 * rng.normal(size=3), *limits)
        assert cost(other) >= cost(step) - 1e-9


def test_held_out_experiments_leave_every_regime_to_learn_from() -> None:
    rng = np.random.default_rng(5)
    ramp = np.concatenate((np.linspace(0.0, 3.0, 30), np.linspace(3.0, 0.0, 30)))
    runs = [make_run(f"r{k}", f"e{k}", ramp if k in (1, 4) else np.zeros(60), rng.normal(size=60)) for k in range(8)]
    dataset = make_dataset(runs)
    measurement = Measurement(dataset, estimate_noise(dataset))
    held_out = choose_held_out(dataset, measurement, rng.normal(size=(measurement.size, 3)), np.zeros(8))
    assert len(held_out) == 2
    assert not {1, 4} <= set(held_out)


def test_disagreement_is_there_to_learn_from_and_to_test() -> None:
    rng = np.random.default_rng(6)
    runs = [make_run(f"r{k}", f"e{k}", np.zeros(60), rng.normal(size=60)) for k in range(8)]
    dataset = make_dataset(runs)
    measurement = Measurement(dataset, estimate_noise(dataset))
    jacobian = rng.normal(size=(measurement.size, 3))
    first = choose_held_out(dataset, measurement, jacobian, np.zeros(8))
    for others in ((), tuple(k for k in range(8) if k not in first)[:2]):
        off = np.zeros(8)
        off[[*first, *others]] = 10.0
        held_out = set(choose_held_out(dataset, measurement, jacobian, off))
        assert len(held_out & set(np.flatnonzero(off))) == 1


@pytest.mark.parametrize("only", range(8))
def test_what_a_single_experiment_measures_is_not_held_out(only: int) -> None:
    rng = np.random.default_rng(7)
    runs = [make_run(f"r{k}", f"e{k}", np.zeros(60), rng.normal(size=60)) for k in range(8)]
    measured = np.full((60, len(CHANNELS)), np.nan)
    measured[:, CHANNELS.index("bending_angle_deg")] = rng.normal(size=60)
    runs[only] = dataclasses.replace(runs[only], measured=measured)
    dataset = dataclasses.replace(make_dataset(runs), noise={"tip_x_mm": 0.3, "bending_angle_deg": 0.3})
    measurement = Measurement(dataset, estimate_noise(dataset))
    jacobian = np.random.default_rng(8).normal(size=(measurement.size, 3))
    assert only not in choose_held_out(dataset, measurement, jacobian, np.zeros(8))


def test_too_few_experiments_hold_none_out() -> None:
    runs = [make_run(f"r{k}", f"e{k}", np.zeros(60), np.zeros(60)) for k in range(2)]
    dataset = make_dataset(runs)
    measurement = Measurement(dataset, estimate_noise(dataset))
    assert choose_held_out(dataset, measurement, np.zeros((measurement.size, 0)), np.zeros(2)) == ()


def test_regimes_follow_the_commands() -> None:
    pull = np.concatenate((np.linspace(0.0, 4.0, 30), np.linspace(4.0, 0.0, 30)))
    (labels,) = label_regimes([make_run("a", "e", pull)])
    assert set(labels) <= set(REGIMES)
    reversal = np.flatnonzero(labels["tendon reversal"])
    assert reversal.min() >= 30 and reversal.max() <= 38  # a fifth of the way back, one sample late
    assert labels["tendon releasing"][45:].all()
    assert labels["tendon pulling"][5:30].all()
    assert not (labels["tendon pulling"] & labels["tendon releasing"]).any()


def test_map_finds_the_cell_that_is_off_and_no_other_by_chance() -> None:
    rng = np.random.default_rng(6)
    pull = np.concatenate((np.linspace(0.0, 4.0, 30), np.linspace(4.0, 0.0, 30)))
    runs = [make_run(f"r{k}", f"e{k}", pull, 0.3 * rng.normal(size=60)) for k in range(6)]
    dataset = make_dataset(runs)
    measurement = Measurement(dataset, estimate_noise(dataset))
    use = np.ones(measurement.size, dtype=bool)
    quiet = locate(dataset, measurement, np.zeros(measurement.size), measurement.whiten(measurement.value), 0.0, use)
    assert min(cell.p_value for cell in quiet) > SIGNIFICANCE
    wrong = np.where(np.isin(measurement.row, np.arange(31, 38)), 1.5, 0.0)
    residual = measurement.whiten(measurement.value - wrong)
    cells = locate(dataset, measurement, wrong, residual, 0.0, use)
    assert (cells[0].channel, cells[0].regime) == ("tip_x_mm", "tendon reversal")
    assert cells[0].excess == pytest.approx(1.5 / 0.3, rel=0.2)
    assert cells[0].p_value < 1e-6
