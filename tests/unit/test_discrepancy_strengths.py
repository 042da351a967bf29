"""Strengths that no gradient finds: behind a dead band, and at the end of what a parameter can be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evergym.discrepancy.candidates import make_candidate
from evergym.discrepancy.cross_validate import CrossValidation
from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.fit import Fit, evaluate_fit
from evergym.discrepancy.noise import estimate_noise
from evergym.discrepancy.parameters import set_values
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.residual import Measurement
from evergym.discrepancy.screen import rank_candidates, screen_candidates, search_strengths
from evergym.discrepancy.select import Score
from evergym.discrepancy.setting import Setting
from evergym.discrepancy.simulate import simulate_run
from evergym.discrepancy.space import Space
from evergym.model import load_model

RESISTANCE = "effects.viscous_eversion.resistance_kpa_s_mm"
FRICTION = "effects.tail_coulomb_friction.yield_growth_per_mm"
LENGTH = CHANNELS.index("everted_length_mm")


def make_growth(measured: np.ndarray) -> Run:
    commands = np.zeros((len(measured), 8))
    commands[:, 0] = 1.0
    commands[:, 1] = np.nan
    commands[:, 4] = 18.0
    return Run("r", "full", (0.0, -9.81, 0.0), "r", "free", 20.0, 0.5 * np.arange(len(measured)), commands, measured)


@pytest.mark.parametrize("true", [9.0, 12.0])
def test_a_resistance_that_the_drive_hides_below_a_limit_is_found(true: float) -> None:
    model = set_values(load_model("mammobot_2023"), {RESISTANCE: 0.0, FRICTION: 0.0, "effects.feed_limit.slip": 0.0})
    table = np.full((40, len(CHANNELS)), np.nan)
    table[:, LENGTH] = simulate_run(set_values(model, {RESISTANCE: true}), make_growth(table))[:, LENGTH]
    dataset = Dataset("test", "", {"everted_length_mm": 0.3}, {}, (), (make_growth(table),), (), Path())
    predictor = Predictor(dataset, Measurement(dataset, estimate_noise(dataset)))
    nominal = evaluate_fit(predictor, Space(Setting(model), ()), np.zeros(0))
    use = np.ones(40, dtype=bool)
    assert nominal.cost > 200.0
    candidate = make_candidate("viscous_eversion", model)
    weak = simulate_run(set_values(model, {RESISTANCE: 2.4}), make_growth(table))[:, LENGTH]
    np.testing.assert_allclose(weak, nominal.prediction, atol=1e-3)  # at the typical strength nothing is to be seen
    signatures = rank_candidates(predictor, nominal, screen_candidates(predictor, nominal, [candidate], use), use)
    ((strength, _),) = search_strengths(predictor, signatures, use)
    assert strength.gain > 0.3 * nominal.cost


@pytest.mark.parametrize(("share", "expected"), [(1.0, True), (0.9, False), (0.0, False)])
def test_a_strength_at_the_end_of_its_range_is_at_its_limit(share: float, expected: bool) -> None:
    candidate = make_candidate("wall_creep")
    space = Space(Setting(load_model("mammobot_2023")), candidate.axes, candidate.fixed)
    z = np.array(
        [(share - axis.origin) / axis.scale if axis.path in candidate.amplitudes else 0.0 for axis in candidate.axes]
    )
    fit = Fit(space, z, np.zeros(1), np.zeros(1), np.zeros((1, space.size)), 0.0)
    score = Score((candidate,), fit, CrossValidation(np.zeros(1), np.zeros(1), z[None]), 0.0)
    assert score.at_limit is expected
