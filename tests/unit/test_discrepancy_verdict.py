"""What a diagnosis concludes from shares, rests and rivals."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from evergym.discrepancy.candidates import Candidate, make_candidate
from evergym.discrepancy.cross_validate import CrossValidation
from evergym.discrepancy.fit import Fit
from evergym.discrepancy.locate import Cell
from evergym.discrepancy.select import Score
from evergym.discrepancy.setting import Setting
from evergym.discrepancy.space import Space
from evergym.discrepancy.verdict import Thresholds, Verdict, decide, estimate_confidence, find_equivalents
from evergym.model import Model


def make_cell(excess: float, p_value: float = 1e-9) -> Cell:
    return Cell("tip_x_mm", "long", (), 10, excess, excess, p_value)


def make_score(excess: float, total: float, effects: tuple[Candidate, ...] = ()) -> Score:
    validation = CrossValidation(np.zeros(0), np.array([0.5 * total, 0.5 * total]), np.zeros((2, 0)))
    fit = Fit(Space(Setting(Model()), ()), np.zeros(0), np.zeros(1), np.zeros(1), np.zeros((1, 0)), 0.0)
    return Score(effects, fit, validation, excess)


@pytest.mark.parametrize(
    ("before", "after", "rest", "expected"),
    [
        (0.5, 0.0, 0.5, Verdict.NO_EFFECT),  # nothing is off by an amount that matters
        (20.0, 0.1, 0.4, Verdict.EFFECT),
        (20.0, 0.5, 2.0, Verdict.EFFECT_AND_UNKNOWN_REST),
        (20.0, 18.0, 10.0, Verdict.UNKNOWN_EFFECT),  # it resembles what is missing, and leaves half of it somewhere
        (20.0, 5.0, 10.0, Verdict.EFFECT_AND_UNKNOWN_REST),  # or it explains so much that its law has another form
        (20.0, 26.0, 4.0, Verdict.UNKNOWN_EFFECT),  # less than 0.75 explained
    ],
)
def test_verdict_follows_from_what_is_explained_and_what_remains(
    before: float, after: float, rest: float, expected: Verdict
) -> None:
    base, best = make_score(100.0, 1e5), make_score(after, 1e3, (make_candidate("pressure_leak"),))
    verdict = decide(base, best, [make_cell(before)], [make_cell(rest)], ["pressure_leak"], Thresholds())
    assert verdict is expected


def test_what_a_pair_leaves_over_does_not_make_it_a_resemblance() -> None:
    leak, kink = make_candidate("pressure_leak"), make_candidate("root_kink")
    cells = [make_cell(20.0)], [make_cell(10.0)]
    base, names = make_score(100.0, 1e5), ["pressure_leak"]
    assert decide(base, make_score(18.0, 1e3, (leak,)), *cells, names, Thresholds()) is Verdict.UNKNOWN_EFFECT
    pair = make_score(18.0, 1e3, (leak, kink))
    assert decide(base, pair, *cells, names, Thresholds()) is Verdict.EFFECT_AND_UNKNOWN_REST


def test_what_explains_as_much_in_the_same_place_is_a_tie() -> None:
    leak, droop, creep, lag = map(make_candidate, ("pressure_leak", "pressure_droop", "wall_creep", "pressure_lag"))
    best = make_score(0.1, 1000.0, (leak, creep))
    contenders = [best, make_score(0.11, 1010.0, (droop, creep)), make_score(3.0, 3000.0, (lag, creep))]
    assert find_equivalents(best, 0, contenders, {}, Thresholds()) == ("pressure_droop",)
    assert find_equivalents(best, 1, contenders, {}, Thresholds()) == ()
    # A signature that points the same way is a tie unless a fit has told the two apart.
    classes = {"pressure_leak": ["pressure_bias", "pressure_lag"]}
    assert find_equivalents(best, 0, contenders, classes, Thresholds()) == ("pressure_droop", "pressure_bias")


def test_confidence_grows_with_the_share_and_the_lead() -> None:
    leak, droop = make_candidate("pressure_leak"), make_candidate("pressure_droop")
    best = make_score(0.1, 1000.0, (leak,))
    rivals = [[best, make_score(excess, 2000.0, (droop,))] for excess in (0.1, 1.0, 10.0)]
    sure = [estimate_confidence(0.99, best, 0, contenders) for contenders in rivals]
    assert 0.0 < sure[0] < sure[1] < sure[2] < 1.0
    assert estimate_confidence(0.85, best, 0, rivals[2]) < sure[2]
    alone = dataclasses.replace(best, validation=CrossValidation(np.zeros(0), np.array([1000.0]), np.zeros((1, 0))))
    assert estimate_confidence(0.99, alone, 0, rivals[2]) <= 0.5  # nothing could be left out


def test_silent_runs_are_insufficient_and_not_a_clean_bill() -> None:
    base = make_score(0.0, 100.0)
    assert decide(base, base, [make_cell(0.2, 1.0)], [], [], Thresholds()) is Verdict.INSUFFICIENT_DATA
