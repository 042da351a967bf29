"""Plans made in a model and carried out without looking."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from evergym.agents.cli import main
from evergym.agents.episodes import EpisodeRecord
from evergym.agents.rehearsal import ReplayPolicy, Trial, compare_models, compare_trials, describe_trials
from evergym.discrepancy.parameters import set_values
from evergym.model import load_model, save_model

PLAY = {"effects.tendon_backlash.backlash_mm": 0.0, "effects.tendon_backlash.lost_motion_mm": 0.0}


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory) -> list[Trial]:
    lacking = tmp_path_factory.mktemp("models") / "lacking.toml"
    save_model(set_values(load_model("mammobot_2023"), PLAY), lacking)
    models = str(lacking), "mammobot_2023"
    return compare_models("MammobotPegs-v0", "mammobot_2023", models, episodes=2)


def test_a_plan_made_in_the_robots_own_model_repeats_itself_to_the_bit(trials: list[Trial]) -> None:
    own = trials[1]
    for rehearsal, episode in zip(own.rehearsals, own.episodes, strict=True):
        assert rehearsal.success
        assert dataclasses.replace(episode, arm=rehearsal.arm) == rehearsal


def test_a_plan_from_a_model_that_lacks_the_play_misses(trials: list[Trial]) -> None:
    lacking, own = trials
    assert all(record.success for record in lacking.rehearsals)
    assert not any(lacking.successes)
    assert np.all(lacking.tip_errors > own.tip_errors)
    assert [r.seed for r in lacking.episodes] == [r.seed for r in own.episodes]


def test_the_table_says_who_gained(trials: list[Trial]) -> None:
    text = describe_trials(trials, ("lab", "corrected"))
    assert "corrected against lab, 2 pairs" in text
    assert "2 gained, 0 lost" in text


def test_a_plan_that_is_over_holds_pull_and_pressure() -> None:
    policy = ReplayPolicy(np.array([[1.0, 0.5, 0.2, 0.4], [0.8, -0.5, 0.3, 0.6]], np.float32))
    state = None
    actions = []
    for _ in range(4):
        action, state = policy.predict(None, state)
        actions.append(action)
    assert actions[1] == pytest.approx([0.8, -0.5, 0.3, 0.6])
    for action in actions[2:]:
        assert action == pytest.approx([0.0, 0.0, 0.3, 0.6])


def make_trial(errors: list[float]) -> Trial:
    records = tuple(
        EpisodeRecord("a", "s", i, i, error <= 5.0, 1.0, error, 1.0, 0.0, 0.0, 0.0) for i, error in enumerate(errors)
    )
    return Trial("m", records, records)


def test_paired_results_against_numbers_worked_by_hand() -> None:
    paired = compare_trials(make_trial([6.0, 7.0, 8.0, 9.0, 4.0, 10.0]), make_trial([4.0, 4.5, 4.6, 4.2, 4.0, 4.8]))
    assert paired.success.first_only == 5 and paired.success.second_only == 0
    assert paired.success.p_value == pytest.approx(2.0 / 2**5)
    assert paired.tip_error_mm.value == pytest.approx(-(2.0 + 2.5 + 3.4 + 4.8 + 5.2) / 6.0)
    # Five differences of one sign and a zero, which is left out: two of the 2^5 ways are as extreme.
    assert paired.tip_error_p_value == pytest.approx(2.0 / 2**5)
    same = compare_trials(make_trial([4.0, 6.0]), make_trial([4.0, 6.0]))
    assert same.tip_error_p_value == 1.0 and same.success.p_value == 1.0


def test_the_command_refuses_what_it_cannot_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rehearse", "mammobot_2023", "--robot", "mammobot_2023", "--episodes", "0"]) == 1
    assert "at least 1 episode" in capsys.readouterr().err
    missing = str(tmp_path / "none.toml")
    assert main(["rehearse", missing, "--robot", "mammobot_2023", "--episodes", "1"]) == 1
    assert "none.toml" in capsys.readouterr().err
