"""Tuning proposes what the ranges allow, repeats itself from its seed, and refuses what it cannot do."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from evergym.agents.duty_cycle import DutyCycleSettings
from evergym.agents.tuning import RANGES, Trial, Tune, TuneTask, compute_score, propose
from evergym.config import load_toml
from evergym.errors import ConfigError


def search(seed: int, total: int = 20) -> list[DutyCycleSettings]:
    """Propose ``total`` candidates, the nearer the look-ahead to 7 mm the better."""
    generator = np.random.default_rng(seed)
    trials: list[Trial] = []
    for number in range(total):
        settings = propose(trials, number, total, generator)
        trials.append(Trial(f"{number}", settings, 1, 1, 0.0, 0.0, -abs(settings.look_ahead_mm - 7.0)))
    return [trial.settings for trial in trials]


def test_candidates_stay_in_their_ranges_and_begin_with_the_defaults() -> None:
    candidates = search(0)
    assert candidates[0] == DutyCycleSettings()
    assert len(set(candidates)) > 15
    for settings in candidates[1:]:
        for key, (low, high) in RANGES.items():
            assert low <= getattr(settings, key) <= high
        untouched = {field.name for field in dataclasses.fields(settings)} - RANGES.keys()
        assert all(getattr(settings, key) == getattr(candidates[0], key) for key in untouched)


def test_the_seed_decides() -> None:
    assert search(1) == search(1)
    assert search(1) != search(2)


def test_the_second_half_closes_in_on_the_best() -> None:
    for seed in range(5):
        misses = [abs(settings.look_ahead_mm - 7.0) for settings in search(seed)]
        assert np.mean(misses[15:]) < np.mean(misses[1:10])
        assert min(misses[10:]) <= min(misses[:10])


def test_success_outweighs_time_and_force() -> None:
    """One more success of 24 is worth more than all the time or force that an episode can take."""
    assert compute_score(1.0, 0.3, 0.1) > compute_score(1.0, 0.4, 0.1)
    assert compute_score(1.0, 0.3, 0.1) > compute_score(1.0, 0.3, 0.2)
    assert compute_score(24 / 24, 0.3, 0.2) > compute_score(23 / 24, 0.1, 0.0)
    assert compute_score(1.0, 0.0, 5.0) == compute_score(1.0, 0.0, 1.0)


@pytest.mark.parametrize("option", [{"candidates": 0}, {"episodes": 0}])
def test_nothing_to_do_is_refused(option: dict[str, int], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"at least 1; got (candidates|episodes) = 0"):
        Tune(file=tmp_path / "x.toml", **option).run()  # type: ignore[arg-type]  # a dict of one type


def test_a_missing_folder_is_refused_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"'.*nowhere' does not exist"):
        Tune(file=tmp_path / "nowhere" / "x.toml").run()


@pytest.mark.slow
def test_a_small_run_writes_what_the_controller_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "tuned.toml"
    command = Tune(task=TuneTask.DUCT, candidates=2, episodes=1, file=file)
    assert command.run() == 0
    first = file.read_text(encoding="utf-8")
    assert first.startswith("# Made by: evergym tune --task duct --candidates 2 --episodes 1 --seed 0 ")
    assert "defaults" in capsys.readouterr().out
    assert isinstance(load_toml(file, DutyCycleSettings), DutyCycleSettings)
    command.run()
    assert file.read_text(encoding="utf-8") == first
