"""Where fits begin when no gradient leads to the answer: frequencies of a ripple, steps of a rounded reading."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evergym.discrepancy.candidates import make_candidate, with_frequencies
from evergym.discrepancy.data.channels import CURVATURE, TIP_ANGLE, quantise_angles
from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.data.rig import soften_line
from evergym.discrepancy.fit import whitened_residual
from evergym.discrepancy.noise import estimate_noise
from evergym.discrepancy.parameters import set_values
from evergym.discrepancy.periodogram import find_frequencies
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.residual import Measurement
from evergym.discrepancy.setting import Setting, without_rounding
from evergym.discrepancy.simulate import simulate_run
from evergym.model import load_model

MODEL = load_model("mammobot_2023")
STEP = "effects.angle_quantisation.step_deg"


def make_run(name: str, time: np.ndarray, measured: np.ndarray) -> Run:
    commands = np.zeros((len(time), 8))
    commands[:, 1] = np.nan
    commands[:, 3] = np.linspace(0.0, 4.0, len(time))
    commands[:, 4] = 20.0
    return Run(name, "full", (0.0, -9.81, 0.0), name, "free", 60.0, time, commands, measured)


def make_dataset(runs: list[Run]) -> Dataset:
    noise = {"tip_x_mm": 0.3, "tip_angle_deg": 0.5, "curvature_1_per_m": 0.1}
    return Dataset("test", "", noise, {}, (), tuple(runs), (), Path())


@pytest.mark.parametrize("frequency", [0.13, 0.249, 1.07])
def test_swings_hidden_in_drift_and_noise_are_found_whatever_their_phase(frequency: float) -> None:
    rng = np.random.default_rng(3)
    runs = []
    for index, length in enumerate((60, 140, 220)):  # 12 s, 28 s, 44 s
        time = 0.2 * np.arange(length)
        table = np.full((length, len(CHANNELS)), np.nan)
        swing = 0.25 * np.sin(2.0 * np.pi * frequency * time + index)
        table[:, 0] = 0.05 * time + swing + 0.3 * rng.normal(size=length)
        runs.append(make_run(f"r{index}", time, table))
    dataset = make_dataset(runs)
    measurement = Measurement(dataset, estimate_noise(dataset))
    everything = np.ones(measurement.size, dtype=bool)
    found = find_frequencies(dataset, measurement, measurement.value / measurement.sigma, everything, 3)
    assert found[0] == pytest.approx(frequency, abs=0.25 / 44.0)


def test_runs_too_short_for_a_swing_show_none() -> None:
    time = 0.2 * np.arange(4)
    table = np.full((4, len(CHANNELS)), np.nan)
    table[:, 0] = 1.0
    dataset = make_dataset([make_run("r", time, table)])
    measurement = Measurement(dataset, estimate_noise(dataset))
    assert find_frequencies(dataset, measurement, measurement.value, np.ones(4, dtype=bool), 3) == []


def test_only_what_has_a_frequency_starts_at_one() -> None:
    ripple = with_frequencies(make_candidate("pressure_ripple"), [0.2, 0.7])
    place = next(i for i, axis in enumerate(ripple.axes) if axis.path.endswith("_hz"))
    starts = [ripple.axes[place].value(start[place]) for start in ripple.starts]
    assert starts[-2:] == pytest.approx([0.2, 0.7])
    lag = make_candidate("pressure_lag")
    assert with_frequencies(lag, [0.2]) is lag


def test_rounding_is_done_to_the_simulation_and_costs_none() -> None:
    time = 0.25 * np.arange(40)
    table = np.full((40, len(CHANNELS)), np.nan)
    table[:, [CURVATURE, TIP_ANGLE]] = 1.0
    run = make_run("r", time, table)
    dataset = make_dataset([run])
    predictor = Predictor(dataset, Measurement(dataset, estimate_noise(dataset)))
    exact = predictor.predict(Setting(MODEL))
    before = predictor.simulations
    for step in (1.0, 4.0, 7.5):
        setting = Setting(set_values(MODEL, {STEP: step}))
        rounded = predictor.predict(setting)
        angle = predictor.measurement.channel == TIP_ANGLE
        assert rounded[angle] == pytest.approx(np.round(exact[angle] / step) * step)
        curvature = predictor.measurement.channel == CURVATURE
        assert rounded[curvature] * exact[angle] == pytest.approx(exact[curvature] * rounded[angle])
        directly = simulate_run(setting.model, run)
        assert directly[:, TIP_ANGLE] == pytest.approx(rounded[angle])
    assert predictor.simulations == before
    assert without_rounding(Setting(MODEL)) == Setting(MODEL)


def test_readings_of_a_failed_simulation_are_not_rounded() -> None:
    model = set_values(MODEL, {STEP: 5.0})
    table = np.full((2, len(CHANNELS)), np.nan)
    table[0] = 0.0
    out = quantise_angles(table, model)
    assert np.all(out[0] == 0.0)
    assert np.isnan(out[1]).all()


def test_a_simulation_that_fails_is_worse_than_any_that_does_not() -> None:
    table = np.full((40, len(CHANNELS)), np.nan)
    table[:, TIP_ANGLE] = 0.0
    dataset = make_dataset([make_run("r", 0.25 * np.arange(40), table)])
    predictor = Predictor(dataset, Measurement(dataset, estimate_noise(dataset)))
    turned = np.full(40, 180.0)  # as far as an angle can be off
    failed = np.full(40, np.nan)
    off, lost = (float(np.sum(whitened_residual(predictor.measurement, one) ** 2)) for one in (turned, failed))
    assert lost > off > 0.0


def test_a_line_of_no_compliance_is_made_one_that_can_be_simulated() -> None:
    path = "effects.tendon_stretch.compliance_mm_per_n"
    softened, remarks = soften_line(set_values(MODEL, {path: 0.0}))
    assert softened.effects.tendon_stretch.compliance_mm_per_n == 0.02
    assert path in remarks[0]
    real = set_values(MODEL, {path: 0.3})
    assert soften_line(real) == (real, ())


@pytest.mark.parametrize("name", ["pre_curvature", "wall_pretension", "pressure_ripple", "pressure_bias"])
def test_what_has_a_sign_or_ripples_is_tried_at_its_typical_strength_only(name: str) -> None:
    """At four times that, robots snap over, and the signature is of nothing that is there."""
    candidate = make_candidate(name)
    places = [i for i, axis in enumerate(candidate.axes) if axis.path in candidate.amplitudes]
    strengths = {abs(start[place]) for start in candidate.starts for place in places}
    assert strengths <= {0.0, 1.0}


def test_spectra_in_blocks_are_those_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    time = 0.2 * np.arange(150)
    table = np.full((150, len(CHANNELS)), np.nan)
    table[:, 0] = np.sin(2.0 * np.pi * 0.31 * time) + 0.3 * np.random.default_rng(5).normal(size=150)
    dataset = make_dataset([make_run("r", time, table)])
    measurement = Measurement(dataset, estimate_noise(dataset))
    everything = np.ones(measurement.size, dtype=bool)
    whole = find_frequencies(dataset, measurement, measurement.value, everything, 4)
    monkeypatch.setattr("evergym.discrepancy.periodogram.BLOCK_MAX", 1000)
    assert find_frequencies(dataset, measurement, measurement.value, everything, 4) == whole
