"""Training: a killed run that is resumed ends with the same bits, and run folders are never damaged."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from stable_baselines3.common.save_util import load_from_zip_file

from evergym.agents.cli import main
from evergym.agents.learning_curve import read_curve
from evergym.agents.run_folder import RunFolder
from evergym.agents.settings import Algorithm, LearningRateSchedule, OffPolicySettings, PpoSettings, TrainSettings
from evergym.agents.training import derive_seed, train
from evergym.errors import ConfigError, RunError

SUPPORT = Path(__file__).parent / "support"
ENV = "point_task:PointTask-v0"

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::PendingDeprecationWarning")


@pytest.fixture(autouse=True)
def support(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(SUPPORT)


def make_settings(folder: Path, **changes: object) -> TrainSettings:
    small = TrainSettings(
        env=ENV,
        total_steps=640,
        env_count=1,
        hidden=(8,),
        checkpoint_interval=128,
        learning_rate_schedule=LearningRateSchedule.LINEAR,
        ppo=PpoSettings(rollout_steps=64, batch_size=32, epochs=2),
        off_policy=OffPolicySettings(
            buffer_size=1000, learning_starts=100, batch_size=16, train_interval=4, gradient_steps=2
        ),
        folder=folder,
    )
    return dataclasses.replace(small, **changes)  # type: ignore[arg-type]


def read_tensors(folder: Path) -> dict[str, torch.Tensor]:
    """Every number of the latest checkpoint that training continues from."""
    checkpoint = RunFolder.open(folder).latest()
    _, parameters, variables = load_from_zip_file(checkpoint.model, device="cpu")
    found: dict[str, torch.Tensor] = {}

    def visit(name: str, value: object) -> None:
        if isinstance(value, torch.Tensor):
            found[name] = value
        elif isinstance(value, dict):
            for key, item in value.items():
                visit(f"{name}.{key}", item)
        elif isinstance(value, list):
            for index, item in enumerate(value):
                visit(f"{name}.{index}", item)

    visit("parameters", parameters)
    visit("variables", variables or {})
    return found


def assert_same_run(first: Path, second: Path) -> None:
    a, b = read_tensors(first), read_tensors(second)
    assert a.keys() == b.keys()
    assert len(a) > 10
    for name in a:
        assert torch.equal(a[name], b[name]), name
    curves = [
        [dataclasses.replace(point, seconds=0.0) for point in read_curve(RunFolder.open(path).curve)]
        for path in (first, second)
    ]
    assert repr(curves[0]) == repr(curves[1])  # repr, since NaN is not equal to itself
    assert sum(point.episodes for point in curves[0]) > 3


@pytest.mark.parametrize("algorithm", list(Algorithm))
def test_stopped_and_resumed_run_has_the_same_bits(tmp_path: Path, algorithm: Algorithm) -> None:
    train(make_settings(tmp_path / "whole", algorithm=algorithm, total_steps=384))
    train(make_settings(tmp_path / "parts", algorithm=algorithm, total_steps=384, time_budget_min=1e-9))
    assert RunFolder.open(tmp_path / "parts").latest().progress.step == 128  # stopped at the first checkpoint
    train(TrainSettings(resume=tmp_path / "parts", time_budget_min=60.0))
    assert_same_run(tmp_path / "whole", tmp_path / "parts")


def test_another_seed_is_another_run(tmp_path: Path) -> None:
    for seed in (0, 1):
        train(make_settings(tmp_path / f"seed{seed}", seed=seed, total_steps=128))
    first, second = (read_tensors(tmp_path / f"seed{seed}") for seed in (0, 1))
    name = next(name for name in first if name.endswith("weight"))
    assert not torch.equal(first[name], second[name])


def test_resume_says_what_has_changed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run"
    train(make_settings(folder, total_steps=128))
    versions = folder / "versions.toml"
    versions.write_text(versions.read_text().replace(torch.__version__, "0.1"))
    train(TrainSettings(resume=folder, total_steps=256))
    assert f"as this changed: torch 0.1 -> {torch.__version__}." in capsys.readouterr().err


def test_killed_and_resumed_run_has_the_same_bits(tmp_path: Path) -> None:
    settings = make_settings(tmp_path / "whole", env_count=2, total_steps=2560, checkpoint_interval=512)
    train(settings)
    words = f"train --env {ENV} --total-steps 2560 --env-count 2 --hidden 8 --checkpoint-interval 512"
    words += " --learning-rate-schedule linear --ppo.rollout-steps 64 --ppo.batch-size 32 --ppo.epochs 2"
    command = [sys.executable, "-m", "evergym.agents.cli", *words.split(), "--folder", str(tmp_path / "killed")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(SUPPORT), *sys.path])}
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    checkpoints = tmp_path / "killed" / "checkpoints"
    deadline = time.monotonic() + 600.0
    while not (checkpoints / "000001024").exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    _, errors = process.communicate()
    assert process.returncode == -signal.SIGKILL, errors.decode()
    reached = RunFolder.open(tmp_path / "killed").latest().progress.step
    assert 1024 <= reached < 2560
    (checkpoints / ".partial-000009999").mkdir()  # what a kill in the middle of a checkpoint leaves behind
    assert main(["train", "--resume", str(tmp_path / "killed")]) == 0
    assert not (checkpoints / ".partial-000009999").exists()
    assert_same_run(tmp_path / "whole", tmp_path / "killed")


def test_existing_folder_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "precious.txt").write_text("keep")
    assert main(["train", "--env", ENV, "--folder", str(folder)]) == 1
    message = capsys.readouterr().err
    assert "exists already and is not overwritten" in message
    assert "Traceback" not in message
    assert [item.name for item in folder.iterdir()] == ["precious.txt"]


def test_failed_start_leaves_no_folder(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no argument 'horizont'.*'horizon'"):
        train(make_settings(tmp_path / "run", env_options=("horizont=3",)))
    with pytest.raises(ConfigError, match=r"Did you mean 'MammobotDuct-v0'"):
        train(make_settings(tmp_path / "run", env="MammobotDukt-v0"))
    assert not (tmp_path / "run").exists()


def test_resume_refuses_what_does_not_fit(tmp_path: Path) -> None:
    folder = tmp_path / "run-one"
    train(make_settings(folder, total_steps=128))
    with pytest.raises(RunError, match=r"Did you mean 'run-one'"):
        train(TrainSettings(resume=tmp_path / "run-onne"))
    with pytest.raises(RunError, match=r"finished: 128 of 128 steps"):
        train(TrainSettings(resume=folder))
    with pytest.raises(ConfigError, match=r"started with learning_rate = 0.0003, not 0.1"):
        train(TrainSettings(resume=folder, learning_rate=0.1, total_steps=256))
    settings = folder / "settings.toml"
    original = settings.read_text()
    settings.write_text(original.replace("PointTask-v0", "PointTaskWide-v0"))
    with pytest.raises(RunError, match=r"is of environment 'point_task:PointTask-v0'"):
        train(TrainSettings(resume=folder, total_steps=256))
    settings.write_text(original.replace("learning_rate =", "lerning_rate ="))
    with pytest.raises(ConfigError, match=r"unknown key 'lerning_rate'. Did you mean 'learning_rate'"):
        train(TrainSettings(resume=folder, total_steps=256))
    settings.write_text(original)
    (folder / "checkpoints" / "000000128" / "model.zip").write_bytes(b"PK")
    with pytest.raises(RunError, match=r"damaged"):
        train(TrainSettings(resume=folder, total_steps=256))


def test_dead_environment_process_is_reported(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"ended unexpectedly.*--resume"):
        train(make_settings(tmp_path / "run", env_count=2, env_options=("fail_at=10",)))


def test_training_improves_the_policy(tmp_path: Path) -> None:
    settings = make_settings(
        tmp_path / "run", total_steps=3584, checkpoint_interval=2048, learning_rate=2e-3, hidden=(32,)
    )
    points = read_curve(train(dataclasses.replace(settings, ppo=PpoSettings(512, 128, 10))).curve)
    early = np.nanmean([point.return_mean for point in points[:3]])
    late = np.nanmean([point.return_mean for point in points[-3:]])
    assert late > early + 0.3  # a success is worth 1


def test_segment_seeds_differ_and_fit() -> None:
    seeds = {derive_seed(run, segment) for run in range(20) for segment in range(50)}
    assert len(seeds) == 1000
    assert max(seeds) < 2**31
