"""A diagnosis from end to end, on small datasets with a known answer: through the files, as a user runs it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from evergym.agents.cli import main
from evergym.discrepancy import diagnose, run_stages
from evergym.discrepancy.data.columns import CHANNELS, COMMANDS
from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.data.reading import load_dataset
from evergym.discrepancy.hook import load_user_effects
from evergym.discrepancy.parameters import set_values
from evergym.discrepancy.simulate import simulate_run
from evergym.discrepancy.verdict import Verdict
from evergym.model import Model, Numerics, load_model, save_model

pytestmark = pytest.mark.slow

NOISE = {"tip_x_mm": 0.2, "tip_z_mm": 0.2, "pressure_measured_kpa": 0.2, "everted_length_mm": 0.3}
STEP_S = 0.25
LAG = "effects.pressure_lag.time_s"

DELAYED_GAUGE = """
from evergym.config import ParameterInfo
from evergym.discrepancy.hook import PassiveHook, UserEffect


class DelayedGauge(PassiveHook):
    def __init__(self, delay_s):
        self.delay_s = delay_s

    def reset(self, run):
        self.past = []

    def transform_channels(self, time, channels):
        self.past.append((time, channels[8]))
        channels = channels.copy()
        channels[8] = [value for t, value in self.past if t <= time - self.delay_s or t == self.past[0][0]][-1]
        return channels


EFFECTS = [
    UserEffect(
        name="delayed_gauge",
        hook=DelayedGauge,
        parameters={"delay_s": ParameterInfo(unit="s", low=0.0, high=3.0)},
        off={"delay_s": 0.0},
        typical={"delay_s": 1.0},
    )
]
"""


def make_run(name: str, experiment: str, pressures: tuple[float, ...], pull: float, feed: float) -> Run:
    """Pressure steps of 1.5 s each, the tendon ramped up and down meanwhile."""
    count = round(1.5 / STEP_S) * len(pressures)
    commands = np.zeros((count, len(COMMANDS)))
    commands[:, 0] = feed
    commands[:, 1] = np.nan
    commands[:, 3] = pull * (1.0 - np.abs(np.linspace(-1.0, 1.0, count)))
    commands[:, 4] = np.repeat(pressures, count // len(pressures))
    time = STEP_S * np.arange(count)
    measured = np.full((count, len(CHANNELS)), np.nan)
    return Run(name, "full", (0.0, -9.81, 0.0), experiment, "free", 60.0, time, commands, measured)


RUNS = [
    make_run("a1", "a", (10.0, 40.0, 20.0, 30.0), 0.0, 0.0),
    make_run("a2", "a", (10.0, 40.0, 20.0, 30.0), 0.0, 0.0),
    make_run("b1", "b", (30.0, 12.0, 45.0), 4.0, 0.0),
    make_run("c1", "c", (20.0, 35.0, 25.0), 0.0, 2.0),
    make_run("d1", "d", (40.0, 15.0, 35.0), 3.0, 1.0),
]


def write_dataset(folder: Path, truth: Model, seed: int, hooks: tuple[object, ...] = ()) -> Path:
    """Write what the truth would have measured, with noise; simulated in other steps than a diagnosis uses."""
    rng = np.random.default_rng(seed)
    folder.mkdir()
    names = ["run", "time_s", *COMMANDS, *NOISE]
    lines = [",".join(names)]
    for run in RUNS:
        table = simulate_run(truth, run, Numerics(section_length_mm=2.5, step_s=0.03), hooks)  # type: ignore[arg-type]
        for i, time in enumerate(run.time_s):
            cells = [run.id, f"{time:.3f}"]
            cells += ["" if np.isnan(value) else f"{value:.6g}" for value in run.commands[i]]
            cells += [f"{table[i, CHANNELS.index(name)] + sigma * rng.normal():.5g}" for name, sigma in NOISE.items()]
            lines.append(",".join(cells))
    (folder / "samples.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    runs = [
        {
            "id": run.id,
            "setup": run.setup,
            "gravity_mps2": list(run.gravity),
            "experiment": run.experiment,
            "environment": run.environment,
            "initial_everted_length_mm": run.initial_everted_length_mm,
        }
        for run in RUNS
    ]
    content = {"schema": 1, "name": folder.name, "description": "", "ignore": [], "noise": NOISE, "run": runs}
    (folder / "dataset.toml").write_text(tomli_w.dumps(content), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def without_lag() -> Model:
    return set_values(load_model("mammobot_2023"), {LAG: 0.0})


def test_missing_lag_is_named_measured_and_mended(tmp_path: Path, without_lag: Model) -> None:
    truth = set_values(without_lag, {LAG: 0.6, "robot.catheter_bending_stiffness_n_m2": 4.5e-4})
    dataset = write_dataset(tmp_path / "data", truth, 1)
    save_model(without_lag, tmp_path / "model.toml")
    out = tmp_path / "out"
    assert main(["diagnose", str(dataset), "--model", str(tmp_path / "model.toml"), "--out", str(out)]) == 0
    result = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    assert result["verdict"] == "effect"
    (effect,) = result["effects"]
    assert effect["name"] == "pressure_lag"
    interval = effect["parameters"]["time_s"]
    assert interval["low_90"] <= 0.6 * 1.05 and interval["high_90"] >= 0.6 * 0.95
    assert interval["estimate"] == pytest.approx(0.6, rel=0.1)
    assert result["gap"]["before"] > 3.0 > 1.4 > result["gap"]["after"]
    assert set(result["gap"]["held_out_runs"]) < {run.id for run in RUNS}
    assert result["where"][0]["channel"] == "pressure_measured_kpa"
    corrected = load_model(out / "model.toml")
    assert corrected.effects.pressure_lag.time_s == pytest.approx(0.6, rel=0.1)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "The model lacks pressure_lag" in page
    assert "http" not in page.replace("http-equiv", "")  # self-contained


def test_wrong_nominal_parameters_are_no_effect(tmp_path: Path) -> None:
    model = load_model("mammobot_2023")
    truth = set_values(model, {"robot.catheter_bending_stiffness_n_m2": 4.7e-4, LAG: 0.18})
    diagnosis = diagnose(write_dataset(tmp_path / "data", truth, 2), "mammobot_2023")
    assert diagnosis.verdict is Verdict.NO_EFFECT
    assert diagnosis.effects == ()


def test_effect_of_the_users_own_joins_the_candidates(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(DELAYED_GAUGE, encoding="utf-8")
    (mine,) = load_user_effects(file)
    model = load_model("mammobot_2023")
    dataset = load_dataset(write_dataset(tmp_path / "data", model, 3, (mine.create_hook({"delay_s": 1.0}),)))
    evidence = run_stages(dataset, model, (mine,))
    assert [effect.name for effect in evidence.diagnosis.effects][:1] == ["delayed_gauge"]
    # Without it, nothing in the catalogue delays the gauge and nothing else.
    alone = run_stages(dataset, model).diagnosis
    assert alone.verdict is Verdict.UNKNOWN_EFFECT or alone.effects[0].confidence < 0.9


def test_processes_change_no_bit_of_the_result(tmp_path: Path, without_lag: Model) -> None:
    truth = set_values(without_lag, {LAG: 0.6})
    dataset = load_dataset(write_dataset(tmp_path / "data", truth, 4))
    results = [run_stages(dataset, without_lag, jobs=jobs).diagnosis for jobs in (1, 2)]
    first, second = (replace(result, seconds=0.0) for result in results)
    assert first.to_mapping() == second.to_mapping()
    assert first.model == second.model


def test_bad_data_write_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dataset = write_dataset(tmp_path / "data", load_model("mammobot_2023"), 5)
    samples = dataset / "samples.csv"
    samples.write_text(samples.read_text(encoding="utf-8").replace("tip_x_mm", "tip_xx_mm", 1), encoding="utf-8")
    out = tmp_path / "out"
    assert main(["diagnose", str(dataset), "--model", "mammobot_2023", "--out", str(out)]) == 1
    assert "tip_x_mm" in capsys.readouterr().err
    assert not out.exists()
