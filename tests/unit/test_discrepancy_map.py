"""The map of disagreement: how far off each sample is from what recalibration can reach."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evergym.discrepancy.calibrate import approach_samples, calibrate, find_sensitivity
from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.data.rig import Fidelity
from evergym.discrepancy.gap import measure_gap
from evergym.discrepancy.noise import ChannelNoise, NoiseModel
from evergym.discrepancy.numerics_check import choose_fidelities
from evergym.discrepancy.parameters import set_values
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.remarks import remark_failures
from evergym.discrepancy.residual import Measurement
from evergym.discrepancy.setting import Setting
from evergym.discrepancy.simulate import simulate_run
from evergym.discrepancy.stages import map_disagreement
from evergym.discrepancy.verdict import worst_cell
from evergym.model import load_model

MODEL = load_model("mammobot_2023")
STRETCH = "effects.tendon_stretch.compliance_mm_per_n"
TIP_X = CHANNELS.index("tip_x_mm")


def test_the_map_shows_no_level_that_recalibration_can_mend() -> None:
    time = 0.5 * np.arange(40)
    commands = np.zeros((40, 8))
    commands[:, 1] = np.nan
    commands[:, 3] = 3.0 * np.minimum(time / 10.0, 1.0)
    commands[:, 4] = 20.0
    empty = np.full((40, len(CHANNELS)), np.nan)
    run = Run("r", "full", (0.0, -9.81, 0.0), "r", "free", 60.0, time, commands, empty)
    table = empty.copy()
    table[:, TIP_X] = simulate_run(set_values(MODEL, {STRETCH: 0.6}), run)[:, TIP_X]
    run = Run("r", "full", (0.0, -9.81, 0.0), "r", "free", 60.0, time, commands, table)
    dataset = Dataset("test", "", {"tip_x_mm": 0.3}, {}, (), (run,), (), Path())
    noise = NoiseModel({"tip_x_mm": ChannelNoise(0.1, 1.0, 20.0, 3.0, 0)}, ())
    measurement = Measurement(dataset, noise)
    predictor = Predictor(dataset, measurement)
    sensitivity = find_sensitivity(predictor, Setting(MODEL))
    fit = calibrate(predictor, sensitivity, np.ones(40, dtype=bool)).fit

    def distance(prediction: np.ndarray) -> float:
        return float(np.sum(((measurement.value - prediction) / measurement.sigma) ** 2))

    nearest = approach_samples(predictor, measurement, fit)
    assert distance(nearest) < 0.9 * distance(fit.prediction) < distance(sensitivity.nominal)
    assert predictor.measurement is measurement


def make_still_measurement() -> tuple[Dataset, Measurement]:
    table = np.full((40, len(CHANNELS)), np.nan)
    table[:, TIP_X] = 1.0
    run = Run("r", "full", (0.0, -9.81, 0.0), "r", "free", 60.0, 0.5 * np.arange(40), np.zeros((40, 8)), table)
    dataset = Dataset("test", "", {"tip_x_mm": 0.3}, {}, (), (run,), (), Path())
    return dataset, Measurement(dataset, NoiseModel({"tip_x_mm": ChannelNoise(0.3, 0.0, 1.0, 0.0, 0)}, ()))


def test_a_simulation_that_fails_is_no_agreement() -> None:
    dataset, measurement = make_still_measurement()
    right, broken = np.ones(40), np.where(np.arange(40) < 3, 1.0, np.nan)
    everything = np.ones(40, dtype=bool)
    gap = measure_gap(dataset, measurement, everything, right, right, broken)
    assert gap.before == 0.0
    assert gap.after > 100.0
    assert worst_cell(map_disagreement(dataset, measurement, right, 0, everything)) == 0.0
    assert worst_cell(map_disagreement(dataset, measurement, broken, 0, everything)) > 100.0
    (remark,) = remark_failures(dataset, measurement, broken, ["run 'r': old", "run 'r': it snapped"])
    assert remark.endswith("run 'r': it snapped")
    assert remark_failures(dataset, measurement, right, []) == []


def test_a_coarse_simulation_that_fails_is_not_fine_enough() -> None:
    dataset, measurement = make_still_measurement()

    class Failing(Predictor):
        def predict(self, setting: Setting, fidelity: Fidelity | None = None) -> np.ndarray:
            del setting
            return np.where((np.arange(40) < 3) | (fidelity is not Fidelity.FAST), 1.0, np.nan)

    checked = choose_fidelities(Failing(dataset, measurement), Setting(MODEL))
    assert checked.chosen["r"] is Fidelity.STANDARD
    assert np.isfinite(checked.spread).all()
