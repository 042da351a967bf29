"""The tutorial in a small instance: measure, diagnose, plan with the corrected model, and arrive more often."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

from evergym.agents.rehearsal import compare_trials

pytestmark = pytest.mark.slow

CHECKOUT = Path(__file__).parents[2]


def test_planning_with_the_corrected_model_arrives_where_the_labs_misses(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("hidden_effect", CHECKOUT / "docs" / "examples" / "hidden_effect.py")
    assert spec is not None and spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    sys.modules["hidden_effect"] = example
    try:
        spec.loader.exec_module(example)
        findings = example.run_study(tmp_path, episodes=6, tasks=("MammobotPegs-v0",))
    finally:
        del sys.modules["hidden_effect"]
    diagnosis = findings.diagnosis
    assert [effect.name for effect in diagnosis.effects] == ["tendon_backlash"]
    intervals = {interval.path.rpartition(".")[2]: interval for interval in diagnosis.parameters["tendon_backlash"]}
    assert intervals["lost_motion_mm"].estimate == pytest.approx(2.1, abs=0.3)
    lab, corrected = findings.trials["MammobotPegs-v0"]
    paired = compare_trials(lab, corrected)
    # Six pairs of which all are gained are as many as a sign test needs for 5 %.
    assert paired.success.p_value < 0.05 and paired.success.difference.value > 0.0
    assert paired.tip_error_p_value < 0.05 and paired.tip_error_mm.high < 0.0
