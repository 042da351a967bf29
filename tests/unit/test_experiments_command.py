"""``evergym validate``: what it prints and writes, with a stand-in for the protocols."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray

from evergym.errors import ConfigError
from evergym.experiments.commands import Validate
from evergym.experiments.paper import TABLE_EXPERIMENTS, load_experiment
from evergym.model import Model


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Put a module in the place of the protocols; returns the experiments that were asked for."""
    asked: list[str] = []

    def simulate(model: Model, name: str) -> NDArray[np.float64]:
        asked.append(name)
        return load_experiment(name).measured + 0.3

    module = ModuleType("evergym.experiments.protocols")
    module.simulate = simulate  # type: ignore[attr-defined]
    module.ASSUMPTIONS = ("Loads are dead weights.",)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "evergym.experiments.protocols", module)
    return asked


def test_json_is_all_that_is_printed(stand_in: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert Validate(model="mammobot_2023", json=True, workers=1).run() == 0
    values = json.loads(capsys.readouterr().out)
    assert [row["experiment"] for row in values["rows"]] == list(TABLE_EXPERIMENTS) == stand_in
    assert values["rows"][0]["fitted"] == pytest.approx(0.3)
    assert values["rows"][0]["left_out"] is None
    assert values["seconds"] >= 0.0


def test_one_experiment_and_its_report(stand_in: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert Validate("fig11a", model="mammobot_2023", out=tmp_path, workers=1).run() == 0
    assert stand_in == ["fig11a"]
    printed = capsys.readouterr().out
    assert "fig11a" in printed
    assert "fig11b" not in printed
    assert "Loads are dead weights." in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_missed_bars_are_explained(stand_in: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Validate("fig7", model="mammobot_2023", out=tmp_path, workers=1).run()
    assert "fig7, fitted: 0.3 1/m, bar 0.15. The model is off by +0.3 1/m on average" in capsys.readouterr().out


def test_growth_curves_are_in_the_report_but_not_in_the_table(
    stand_in: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Validate(model="mammobot_2023", out=tmp_path, workers=1).run()
    assert "fig8a" in stand_in
    assert "fig8a" not in capsys.readouterr().out
    assert "Fig. 8a" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_unknown_names_are_refused_before_anything_runs(stand_in: list[str]) -> None:
    with pytest.raises(ConfigError, match="Unknown experiment 'fig12'"):
        Validate("fig12", json=True).run()
    with pytest.raises(ConfigError, match="Unknown model 'mammobot_2032'"):
        Validate(model="mammobot_2032", json=True).run()
    assert stand_in == []
