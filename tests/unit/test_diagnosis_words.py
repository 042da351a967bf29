"""What a diagnosis tells a reader: never more than it knows."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from evergym.agents.cli import main
from evergym.discrepancy.calibrate import ParameterEstimate
from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.data.rig import Fidelity
from evergym.discrepancy.diagnosis import Diagnosis
from evergym.discrepancy.figures import draw_map, encode
from evergym.discrepancy.hook import PassiveHook, UserEffect
from evergym.discrepancy.locate import Cell
from evergym.discrepancy.noise import estimate_noise
from evergym.discrepancy.remarks import remark_limits, remark_own_effects, remark_scatter
from evergym.discrepancy.residual import Measurement
from evergym.discrepancy.setting import Setting
from evergym.discrepancy.verdict import Verdict
from evergym.discrepancy.words import describe_confidence, describe_effect, describe_where
from evergym.discrepancy.workers import simulate_setting
from evergym.effects.catalogue import EFFECTS
from evergym.errors import ConfigError
from evergym.model import Model, load_model, save_model


def make_dataset(measured: np.ndarray, noise: float = 0.3) -> Dataset:
    time = 0.25 * np.arange(len(measured))
    commands = np.zeros((len(time), 8))
    commands[:, 1] = np.nan
    table = np.full((len(time), len(CHANNELS)), np.nan)
    table[:, 0] = measured
    run = Run("r", "full", (0.0, -9.81, 0.0), "r", "free", 60.0, time, commands, table)
    return Dataset("test", "", {"tip_x_mm": noise}, {}, (), (run,), (), Path())


def make_diagnosis(*cells: Cell) -> Diagnosis:
    return Diagnosis(
        Verdict.INSUFFICIENT_DATA, (), {}, cells, cells, None, (), (), 0.0, (), None, (), 1, 0.0, Model(), experiments=1
    )


def test_no_samples_are_no_agreement() -> None:
    assert "too few samples" in describe_where(make_diagnosis())
    quiet = Cell("tip_x_mm", "holding", (), 9, 1.0, 0.0, 1.0)
    assert describe_where(make_diagnosis(quiet)) == "Nowhere is the disagreement beyond the noise."
    assert encode(draw_map([])) is None
    assert encode(draw_map([quiet])) is not None


def test_no_name_is_a_certainty() -> None:
    assert describe_confidence(1.0) == "more than 99 %"
    assert describe_confidence(0.62) == "62 %"


def test_every_effect_is_told_in_a_sentence() -> None:
    for name in EFFECTS:
        meaning = describe_effect(name)
        assert len(meaning) > 20 and meaning.endswith(".")
    assert describe_effect("of_my_own") == ""


@pytest.mark.parametrize(("factor", "told"), [(1.0, False), (3.0, True)])
def test_noise_stated_too_small_is_told_from_a_wrong_model(factor: float, told: bool) -> None:
    rng = np.random.default_rng(4)
    course = 4.0 * np.sin(0.1 * np.arange(120))  # what a model may be off by: far more than the noise, and slow
    dataset = make_dataset(course + factor * 0.3 * rng.normal(size=120))
    noise = estimate_noise(dataset)
    remarks = remark_scatter(dataset, Measurement(dataset, noise), noise, np.zeros(120))
    assert bool(remarks) is told
    if told:
        assert "tip_x_mm" in remarks[0] and "[noise]" in remarks[0]


def test_limits_and_own_effects_are_remarked() -> None:
    free = ParameterEstimate("robot.tendon_arm_mm", 1.0, 1.1, 0.1, 0.05, identifiable=True, at_limit=False)
    bent = dataclasses.replace(free, path="robot.sheath_modulus_mpa", at_limit=True)
    assert remark_limits([free]) == []
    assert "robot.sheath_modulus_mpa" in remark_limits([free, bent])[0]
    assert remark_own_effects(["tendon_stretch"], {"mine"}) == []
    assert "model.toml" in remark_own_effects(["mine", "tendon_stretch"], {"mine"})[0]


class Broken(PassiveHook):
    """An effect with a misspelt name in it."""

    def __init__(self, angle: float) -> None:
        self.angle = angle

    def transform_channels(self, time: float, channels: np.ndarray) -> np.ndarray:
        raise KeyError("chanels")


def test_an_effect_of_ones_own_that_fails_is_named_with_file_and_line() -> None:
    effect = UserEffect("broken", Broken, {}, {}, {})
    run = make_dataset(np.zeros(8)).runs[0]
    setting = Setting(load_model("mammobot_2023"), (("broken", (("angle", 1.0),)),))
    with pytest.raises(ConfigError, match=r"test_diagnosis_words\.py, line \d+: your own effect broken .*chanels"):
        simulate_setting(setting, run, Fidelity.FAST, {"broken": effect})


def test_results_that_could_not_be_written_are_refused_before_anything_is_computed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    assert main(["diagnose", str(tmp_path / "none"), "--out", str(tmp_path / "file" / "deep")]) == 1
    assert "is a file; the results need a folder" in capsys.readouterr().err
    assert main(["blind", "--cases", "1", "--out", str(tmp_path / "file")]) == 1
    assert "file" in capsys.readouterr().err
    assert main(["diagnose", str(tmp_path / "file")]) == 1
    assert "Give the folder that holds dataset.toml" in capsys.readouterr().err


def test_results_overwrite_neither_the_data_nor_the_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "dataset.toml").write_text("schema = 1", encoding="utf-8")
    model = tmp_path / "lab" / "model.toml"
    model.parent.mkdir()
    save_model(load_model("mammobot_2023"), model)
    assert main(["diagnose", str(tmp_path), "--out", str(tmp_path)]) == 1
    assert "holds measured data" in capsys.readouterr().err
    assert main(["diagnose", str(tmp_path), "--model", str(model), "--out", str(model.parent)]) == 1
    assert "would overwrite the model" in capsys.readouterr().err
    assert main(["diagnose", str(tmp_path), "--jobs", "-1"]) == 1
    assert "--jobs is -1" in capsys.readouterr().err
    assert main(["blind", "--workers", "-1", "--out", str(tmp_path / "campaign")]) == 1
    assert not (tmp_path / "campaign").exists()
