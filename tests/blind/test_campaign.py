"""The campaign: what the diagnosing process is given, stopping and going on, pooling, and a small one end to end."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from evergym.discrepancy.blind import campaign as module
from evergym.discrepancy.blind.campaign import load_scores, run_campaign
from evergym.discrepancy.blind.command import Blind
from evergym.discrepancy.blind.folders import CaseFolders, fill_folder, write_json
from evergym.discrepancy.blind.processes import Ended, Processes
from evergym.discrepancy.blind.truth import Kind, find_kind
from evergym.errors import ConfigError, RunError

SAID = {
    "verdict": "no_effect",
    "effects": [],
    "where": [],
    "gap": {"before": 2.0, "after": 2.0},
    "rows_set_aside": [],
}


def find_seed(*kinds: Kind) -> int:
    """A seed whose campaign begins with these kinds."""
    return next(seed for seed in range(100_000) if tuple(find_kind(seed, i)[0] for i in range(len(kinds))) == kinds)


def seal(folder: Path, index: int, kind: str = "none") -> CaseFolders:
    """A sealed case, as the sealing process leaves it, without its cost."""
    case = CaseFolders(folder, index)
    truth = {"kind": kind, "parts": [], "wrong": [], "fault": "", "detections": [], "cells": []}
    with fill_folder(case.sealed) as draft:
        write_json(truth, draft / "truth.json")
    with fill_folder(case.public) as draft:
        (draft / "dataset").mkdir()
        (draft / "dataset" / "samples.csv").write_text("run,time_s\n")
        (draft / "model.toml").write_text("schema = 1\n")
    return case


class Engine:
    """Stands in for the diagnosing process and remembers what it was given."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, tuple[str, ...], Path]] = []
        self.seen: list[set[str]] = []

    def run(self, name: str, words: Sequence[str], place: Path, *_: object) -> Ended:
        self.calls.append((name, tuple(words), place))
        self.seen.append({str(path.relative_to(place)) for path in place.rglob("*")})
        (place / "out").mkdir()
        (place / "out" / "diagnosis.json").write_text(json.dumps(SAID))
        return Ended(0, "", "")

    def stop(self) -> None:
        """Nothing runs."""


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> Engine:
    engine = Engine()
    monkeypatch.setattr(module, "Processes", lambda: engine)
    return engine


def test_the_diagnosis_is_given_the_dataset_and_the_model_and_nothing_else(tmp_path: Path, engine: Engine) -> None:
    folder = tmp_path / "campaign"
    folder.mkdir()
    run_nothing(folder, 11)
    seal(folder, 0)
    run_campaign(folder, 1, 11, workers=1, baselines=False)
    ((name, words, place),) = engine.calls
    assert name == "evergym.agents.cli"
    assert words == ("diagnose", "dataset", "--model", "model.toml", "--out", "out", "--jobs", str(os.cpu_count()))
    assert engine.seen == [{"dataset", "dataset/samples.csv", "model.toml"}]
    assert folder not in place.parents  # nothing leads from here to what is sealed
    assert not place.exists()


def run_nothing(folder: Path, seed: int) -> None:
    """Open a campaign's folder as its first start does."""
    module._open_folder(folder, seed)


def test_a_campaign_goes_on_where_it_was_stopped(tmp_path: Path, engine: Engine) -> None:
    run_nothing(tmp_path, 11)
    for index in range(3):
        seal(tmp_path, index)
    run_campaign(tmp_path, 2, 11, workers=1, baselines=False)
    scores = run_campaign(tmp_path, 3, 11, workers=1, baselines=False)
    assert len(engine.calls) == 3
    assert [score.case for score in scores] == [0, 1, 2]
    assert [score.false_alarm for score in scores] == [False] * 3


def test_another_engine_diagnoses_again(tmp_path: Path, engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    run_nothing(tmp_path, 11)
    seal(tmp_path, 0)
    run_campaign(tmp_path, 1, 11, workers=1, baselines=False)
    digest = module._find_digest
    monkeypatch.setattr(module, "_find_digest", lambda name: "new" if name == module.ENGINE else digest(name))
    run_campaign(tmp_path, 1, 11, workers=1, baselines=False)
    assert len(engine.calls) == 2


def test_another_seed_or_generator_needs_another_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run_nothing(tmp_path / "one", 11)
    with pytest.raises(RunError, match="its seed is 11"):
        run_nothing(tmp_path / "one", 12)
    monkeypatch.setattr(module, "_find_digest", lambda name: "changed")
    with pytest.raises(RunError, match="code that draws the truths has changed"):
        run_nothing(tmp_path / "one", 11)
    (tmp_path / "mine.txt").touch()
    with pytest.raises(RunError, match="not empty"):
        run_nothing(tmp_path, 11)


def test_campaigns_are_pooled(tmp_path: Path, engine: Engine, capsys: pytest.CaptureFixture[str]) -> None:
    for name, cases in (("a", 2), ("b", 3)):
        run_nothing(tmp_path / name, 11)
        for index in range(cases):
            seal(tmp_path / name, index)
        run_campaign(tmp_path / name, cases, 11, workers=1, baselines=False)
    assert Blind(pool=(tmp_path / "a", tmp_path / "b"), json=True).run() == 0
    content: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert content["cases"] == 5
    assert content["false_alarm"]["of"] == 5
    assert Blind(pool=(tmp_path / "a",)).run() == 0
    assert "false_alarm" in capsys.readouterr().out


def test_nothing_to_score_and_nothing_to_run_are_errors(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="holds no diagnosed case"):
        load_scores(tmp_path)
    with pytest.raises(ConfigError, match="at least 1 case"):
        run_campaign(tmp_path, 0, 1)


def test_a_stopped_campaign_leaves_nothing_running(tmp_path: Path) -> None:
    processes = Processes()
    timer = threading.Timer(1.0, processes.stop)
    timer.start()
    begin = time.monotonic()
    # A process with a process of its own.
    script = tmp_path / "slow.py"
    script.write_text("import subprocess, sys\nsubprocess.run([sys.executable, '-c', 'import time; time.sleep(60)'])\n")
    with pytest.raises(RunError, match="was stopped"):
        processes.run("slow", [], tmp_path)
    assert time.monotonic() - begin < 30.0
    with pytest.raises(RunError, match="was stopped"):
        processes.run("slow", [], tmp_path)


def test_a_process_that_takes_too_long_is_stopped(tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text("import time\ntime.sleep(60)\n")
    ended = Processes().run("slow", [], tmp_path, time_limit=1.0)
    assert ended.code != 0
    assert "Stopped after 1 s" in ended.message


def test_a_small_campaign_end_to_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two cases of bad data through the command line; `test_small_cases` diagnoses good ones."""
    seed = find_seed(Kind.FAULT, Kind.FAULT)
    assert Blind(cases=2, seed=seed, out=tmp_path / "blind", json=True, baselines=False).run() == 0
    content: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert [case["refused"] for case in content["list"]] == [True, True]
    assert content["failed"]["count"] == 0
    before = (tmp_path / "blind" / "results" / "case-0001" / "outcome.json").stat().st_mtime_ns
    assert Blind(cases=2, seed=seed, out=tmp_path / "blind", baselines=False).run() == 0
    assert (tmp_path / "blind" / "results" / "case-0001" / "outcome.json").stat().st_mtime_ns == before
