"""What can be found: wrong nominals are absorbed, an effect is not, and the true cell is where the difference is."""

from __future__ import annotations

import numpy as np
import pytest

from evergym.discrepancy.blind.detect import find_cells, recalibrate, weigh_part
from evergym.discrepancy.blind.plan import convert_plan
from evergym.discrepancy.blind.play import play_campaign
from evergym.discrepancy.blind.protocols import PROTOCOLS, find_range
from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.parameters import get_value, set_values
from evergym.model import Numerics, load_model

SIGMA = {"tip_x_mm": 0.3, "tip_z_mm": 0.3, "everted_length_mm": 0.5}
NUMERICS = Numerics(section_length_mm=2.2, step_s=0.0625)
MODEL = set_values(
    load_model("mammobot_2023"),
    {"effects.tendon_backlash.backlash_mm": 0.0, "effects.tendon_backlash.lost_motion_mm": 0.0},
)
STIFFNESS = "robot.catheter_bending_stiffness_n_m2"
PLANS = [
    PROTOCOLS[name](np.random.default_rng(i), find_range(MODEL)).rename(f"r{i}", f"e{i}")
    for i, name in enumerate(("tendon_staircase", "load_steps", "growth"))
]
RUNS = [convert_plan(plan, np.zeros((len(plan.time_s), len(CHANNELS)))) for plan in PLANS]


def test_wrong_nominals_are_recalibrated_away() -> None:
    real = set_values(MODEL, {STIFFNESS: 1.08 * float(get_value(MODEL, STIFFNESS))})
    signals = play_campaign(real, PLANS, NUMERICS)
    before = play_campaign(MODEL, PLANS, NUMERICS)
    assert max(np.abs(a - b)[:, 0].max() for a, b in zip(signals, before, strict=True)) > 3.0 * SIGMA["tip_x_mm"]
    best = recalibrate(MODEL, RUNS, signals, SIGMA)
    assert find_cells(RUNS, best.residual, list(SIGMA))[0].sigmas < 1.0
    assert best.nominals[STIFFNESS] == pytest.approx(float(get_value(real, STIFFNESS)), rel=0.02)


def test_a_hidden_effect_is_found_in_its_place() -> None:
    real = set_values(MODEL, {"effects.tendon_backlash.backlash_mm": 0.5})
    signals, without = (play_campaign(model, PLANS, NUMERICS) for model in (real, MODEL))
    best = recalibrate(MODEL, RUNS, signals, SIGMA)
    change = [a - b for a, b in zip(signals, without, strict=True)]
    found = weigh_part(best, RUNS, change, SIGMA)
    assert found.detectable
    assert 0.1 < found.kept_share <= 1.0
    cells = find_cells(RUNS, best.residual, list(SIGMA))
    assert cells[0].channel in ("tip_x_mm", "tip_z_mm")
    assert cells[0].sigmas >= 3.0


def test_what_a_nominal_does_cannot_be_told_from_it() -> None:
    signals = play_campaign(MODEL, PLANS, NUMERICS)
    stiffer = play_campaign(set_values(MODEL, {STIFFNESS: 1.05 * float(get_value(MODEL, STIFFNESS))}), PLANS, NUMERICS)
    best = recalibrate(MODEL, RUNS, signals, SIGMA)
    found = weigh_part(best, RUNS, [a - b for a, b in zip(stiffer, signals, strict=True)], SIGMA)
    assert found.kept_share < 0.25
    assert not found.detectable


def test_cells_are_means_over_what_was_measured() -> None:
    residual = [np.zeros((len(run.time_s), 3)) for run in RUNS]
    residual[0][:, 0] = 4.0
    residual[0][::2, 0] = np.nan
    cells = find_cells(RUNS, residual, list(SIGMA))
    assert cells[0].channel == "tip_x_mm"
    assert cells[0].sigmas == pytest.approx(4.0)
