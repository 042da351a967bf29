"""How effects are chosen: recalibration led elsewhere, agreement that strains, a second effect that needs no first."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from evergym.discrepancy import choose
from evergym.discrepancy.calibrate import ParameterEstimate
from evergym.discrepancy.candidates import Candidate, make_candidate
from evergym.discrepancy.cross_validate import CrossValidation
from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.fit import Fit, evaluate_fit
from evergym.discrepancy.locate import Cell
from evergym.discrepancy.noise import estimate_noise
from evergym.discrepancy.parameters import set_values
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.remarks import remark_strain
from evergym.discrepancy.residual import Measurement
from evergym.discrepancy.select import Score, Split, score_fit
from evergym.discrepancy.setting import Setting
from evergym.discrepancy.simulate import simulate_run
from evergym.discrepancy.space import Axis, Space
from evergym.discrepancy.verdict import Thresholds, Verdict, decide, relieved_share
from evergym.model import Model, load_model

YIELD = "effects.eversion_yield.kinetic_kpa"
SLIP = "effects.feed_limit.slip"
LENGTH = CHANNELS.index("everted_length_mm")
LEAK, DROOP, CREEP = map(make_candidate, ("pressure_leak", "pressure_droop", "wall_creep"))
QUIET = Cell("tip_x_mm", "long", (), 10, 0.5, 0.5, 1e-9)


def make_score(total: float, effects: tuple[Candidate, ...] = (), moved: float = 0.0, cost: float = 0.0) -> Score:
    """A fit of one nominal parameter, ``moved`` by so many tolerances, and of effects."""
    axis = Axis(YIELD, 9.0, 1.0, 0.0, 20.0, nominal=True)
    space = Space(Setting(Model()), (axis, *(axis for effect in effects for axis in effect.axes)))
    z = np.concatenate(([moved], *(effect.starts[0] for effect in effects)))
    fit = Fit(space, z, np.zeros(1), np.zeros(1), np.zeros((1, space.size)), cost)
    return Score(effects, fit, CrossValidation(np.zeros(0), np.array([total]), np.zeros((1, 0))), 1e-3 * total)


@pytest.mark.parametrize(
    ("moved_without", "moved_with", "gained", "expected"),
    [
        (4.0, 1.0, 20.0, Verdict.EFFECT),
        (3.0, 1.0, 20.0, Verdict.NO_EFFECT),  # so far a parameter may be off
        (4.0, 3.5, 20.0, Verdict.NO_EFFECT),  # with the effect it must still go as far
        (4.0, 1.0, 5.0, Verdict.NO_EFFECT),  # it fits hardly better
    ],
)
def test_agreement_that_strains_the_nominal_parameters_may_hide_an_effect(
    moved_without: float, moved_with: float, gained: float, expected: Verdict
) -> None:
    base, best = make_score(100.0, (), moved_without, 500.0), make_score(100.0, (LEAK,), moved_with, 500.0 - gained)
    assert decide(base, best, [QUIET], [QUIET], ["pressure_leak"], Thresholds()) is expected
    assert relieved_share(base, best) == pytest.approx(1.0 - (moved_with / moved_without) ** 2)


def test_what_a_strained_agreement_takes_is_said() -> None:
    moved = ParameterEstimate(YIELD, 9.0, 12.3, 1.0, 0.1, True, False)
    still = ParameterEstimate("robot.tendon_arm_mm", 0.7, 0.71, 0.07, 0.01, True, False)
    (text,) = remark_strain([still, moved])
    assert f"{YIELD} by 3.3 tolerances: measure" in text


def make_growth(measured: np.ndarray) -> Run:
    commands = np.zeros((len(measured), 8))
    commands[:, 0] = 1.0
    commands[:, 1] = np.nan
    commands[:, 4] = 18.0
    return Run("r", "full", (0.0, -9.81, 0.0), "r", "free", 20.0, 0.5 * np.arange(len(measured)), commands, measured)


@pytest.mark.parametrize(("stands_at", "led_to", "is_better"), [(0.6, 0.35, True), (0.3, 0.6, False)])
def test_recalibration_begins_anew_where_a_rival_left_it_if_that_is_better(
    stands_at: float, led_to: float, is_better: bool
) -> None:
    free = {
        "effects.viscous_eversion.resistance_kpa_s_mm": 0.0,
        "effects.tail_coulomb_friction.yield_growth_per_mm": 0.0,
    }
    model = set_values(load_model("mammobot_2023"), {SLIP: 0.3, **free})
    table = np.full((40, len(CHANNELS)), np.nan)
    table[:, LENGTH] = simulate_run(model, make_growth(table))[:, LENGTH]
    dataset = Dataset("test", "", {"everted_length_mm": 0.3}, {}, (), (make_growth(table),), (), Path())
    predictor = Predictor(dataset, Measurement(dataset, estimate_noise(dataset)))
    use = np.ones(40, dtype=bool)
    split = Split(use, (0,), ())
    space = Space(Setting(model), (Axis(SLIP, 0.5, 0.1, 0.0, 0.9, tolerance=3.0, nominal=True),))
    base = score_fit(predictor, evaluate_fit(predictor, space, np.array([10.0 * (stands_at - 0.5)])), split)
    extended = space.extend(LEAK.axes, LEAK.fixed)
    start = np.concatenate(([10.0 * (led_to - 0.5)], np.zeros(LEAK.size)))
    rival = score_fit(predictor, evaluate_fit(predictor, extended, start), split, (LEAK,))
    found = choose._recalibrate_from(predictor, base, [rival], split, Thresholds())
    if is_better:
        assert found.fit.cost < base.fit.cost - 12.0
        assert space.axes[0].value(float(found.fit.z[0])) == pytest.approx(0.3, abs=0.02)
    else:
        assert found is base


def test_beside_a_second_effect_that_does_as_well_alone_a_further_one_is_looked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A leak led to a droop, which needs no leak, but a creep beside it."""
    leak, leak_droop = make_score(5000.0, (LEAK,)), make_score(2000.0, (LEAK, DROOP))
    droop, droop_creep = make_score(2010.0, (DROOP,)), make_score(1000.0, (DROOP, CREEP))
    further = {leak.name: leak_droop, droop.name: droop_creep}
    alone = {leak_droop.name: droop, droop_creep.name: make_score(9000.0, (CREEP,))}
    loud = [dataclasses.replace(QUIET, excess=4.0)]
    monkeypatch.setattr(choose, "_fit_promising", lambda *_: [leak])
    monkeypatch.setattr(choose, "_recalibrate_from", lambda predictor, base, *_: base)
    monkeypatch.setattr(choose, "_recheck_numerics", lambda predictor, base, rivals, split: (base, rivals))
    monkeypatch.setattr(choose, "_swap_first", lambda *_: [])
    monkeypatch.setattr(choose, "_drop_first", lambda predictor, base, pair, split: alone[pair.name])
    monkeypatch.setattr(choose._Search, "find_further", lambda self, known, _: further.get(known.name))
    unused = cast(Any, None)
    predictor = cast(Any, type("NoPredictor", (), {"measurement": None}))
    base = make_score(10000.0)
    choice = choose.choose_effects(predictor, base, unused, unused, unused, Thresholds(), lambda _: loud)
    assert [effect.name for effect in choice.best.effects] == ["pressure_droop", "wall_creep"]
