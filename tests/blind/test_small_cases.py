"""A handful of small cases through the public interface only: the command, its exit code, and the files it writes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evergym.discrepancy.blind.alteration import Alteration
from evergym.discrepancy.blind.faults import FAULTS
from evergym.discrepancy.blind.instruments import Bench, format_dataset, measure_run, write_dataset
from evergym.discrepancy.blind.outside_forms import PortPlay
from evergym.discrepancy.blind.play import play_campaign
from evergym.discrepancy.blind.processes import Ended, Processes
from evergym.discrepancy.blind.protocols import PROTOCOLS, find_range
from evergym.discrepancy.blind.tendon_forms import SmoothPlay
from evergym.discrepancy.parameters import get_value, set_values
from evergym.model import Model, Numerics, load_model, save_model

BENCH = Bench({"tip_x_mm": 0.3, "tip_y_mm": 0.3, "tip_z_mm": 0.3, "tip_angle_deg": 0.7}, 0.6, 1, 0.0)
LAB = set_values(
    load_model("mammobot_2023"),
    {"effects.tendon_backlash.backlash_mm": 0.0, "effects.tendon_backlash.lost_motion_mm": 0.0},
)
STIFFNESS = "robot.catheter_bending_stiffness_n_m2"
REAL = set_values(LAB, {STIFFNESS: 1.05 * float(get_value(LAB, STIFFNESS))})  # within its tolerance
NAMES = ("tendon_staircase", "tendon_staircase", "tendon_staircase", "hold", "load_steps", "roll_sweep")
PLANS = [
    PROTOCOLS[name](np.random.default_rng(40 + i), find_range(LAB)).rename(f"r{i + 1:02d}", f"e{i + 1:02d}")
    for i, name in enumerate(NAMES)
]


def measure(*alterations: Alteration) -> dict[str, str]:
    generator = np.random.default_rng(8)
    signals = play_campaign(REAL, PLANS, Numerics(section_length_mm=2.3, step_s=0.0625), alterations)
    measured = [measure_run(generator, BENCH, plan, signal) for plan, signal in zip(PLANS, signals, strict=True)]
    return format_dataset("bench", PLANS, measured, BENCH, {})


def diagnose(folder: Path, files: Mapping[str, str], model: Model = LAB) -> tuple[Ended, dict[str, Any]]:
    write_dataset(folder / "dataset", files)
    save_model(model, folder / "model.toml")
    words = ["diagnose", "dataset", "--model", "model.toml", "--out", "out"]
    ended = Processes().run("evergym.agents.cli", words, folder)
    report = folder / "out" / "diagnosis.json"
    return ended, json.loads(report.read_text()) if report.is_file() else {}


def list_named(diagnosis: Mapping[str, Any]) -> Sequence[str]:
    if diagnosis["verdict"] not in ("effect", "effect_and_unknown_rest"):
        return []
    return [name for effect in diagnosis["effects"] for name in (effect["name"], *effect["equivalents"])]


@pytest.mark.slow
def test_a_soft_backlash_is_named(tmp_path: Path) -> None:
    files = measure(SmoothPlay({"backlash_mm": 0.5, "lost_motion_mm": 0.0, "edge_share": 0.1}))
    ended, diagnosis = diagnose(tmp_path, files)
    assert ended.code == 0, ended.message
    named = list_named(diagnosis)
    assert "tendon_backlash" in named
    assert len(named) <= 3
    assert diagnosis["gap"]["after"] < diagnosis["gap"]["before"]
    corrected = load_model(tmp_path / "out" / "model.toml")
    assert corrected != LAB


@pytest.mark.slow
def test_a_wrong_nominal_is_no_effect(tmp_path: Path) -> None:
    ended, diagnosis = diagnose(tmp_path, measure())
    assert ended.code == 0, ended.message
    assert list_named(diagnosis) == []


@pytest.mark.slow
def test_an_effect_outside_the_library_is_not_named_with_confidence(tmp_path: Path) -> None:
    ended, diagnosis = diagnose(tmp_path, measure(PortPlay({"angle_deg": 4.0, "gain": 0.6})))
    assert ended.code == 0, ended.message
    if list_named(diagnosis):
        assert all(effect["confidence"] < 0.8 for effect in diagnosis["effects"])


def test_bad_data_stop_before_anything_is_written(tmp_path: Path) -> None:
    spoiled = FAULTS["change_pressure_unit"](np.random.default_rng(2), measure())
    ended, _ = diagnose(tmp_path, spoiled.files)
    assert ended.code == 1
    assert "Traceback" not in ended.message
    for word in spoiled.words:
        assert word in ended.message
    assert not (tmp_path / "out").exists()
