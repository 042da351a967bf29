"""Scoring: what a case counts for, on truths and diagnoses written by hand."""

from __future__ import annotations

from typing import Any

import pytest

from evergym.discrepancy.blind.rates import compute_rate
from evergym.discrepancy.blind.reliability import compute_reliability
from evergym.discrepancy.blind.score import CaseScore, compute_gap_ratio, score_case
from evergym.discrepancy.blind.summary import BARS, summarise_scores

OUTCOME = {"exit": 0, "seconds": 20.0, "message": "", "written": ["diagnosis.json"]}
CONTRACT_KEYS = {
    "cases",
    "top1",
    "in_set",
    "set_size_mean",
    "false_alarm",
    "outside_abstained",
    "outside_confident_wrong",
    "two_both",
    "two_extra",
    "gap_ratio_median",
    "coverage_90",
    "located_top2",
    "seconds_per_case",
}


def truth(kind: str, *names: str, form: str = "library", detectable: bool = True, **more: Any) -> dict[str, Any]:
    parts = [{"name": name, "form": form, "values": {"backlash_mm": 0.4, "lost_motion_mm": 0.0}} for name in names]
    return {
        "kind": kind,
        "parts": parts,
        "wrong": [],
        "fault": "",
        "detections": [{"name": name, "detectable": detectable} for name in names],
        "cells": [
            {"channel": "tip_x_mm", "regime": "tendon reversal", "sigmas": 8.0},
            {"channel": "tip_x_mm", "regime": "tendon releasing", "sigmas": 7.5},
            {"channel": "tip_x_mm", "regime": "holding", "sigmas": 3.0},
        ],
        **more,
    }


def effect(
    name: str, *equivalents: str, confidence: float = 0.9, low: float = 0.3, high: float = 0.5
) -> dict[str, Any]:
    interval = {"estimate": 0.4, "low_90": low, "high_90": high}
    return {
        "name": name,
        "confidence": confidence,
        "equivalents": list(equivalents),
        "parameters": {"backlash_mm": interval, "lost_motion_mm": interval},
    }


def diagnosis(verdict: str, *effects: dict[str, Any], regime: str = "tendon reversal", **more: Any) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "effects": list(effects),
        "where": [{"channel": "tip_x_mm", "regime": regime}],
        "gap": {"before": 5.0, "after": 1.1},
        "rows_set_aside": [],
        **more,
    }


def score(true: dict[str, Any], said: dict[str, Any] | None, **outcome: Any) -> CaseScore:
    return score_case(0, true, {**OUTCOME, **outcome}, said)


def test_the_hidden_effect_named_first() -> None:
    found = score(truth("single", "tendon_backlash"), diagnosis("effect", effect("tendon_backlash", "tendon_friction")))
    assert (found.top1, found.in_set, found.set_size, found.extra) == (True, True, 2, False)
    assert found.located
    assert found.covered == (True,)  # a strength that is zero is none


def test_the_hidden_effect_among_the_equivalents() -> None:
    said = diagnosis("effect_and_unknown_rest", effect("tendon_friction", "tendon_backlash"))
    found = score(truth("single", "tendon_backlash"), said)
    assert (found.top1, found.in_set, found.extra) == (False, True, False)


def test_a_set_of_more_than_three_names_does_not_count() -> None:
    said = diagnosis("effect", effect("a", "b", "c", "tendon_backlash"))
    found = score(truth("single", "tendon_backlash"), said)
    assert (found.in_set, found.set_size) == (False, 4)


@pytest.mark.parametrize("verdict", ["insufficient_data", "no_effect", "unknown_effect"])
def test_a_verdict_that_names_nothing_on_a_detectable_effect_is_a_miss(verdict: str) -> None:
    found = score(truth("single", "tendon_backlash"), diagnosis(verdict, effect("tendon_backlash")))
    assert (found.top1, found.in_set, found.named, found.set_size) == (False, False, (), None)


def test_what_is_not_detectable_counts_nowhere() -> None:
    found = score(truth("single", "tendon_backlash", detectable=False), diagnosis("no_effect"))
    assert (found.top1, found.in_set, found.located, found.gap_ratio) == (None, None, None, None)


def test_a_diagnosis_that_failed_is_a_miss_and_not_left_out() -> None:
    found = score(truth("single", "tendon_backlash"), None, exit=1, message="boom")
    assert (found.verdict, found.top1, found.located, found.gap_ratio) == ("failed", False, False, 1.0)


def test_coverage_counts_the_library_s_form_only() -> None:
    outside = diagnosis("effect", effect("tendon_backlash", low=0.41))
    assert score(truth("single", "tendon_backlash"), outside).covered == (False,)
    assert score(truth("single", "tendon_backlash", form="other"), outside).covered == ()


def test_false_alarms() -> None:
    assert score(truth("none"), diagnosis("effect", effect("tendon_backlash"))).false_alarm is True
    assert score(truth("none"), diagnosis("unknown_effect")).false_alarm is False
    assert score(truth("none"), diagnosis("no_effect")).top1 is None


def test_effects_outside_the_library() -> None:
    true = truth("outside", "port_play", form="outside")
    abstained = score(true, diagnosis("unknown_effect"))
    assert (abstained.abstained, abstained.confident_wrong) == (True, False)
    shy = score(true, diagnosis("effect", effect("tendon_backlash", confidence=0.5)))
    assert (shy.abstained, shy.confident_wrong) == (False, False)
    bold = score(true, diagnosis("effect_and_unknown_rest", effect("tendon_backlash", confidence=0.95)))
    assert (bold.abstained, bold.confident_wrong) == (False, True)


def test_two_effects() -> None:
    true = truth("two", "tendon_backlash", "pressure_lag")
    both = score(true, diagnosis("effect", effect("pressure_lag"), effect("tendon_backlash")))
    assert (both.both, both.extra) == (True, False)
    tied = score(true, diagnosis("effect", effect("pressure_lag"), effect("tendon_friction", "tendon_backlash")))
    assert (tied.both, tied.both_in_sets, tied.extra) == (False, True, False)
    spurious = score(true, diagnosis("effect", effect("pressure_lag"), effect("saline_weight")))
    assert (spurious.both, spurious.both_in_sets, spurious.extra) == (False, False, True)


def test_the_true_cell_and_its_ties() -> None:
    true = truth("single", "tendon_backlash")
    tied = score(true, diagnosis("no_effect", regime="tendon releasing"))
    assert (tied.located, tied.located_tied) == (False, True)
    wrong = score(true, diagnosis("no_effect", regime="holding"))
    assert (wrong.located, wrong.located_tied) == (False, False)


def test_the_gap_is_a_ratio_of_excesses_over_the_noise() -> None:
    assert compute_gap_ratio(diagnosis("effect")) == pytest.approx((1.1**2 - 1.0) ** 0.5 / (5.0**2 - 1.0) ** 0.5)
    assert compute_gap_ratio({"gap": {"before": 5.0, "after": 0.9}}) == 0.0
    assert compute_gap_ratio({"gap": {"before": 0.9, "after": 0.9}}) is None
    assert compute_gap_ratio({"gap": {"before": None, "after": None}}) is None


def test_bad_data_must_be_refused_where_they_are() -> None:
    true = truth("fault", fault="write_text", words=["samples.csv", "row 7", "tip_x_mm"])
    message = "evergym: samples.csv, row 7, column 'tip_x_mm': 'lost' is no number"
    good = score(true, None, exit=1, message=message, written=[])
    assert (good.refused, good.verdict) == (True, "refused")
    assert score(true, None, exit=1, message=message, written=["model.toml"]).refused is False
    assert score(true, None, exit=1, message="samples.csv: bad", written=[]).refused is False
    assert score(true, None, exit=1, message=f"Traceback ...\n{message}", written=[]).refused is False
    assert score(true, diagnosis("no_effect")).refused is False


def test_impossible_rows_must_be_set_aside() -> None:
    true = truth("fault", fault="add_impossible_rows", words=["7", "9"])
    rows = [{"row": 7, "why": ""}, {"row": 9, "why": ""}]
    assert score(true, diagnosis("no_effect", rows_set_aside=rows)).refused is True
    assert score(true, diagnosis("no_effect", rows_set_aside=rows[:1])).refused is False
    assert score(true, None, exit=1).refused is False


def test_wilson_intervals() -> None:
    # Wilson 1927 for 81 of 263, a textbook case: 0.2553 to 0.3662.
    rate = compute_rate([True] * 81 + [False] * 182 + [None] * 5)
    assert (rate.count, rate.of) == (81, 263)
    assert rate.low == pytest.approx(0.2553, abs=5e-5)
    assert rate.high == pytest.approx(0.3662, abs=5e-5)
    assert compute_rate([None]).rate is None


def test_the_summary_has_every_key_of_the_contract() -> None:
    scores = [
        score(truth("single", "tendon_backlash"), diagnosis("effect", effect("tendon_backlash"))),
        score(truth("single", "tendon_backlash"), diagnosis("unknown_effect")),
        score(truth("none"), diagnosis("no_effect")),
    ]
    summary = summarise_scores(scores)
    content = summary.to_json()
    assert set(content) >= CONTRACT_KEYS
    assert set(BARS) <= set(content)
    assert content["cases"] == len(content["list"]) == 3
    assert content["top1"]["rate"] == 0.5
    assert content["set_size_mean"] == 1.0
    assert content["two_both"]["rate"] is None
    assert content["kinds"]["single"] == {"cases": 2, "detectable": 2}


def test_confidence_is_compared_with_how_often_the_name_is_right() -> None:
    scores = [
        score(truth("single", "tendon_backlash"), diagnosis("effect", effect("tendon_backlash", confidence=0.99))),
        score(truth("two", "tendon_backlash", "feed_limit"), diagnosis("effect", effect("feed_limit", confidence=1.0))),
        score(truth("outside", "port_play"), diagnosis("effect", effect("root_kink", confidence=0.96))),
        score(truth("none"), diagnosis("effect", effect("root_kink", confidence=0.2))),
        score(truth("none"), diagnosis("no_effect")),
    ]
    doubtful, _, _, sure = compute_reliability(scores)
    assert (doubtful.right.count, doubtful.right.of, doubtful.mean) == (0, 1, 0.2)
    assert (sure.right.count, sure.right.of) == (2, 3)
    assert sure.mean == pytest.approx(0.983)
    assert summarise_scores(scores).to_json()["confidence"][1]["mean_confidence"] is None
