"""A tendon drive that stops short is told from a notch that closes, and takes the name from it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from evergym.discrepancy.candidates import make_candidate
from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.drive_check import fit_short_drive, is_as_good, is_better, remark_drive
from evergym.discrepancy.fit import evaluate_fit
from evergym.discrepancy.noise import estimate_noise
from evergym.discrepancy.parameters import set_values
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.residual import Measurement
from evergym.discrepancy.screen import rank_candidates, screen_candidates
from evergym.discrepancy.select import Split, fit_candidates, score_fit
from evergym.discrepancy.setting import Setting
from evergym.discrepancy.simulate import simulate_run
from evergym.discrepancy.space import PULL_LIMIT, Space
from evergym.discrepancy.verdict import Thresholds
from evergym.model import Model, load_model

BASE = load_model("mammobot_2023")
CLOSING = "effects.notch_closure.curvature_1_per_m"
STIFFNESS = "effects.notch_closure.stiffness_n_m2"
MEASURED = [CHANNELS.index(name) for name in ("tip_x_mm", "tip_z_mm")]
NOISE = {"tip_x_mm": 0.1, "tip_z_mm": 0.1}


def make_run(number: int, most_mm: float) -> Run:
    time = 0.5 * np.arange(24)
    commands = np.zeros((24, 8))
    commands[:, 1] = np.nan
    commands[:, 3] = most_mm * np.sin(np.pi * time / time[-1])
    commands[:, 4] = 15.0 + 10.0 * number
    gravity = ((0.0, -9.81, 0.0), (-9.81, 0.0, 0.0), (9.81, 0.0, 0.0))[number]
    length = (40.0, 60.0, 80.0)[number]
    return Run(f"r{number}", "full", gravity, f"e{number}", "free", length, time, commands, np.full((24, 9), np.nan))


def measure(model: Model, pull_limit_mm: float) -> Dataset:
    """Three runs at different pressures and lengths, hung differently, with noise."""
    rng = np.random.default_rng(4)
    runs = []
    for number, most in enumerate((4.0, 3.5, 4.0)):
        run = make_run(number, most)
        commands = run.commands.copy()
        commands[:, 3] = np.minimum(commands[:, 3], pull_limit_mm)
        table = np.full((24, len(CHANNELS)), np.nan)
        table[:, MEASURED] = simulate_run(model, dataclasses.replace(run, commands=commands))[:, MEASURED]
        runs.append(dataclasses.replace(run, measured=table + 0.1 * rng.normal(size=table.shape)))
    return Dataset("test", "", NOISE, {}, (), tuple(runs), (), Path())


@pytest.mark.parametrize(("closing_1_per_m", "pull_limit_mm"), [(None, 3.2), (8.0, np.inf)])
def test_only_what_the_drive_does_is_put_down_to_the_drive(closing_1_per_m: float | None, pull_limit_mm: float) -> None:
    model = BASE if closing_1_per_m is None else set_values(BASE, {CLOSING: closing_1_per_m, STIFFNESS: 0.05})
    dataset = measure(model, pull_limit_mm)
    measurement = Measurement(dataset, estimate_noise(dataset))
    predictor = Predictor(dataset, measurement)
    use = np.ones(measurement.size, dtype=bool)
    split = Split(use, (0, 1, 2), ())
    reference = evaluate_fit(predictor, Space(Setting(BASE), ()), np.zeros(0))
    base = score_fit(predictor, reference, split)
    notch = make_candidate("notch_closure", BASE)
    signatures = rank_candidates(predictor, reference, screen_candidates(predictor, reference, [notch], use), use)
    (named,) = fit_candidates(predictor, base, signatures, split, 1)
    assert named.excess < 0.2 * base.excess  # either way the notch explains most
    short = fit_short_drive(predictor, base, reference, measurement, split)
    assert short is not None
    limits = Thresholds()
    if closing_1_per_m is None:
        assert is_better(short, named, limits)
        assert short.fit.space.values(short.fit.z)[PULL_LIMIT] == pytest.approx(pull_limit_mm, rel=0.03)
        (remark,) = remark_drive(short, named, limits)
        assert "stops at " in remark
        assert "better than notch_closure" in remark
    else:
        assert not is_better(short, named, limits)
        assert not is_as_good(short, named, limits)
        assert remark_drive(short, named, limits) == []


def test_runs_without_a_pull_say_nothing_of_the_drive() -> None:
    dataset = measure(BASE, 0.0)
    runs = tuple(dataclasses.replace(run, commands=run.commands * (np.arange(8) != 3)) for run in dataset.runs)
    dataset = dataclasses.replace(dataset, runs=runs)
    measurement = Measurement(dataset, estimate_noise(dataset))
    predictor = Predictor(dataset, measurement)
    reference = evaluate_fit(predictor, Space(Setting(BASE), ()), np.zeros(0))
    split = Split(np.ones(measurement.size, dtype=bool), (0, 1, 2), ())
    base = score_fit(predictor, reference, split)
    assert fit_short_drive(predictor, base, reference, measurement, split) is None
