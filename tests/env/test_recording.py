"""Episodes recorded as datasets: written with their surroundings, and simulated alike."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import numpy as np
import pytest

from evergym.agents.recording import EpisodeRecording
from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.reading import load_dataset
from evergym.discrepancy.data.rig import apply_robot
from evergym.discrepancy.simulate import try_simulate_run
from evergym.errors import ConfigError, RunError
from evergym.model import load_model

NOISE = {"tip_x_mm": 0.3, "tip_z_mm": 0.3, "everted_length_mm": 0.5}


@pytest.fixture(scope="module")
def recording() -> EpisodeRecording:
    """Two episodes among pegs of 30 steps each, and a third that was only begun."""
    env = EpisodeRecording(gymnasium.make("MammobotPegs-v0"))
    for seed in (0, 1):
        env.reset(seed=seed)
        for step in range(30):
            env.step(np.array([0.6, 0.0, 0.5 * np.sin(0.3 * step) + seed - 0.5, 0.7], dtype=np.float32))
    env.reset(seed=2)
    return env


def test_a_recorded_episode_is_simulated_alike(recording: EpisodeRecording, tmp_path: Path) -> None:
    """Within a third of the bench's noise, rms: the environment's steps are longer."""
    recording.write(tmp_path, NOISE)
    dataset = load_dataset(tmp_path)
    assert [run.environment for run in dataset.runs] == ["pegs:pegs-01.csv", "pegs:pegs-02.csv"]
    assert dataset.channels == tuple(NOISE)
    model = apply_robot(load_model("mammobot_2023"), dataset)
    for run in dataset.runs:
        prediction = try_simulate_run(model, run)
        assert prediction.failure == ""
        error = (prediction.channels - run.measured)[:, [CHANNELS.index(name) for name in NOISE]]
        assert np.all(np.sqrt(np.mean(error**2, axis=0)) < 0.35 * np.array(list(NOISE.values())))
        assert np.ptp(run.measured[:, CHANNELS.index("everted_length_mm")]) > 5.0


def test_noise_is_drawn(recording: EpisodeRecording, tmp_path: Path) -> None:
    recording.write(tmp_path / "a", NOISE, np.random.default_rng(1))
    recording.write(tmp_path / "b", NOISE, np.random.default_rng(2))
    one, other = (load_dataset(tmp_path / name).runs[0].measured[:, 0] for name in ("a", "b"))
    assert np.std(one - other) == pytest.approx(0.3 * 2**0.5, rel=0.5)  # 32 rows: a standard error of 13 %


def test_the_environment_goes_on_after_its_record(recording: EpisodeRecording) -> None:
    count = len(recording.runs)
    recording.reset(seed=3)
    recording.step(np.zeros(4, dtype=np.float32))
    recording.reset(seed=3)
    assert len(recording.runs) == count + 1


def test_a_dataset_is_not_overwritten(recording: EpisodeRecording, tmp_path: Path) -> None:
    recording.write(tmp_path, NOISE)
    with pytest.raises(ConfigError, match="is there already"):
        recording.write(tmp_path, NOISE)


def test_nothing_recorded_is_nothing_written(tmp_path: Path) -> None:
    env = EpisodeRecording(gymnasium.make("MammobotPegs-v0"))
    with pytest.raises(ConfigError, match="No episode was recorded"):
        env.write(tmp_path / "d", NOISE)
    assert not (tmp_path / "d").exists()


def test_other_environments_are_refused() -> None:
    with pytest.raises(RunError, match="has no simulator of this package"):
        EpisodeRecording(gymnasium.make("CartPole-v1")).reset()
