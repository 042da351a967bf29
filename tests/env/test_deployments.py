"""The deployments of the paper's Fig. 12, at a brisk pace: they arrive, change branch by retraction, and are timed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from evergym.agents.cli import main
from evergym.agents.deployments import DUCT, PEGS, Deployment, deploy
from evergym.agents.scenarios import describe, make_json
from evergym.errors import ConfigError


@pytest.fixture(scope="module")
def pegs() -> Deployment:
    return deploy(replace(PEGS, pace_mm_s=2.0, step_mm=5.0))


@pytest.fixture(scope="module")
def duct() -> Deployment:
    return deploy(replace(DUCT, pace_mm_s=2.0))


def test_the_robot_passes_the_pegs(pegs: Deployment) -> None:
    assert pegs.reached
    assert [event.what for event in pegs.events] == ["target reached"]
    assert pegs.duty_cycles > 3
    assert pegs.trace[-1]["distance_to_go_mm"] <= 5.0


def test_the_robot_changes_branch_by_retraction(duct: Deployment) -> None:
    assert duct.reached
    assert [event.what for event in duct.events] == [
        "past the bifurcation into the wrong branch",
        "seen to be the wrong branch: sent to the other target",
        "pressure down, retraction begins",
        "back before the bifurcation",
        "retraction ends, steering",
        "past the bifurcation into the target's branch",
        "target reached",
    ]
    times = [event.time_s for event in duct.events]
    assert times == sorted(times)
    trace = pd.DataFrame(duct.trace)
    retraction = trace[trace.time_s.between(times[2], times[4])]
    # The tail turns wall back into tail: the sheath gets shorter by what lies behind the bifurcation, and stays soft.
    assert retraction.everted_length_mm.iloc[0] - retraction.everted_length_mm.iloc[-1] > DUCT.wrong_depth_mm
    assert retraction.pressure_kpa.iloc[5:].max() < 10.0
    assert trace.cost_buckling.max() == 0.0


def test_without_a_wrong_target_the_way_is_direct() -> None:
    deployment = deploy(replace(DUCT, pace_mm_s=2.0, wrong_target=None))
    assert deployment.reached
    assert [event.what for event in deployment.events] == ["target reached"]


@pytest.mark.parametrize("name", ["pegs", "duct"])
def test_it_is_faster_than_the_papers_simulator(name: str, pegs: Deployment, duct: Deployment) -> None:
    deployment = {"pegs": pegs, "duct": duct}[name]
    assert deployment.plan.paper_factor == pytest.approx({"pegs": 0.13, "duct": 0.15}[name], abs=0.005)
    # Some 200 times real time were measured; this only says that the clock covers the run.
    assert deployment.plan.paper_factor < deployment.factor < 1e5
    assert deployment.factor == pytest.approx(deployment.robot_s / deployment.wall_s)
    assert deployment.cpu_s > 0.0


def test_deployments_repeat_themselves(pegs: Deployment) -> None:
    again = deploy(pegs.plan)
    assert again.trace == pegs.trace


def test_json_and_words_say_the_same(duct: Deployment) -> None:
    values = json.loads(json.dumps(make_json(duct, model="mammobot_2023")))
    assert values["reached"] is True
    assert values["robot_seconds"] == duct.robot_s
    assert values["paper"]["robot_seconds"] == 177.0
    assert len(values["events"]) == len(duct.events)
    text = "\n".join(describe(duct))
    assert "held_out-0001: target reached" in text
    assert "177.0 s of robot time in 20 min 00 s: 0.147 times real time" in text


def test_the_command_writes_pictures_and_trace(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "duct"
    assert main(["scenario", "duct", "--pace-mm-s", "3", "--json", "--out", str(out)]) == 0
    values = json.loads(capsys.readouterr().out)
    assert json.loads((out / "scenario.json").read_text()) == values
    trace = pd.read_csv(out / "trace.csv")
    assert trace.time_s.iloc[-1] == values["robot_seconds"]
    assert sorted(path.name for path in out.iterdir()) == ["pictures.png", "scenario.json", "trace.csv", "trace.png"]
    for name in ("pictures.png", "trace.png"):
        assert np.asarray(Image.open(out / name).convert("L")).std() > 5.0  # not blank


def test_mistakes_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenario", "pegs", "--pace-mm-s", "0.01"]) == 1
    assert "insertion_mm_s is 0.01 mm/s" in capsys.readouterr().err
    with pytest.raises(ConfigError, match="both number 1"):
        deploy(replace(DUCT, wrong_target=1))
    with pytest.raises(ConfigError, match=r"target'\] is 9"):
        deploy(replace(DUCT, target=9))
