"""Evaluation, report, rollout, soak and demonstration on a small task with the environments' interface."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from evergym.agents import demo
from evergym.agents.arms import find_controller_arm
from evergym.agents.cli import main
from evergym.agents.demo import DemoPlan, run_plan
from evergym.agents.episodes import EpisodeRecord, read_records
from evergym.agents.evaluation import Evaluate, derive_episode_seed, evaluate
from evergym.agents.report import describe_result, write_report
from evergym.agents.settings import OffPolicySettings, PpoSettings, TrainSettings
from evergym.agents.soak import soak_part
from evergym.agents.summary import summarise
from evergym.agents.training import train
from evergym.errors import ConfigError, RunError

SUPPORT = Path(__file__).parent / "support"
ENV = "point_task:PointTask-v0"
ARMS = ("toward=point_task:TowardsTarget", "still=point_task:Still")

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::PendingDeprecationWarning")


@pytest.fixture(autouse=True)
def support(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(SUPPORT)


@pytest.fixture
def settings(tmp_path: Path) -> Evaluate:
    return Evaluate(
        arms=ARMS,
        reference="toward",
        env=ENV,
        splits=("held_out", "narrow"),
        episodes=6,
        workers=1,
        folder=tmp_path / "evaluation",
    )


def train_small(folder: Path, **changes: object) -> Path:
    small = TrainSettings(
        env=ENV, total_steps=128, env_count=1, hidden=(8,), ppo=PpoSettings(rollout_steps=64), folder=folder
    )
    return train(dataclasses.replace(small, **changes)).path  # type: ignore[arg-type]


def test_all_arms_meet_the_same_episodes(settings: Evaluate) -> None:
    folder = evaluate(settings)
    with (folder / "episodes.csv").open() as file:
        header = next(csv.reader(file))
    for column in (
        "arm",
        "split",
        "seed",
        "success",
        "time_s",
        "tip_error_mm",
        "path_ratio",
        "return",
        "end_reason",
        "cost",
    ):
        assert column in header
    assert {"wall_force_peak_n", "wall_force_p95_n"} <= set(header)
    records = read_records(folder / "episodes.csv")
    assert len(records) == 2 * 2 * 6
    by_key = {record.key: record for record in records}
    for (arm, split, index), record in by_key.items():
        assert record.seed == derive_episode_seed(settings.seed, split, index)
        assert record.success == (arm == "toward")
        assert record.wall_force_p95_n <= record.wall_force_peak_n
        assert record.protrusion_mm == pytest.approx(2.5)
        assert record.end_reason == ("reached" if record.success else "time")
        if arm == "still":
            assert record.step_count == 40
    # Same target: what the still arm ends with is about the length that the other arm had to go.
    for split in settings.splits:
        still = np.array([by_key["still", split, index].tip_error_mm for index in range(6)])
        times = np.array([by_key["toward", split, index].time_s for index in range(6)])
        assert np.corrcoef(still, times)[0, 1] > 0.7


def test_results_do_not_depend_on_the_processes(settings: Evaluate, tmp_path: Path) -> None:
    one = evaluate(settings)
    two = evaluate(dataclasses.replace(settings, workers=2, folder=tmp_path / "parallel"))
    assert sorted(map(repr, read_records(one / "episodes.csv"))) == sorted(
        map(repr, read_records(two / "episodes.csv"))
    )
    assert (one / "summary.json").read_text() == (two / "summary.json").read_text()


def test_cut_evaluation_is_completed(settings: Evaluate) -> None:
    folder = evaluate(settings)
    table = folder / "episodes.csv"
    whole = table.read_text()
    summary = (folder / "summary.json").read_text()
    lines = whole.splitlines(keepends=True)
    table.write_text("".join(lines[:9]) + lines[9][:7])  # a kill in the middle of a line
    evaluate(settings)
    assert sorted(repr(r) for r in read_records(table)) == sorted(repr(r) for r in _parse(whole, folder))
    assert (folder / "summary.json").read_text() == summary
    before = table.read_bytes()
    evaluate(settings)  # nothing left to do
    assert table.read_bytes() == before


def _parse(text: str, folder: Path) -> list[EpisodeRecord]:
    copy = folder / "copy.csv"
    copy.write_text(text)
    return read_records(copy)


def test_other_results_are_never_mixed(settings: Evaluate, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder = evaluate(dataclasses.replace(settings, episodes=1))
    before = (folder / "episodes.csv").read_bytes()
    with pytest.raises(RunError, match=r"seed was 1000000, now 5"):
        evaluate(dataclasses.replace(settings, seed=5))
    with pytest.raises(RunError, match=r"must not be mixed"):
        evaluate(dataclasses.replace(settings, env_options=("horizon=20",)))
    monkeypatch.setattr("evergym.agents.evaluation.fingerprint_code", lambda: "changed")
    with pytest.raises(RunError, match=r"the code of evergym has changed"):
        evaluate(settings)
    assert (folder / "episodes.csv").read_bytes() == before
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    with pytest.raises(RunError, match=r"is not an evaluation; it is not overwritten"):
        evaluate(dataclasses.replace(settings, folder=foreign))


def test_bad_requests_are_explained(settings: Evaluate, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ConfigError, match=r"no controller 'duty_cicle'. Did you mean 'duty_cycle'"):
        find_controller_arm("duty_cicle")
    with pytest.raises(ConfigError, match=r"cannot be loaded"):
        find_controller_arm("point_task:Nobody")
    with pytest.raises(ConfigError, match=r"same name"):
        evaluate(dataclasses.replace(settings, arms=(ARMS[0], ARMS[0])))
    with pytest.raises(ConfigError, match=r"reference 'stil' is not among the arms. Did you mean 'still'"):
        evaluate(dataclasses.replace(settings, reference="stil"))
    with pytest.raises(ConfigError, match=r"at least 1 episode"):
        evaluate(dataclasses.replace(settings, episodes=0))
    assert main(["evaluate", str(tmp_path / "nothing"), "--env", ENV]) == 1
    assert "does not exist" in capsys.readouterr().err


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_learned_policy_is_an_arm(settings: Evaluate, tmp_path: Path, algorithm: str) -> None:
    off_policy = OffPolicySettings(buffer_size=500, learning_starts=64, batch_size=8)
    kind = TrainSettings().algorithm.__class__(algorithm)
    run = train_small(tmp_path / "learned", algorithm=kind, off_policy=off_policy)
    chosen = dataclasses.replace(settings, runs=(run,), env=None, episodes=2, folder=None)
    folder = evaluate(chosen)
    assert folder == run / "evaluation"
    summary = json.loads((folder / "summary.json").read_text())
    assert [arm["arm"] for arm in summary["splits"][0]["arms"]] == ["learned", "toward", "still"]
    with pytest.raises(RunError, match=r"was trained on 'point_task:PointTask-v0' and cannot be evaluated"):
        evaluate(dataclasses.replace(chosen, env="point_task:PointTaskWide-v0"))
    wide = ("wide=true",)
    with pytest.raises(RunError, match=r"observations are Box\[6\]; here they are Box\[7\]"):
        evaluate(dataclasses.replace(chosen, env_options=wide, folder=tmp_path / "wide", workers=1))


def make_record(arm: str, index: int, success: bool, time: float) -> EpisodeRecord:
    return EpisodeRecord(
        arm, "held_out", index, 0, success, time, 3.0, 1.1, 0.2, 0.1, 1.0, "reached" if success else "time"
    )


def test_summary_pairs_by_anatomy() -> None:
    ours = [make_record("ours", i, i < 8, 10.0 + i) for i in range(10)]
    base = [make_record("base", i, i >= 4, 20.0 + i) for i in range(9, -1, -1)]
    split = summarise([*ours, *base], "base").splits[0]
    (pair,) = split.pairs
    assert (pair.arm, pair.reference, pair.episode_count) == ("ours", "base", 10)
    assert (pair.success.first_only, pair.success.second_only) == (4, 2)
    assert pair.success.difference.value == pytest.approx(0.2)
    # Both reached 4..7, ours always 10 s earlier: paired differences have no spread.
    assert pair.metrics["time_s"] == (-10.0, -10.0, -10.0)
    assert split.arms[0].metrics["time_s"].value == pytest.approx(13.5)  # 10..17, successes only
    assert split.arms[0].end_reasons == {"reached": 8, "time": 2}
    assert math.isnan(summarise([make_record("a", 0, False, 1.0)], "a").splits[0].arms[0].metrics["time_s"].value)


def test_training_seeds_are_summarised_together() -> None:
    records = [make_record(f"s{seed}", i, i < 4 + seed, 1.0) for seed in range(4) for i in range(10)]
    estimate = summarise(records, "s0", ["s0", "s1", "s2", "s3"]).training_seeds["held_out"]
    assert estimate.value == pytest.approx(0.55)
    assert 0.4 <= estimate.low < estimate.value < estimate.high <= 0.7


def test_report_holds_everything(settings: Evaluate, tmp_path: Path) -> None:
    run = train_small(tmp_path / "learned", total_steps=256)
    folder = evaluate(dataclasses.replace(settings, runs=(run,), episodes=3, env=None, folder=None))
    report = write_report(folder)
    text = report.read_text()
    assert text.count('<img src="data:image/') >= 4 + 5  # figures, and the pictures of at least one episode
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert "https://" not in text
    assert "learned reached" in text
    assert "total_steps = 256" in text
    assert "went differently" not in text
    assert "narrow" in text


def test_headline_says_who_is_better(settings: Evaluate) -> None:
    from evergym.agents.evaluation import open_evaluation

    plan, _ = open_evaluation(evaluate(dataclasses.replace(settings, episodes=1)))
    plan = dataclasses.replace(plan, reference="still")
    for wins, verdict in ((40, "better"), (0, "worse"), (20, "can well be chance")):
        records = [make_record("toward", i, i < wins, 1.0) for i in range(40)]
        records += [make_record("still", i, i < (1 if wins == 40 else 21), 1.0) for i in range(40)]
        headline = describe_result(plan, summarise(records, "still").splits[0])
        assert verdict in headline
        assert f"toward reached the target {wins} times" in headline


def test_rollout_prints_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [
        "rollout",
        "--arm",
        ARMS[0],
        "--env",
        ENV,
        "--png",
        str(tmp_path / "a.png"),
        "--gif",
        str(tmp_path / "a.gif"),
    ]
    assert main(words) == 0
    shown = capsys.readouterr().out
    assert "toward reached the target on held_out 0" in shown
    assert "wall force" in shown
    assert "[mm]" in shown  # rich takes what is in brackets for a style, unless it is told otherwise
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "a.gif").read_bytes().startswith(b"GIF8")
    assert main(words) == 1
    assert "is not overwritten" in capsys.readouterr().err
    assert main(["rollout", "--arm", str(tmp_path / "runs" / "x")]) == 1


def test_soak_passes_on_a_sound_task(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["soak", "--steps", "4000", "--envs", ENV, "--workers", "2"]) == 0
    counts = json.loads(capsys.readouterr().out)
    assert counts["ok"]
    assert counts["total"]["steps"] == 4000
    assert counts["total"]["handled_bad_actions"] > 0
    assert len(counts["total"]["scenario_steps"]) >= 6


@pytest.mark.parametrize(
    ("option", "message"), [("fail_at=7", "RuntimeError: solver fell over"), ("accept_nan=true", "was accepted")]
)
def test_soak_finds_what_is_wrong(capsys: pytest.CaptureFixture[str], option: str, message: str) -> None:
    assert main(["soak", "--steps", "2000", "--envs", ENV, "--env-options", option, "--workers", "1"]) == 1
    counts = json.loads(capsys.readouterr().out)
    assert not counts["ok"]
    assert message in counts["total"]["failures"][0]
    assert "reset seed" in counts["total"]["failures"][0]


def test_soak_part_repeats() -> None:
    first, second = (soak_part(ENV, (), [3, 0, 1], 500) for _ in range(2))
    assert first.end_reasons == second.end_reasons
    assert first.scenario_steps == second.scenario_steps
    assert first.steps == 500


def test_demo_runs_and_continues(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(demo, "ARMS", ("duty_cycle=point_task:TowardsTarget", "still=point_task:Still"))
    training = TrainSettings(
        env=ENV, total_steps=256, env_count=1, hidden=(8,), checkpoint_interval=128, ppo=PpoSettings(rollout_steps=64)
    )
    plan = DemoPlan(training, episodes=2, other_splits=("narrow",), other_episodes=1)
    train(dataclasses.replace(training, folder=tmp_path / "demo", time_budget_min=1e-9))  # as if it was interrupted
    (tmp_path / "demo" / "settings.toml").write_text(
        (tmp_path / "demo" / "settings.toml").read_text().replace("time_budget_min = 1e-09\n", "")
    )
    assert run_plan(plan, tmp_path, "demo", 1) == 0
    shown = capsys.readouterr()
    assert "continue in" in shown.err
    report = tmp_path / "demo" / "evaluation" / "report.html"
    assert f"Report: {report}" in shown.out
    assert report.is_file()
    assert run_plan(plan, tmp_path, "demo", 1) == 0
    assert (tmp_path / "demo-2" / "evaluation" / "report.html").is_file()
