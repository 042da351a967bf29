"""The truth's own code: it does what the library does where nothing differs, and something else where it should."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from evergym.discrepancy.blind.alteration import Alteration
from evergym.discrepancy.blind.growth_forms import GROWTH_FORMS, GrowthLaw, remove_resistance
from evergym.discrepancy.blind.hidden import HIDDEN, list_hidden
from evergym.discrepancy.blind.outside import OUTSIDE
from evergym.discrepancy.blind.plan import PlannedRun
from evergym.discrepancy.blind.play import play_campaign
from evergym.discrepancy.blind.protocols import PROTOCOLS, find_range
from evergym.discrepancy.blind.rig import OFF
from evergym.discrepancy.blind.tendon_forms import advance_smooth_play
from evergym.discrepancy.parameters import set_values
from evergym.effects.tendon_backlash import TendonBacklash, compute_transmitted_pull
from evergym.model import Model, Numerics, load_model

Array = NDArray[np.float64]

GROWING = ("growth", "growth_threshold", "growth_bent", "retraction")
NUMERICS = Numerics(section_length_mm=3.5, step_s=0.0625)
DRAWN = {name: HIDDEN[name].draw(np.random.default_rng(3)) for name in HIDDEN}


def plan(name: str, seed: int = 0) -> PlannedRun:
    run = PROTOCOLS[name](np.random.default_rng(seed), find_range(load_model("mammobot_2023")))
    # Short, where the robot grows at every pressure.
    return dataclasses.replace(run, initial_everted_length_mm=25.0) if name in GROWING else run


def without(name: str) -> Model:
    return set_values(load_model("mammobot_2023"), {f"effects.{name}.{key}": v for key, v in OFF.get(name, {}).items()})


def play(model: Model, run: PlannedRun, *alterations: Alteration) -> Array:
    return play_campaign(model, [run], NUMERICS, alterations)[0]


def difference(one: Array, other: Array) -> float:
    """Root mean square over tip and everted length [mm]."""
    return float(np.sqrt(np.mean((one[:, :4] - other[:, :4]) ** 2)))


@pytest.mark.parametrize("name", GROWING)
def test_the_growth_law_in_python_is_the_library_s_where_no_form_differs(name: str) -> None:
    model, run = load_model("mammobot_2023"), plan(name, seed=4)
    library = play(model, run)
    own = play(remove_resistance(model), run, GrowthLaw(model, ()))
    assert np.ptp(library[:, 3]) > 1.0
    # It sees pressure and bend as they were a step ago, so it may be a step late.
    assert np.abs(own[:, 3] - library[:, 3]).max() < NUMERICS.step_s * np.abs(library[:, 4]).max()


@pytest.mark.parametrize(("form", "name"), GROWTH_FORMS.items())
def test_every_growth_form_is_like_its_effect_and_not_the_same(form: str, name: str) -> None:
    base = without(name)
    model = set_values(base, {f"effects.{name}.{key}": value for key, value in DRAWN[name].items()})
    run = plan("growth_bent", seed=2) if name == "tail_capstan_friction" else plan("growth", seed=1)
    missing, library = play(base, run), play(model, run)
    other = play(remove_resistance(model), run, GrowthLaw(model, (form,)))
    effect = difference(library, missing)
    assert effect > 0.05
    assert difference(other, library) > 0.01 * effect  # another law
    assert difference(other, library) < 0.8 * effect  # of the same effect


@pytest.mark.parametrize("name", [n for n, hidden in list_hidden().items() if hidden.form is not None])
def test_every_other_form_is_like_its_effect_and_not_the_same(name: str) -> None:
    hidden, base = HIDDEN[name], without(name)
    run = plan(hidden.exciting[0], seed=1)
    model = set_values(base, {f"effects.{name}.{key}": value for key, value in DRAWN[name].items()})
    assert hidden.form is not None and hidden.form_values is not None
    missing, library = play(base, run), play(model, run)
    other = play(base, run, hidden.form(hidden.form_values(DRAWN[name], base)))
    # In the channel that the effect moves most.
    place = int(np.argmax(np.nanmax(np.abs(library - missing), axis=0)))
    effect, change = (library - missing)[:, place], (other - library)[:, place]
    assert np.abs(effect).max() > 0.3
    assert np.abs(change).max() > 0.01 * np.abs(effect).max()
    assert np.sqrt(np.mean(change**2)) < np.sqrt(np.mean(effect**2))  # nearer to the effect than to nothing


@pytest.mark.parametrize("name", OUTSIDE)
def test_every_outside_effect_shows_on_a_run_that_excites_it(name: str) -> None:
    model = load_model("mammobot_2023")
    effect = OUTSIDE[name]
    values = effect.draw(np.random.default_rng(1), find_range(model))
    run = plan(effect.exciting[0], seed=1)
    signals = play_campaign(model, [run] * 4, NUMERICS, [effect.form(values)])
    assert np.isfinite(signals[-1]).all()
    assert np.abs(signals[-1] - play(model, run))[:, :4].max() > 0.5


def test_a_soft_play_becomes_the_library_s_as_its_edges_sharpen() -> None:
    drive = 1e-3 * np.concatenate((np.linspace(0.0, 2.0, 60), np.linspace(2.0, 0.5, 60), np.linspace(0.5, 1.5, 60)))
    parameters = TendonBacklash(backlash_mm=0.4, lost_motion_mm=0.0).compile()
    worst = []
    for edge in (4e-5, 1e-5, 2e-6):
        sharp = soft = 0.0
        gaps = []
        for old, new in itertools.pairwise(drive.tolist()):
            sharp = compute_transmitted_pull(parameters, new, sharp)
            soft = advance_smooth_play(old, new, soft, 0.4e-3, edge)
            gaps.append(abs(soft - sharp))
        worst.append(max(gaps))
    assert worst[0] > worst[1] > worst[2]
    assert worst[2] < 2e-5


def test_an_unknown_growth_form_is_refused() -> None:
    with pytest.raises(ValueError, match="made_up"):
        GrowthLaw(load_model("mammobot_2023"), ("made_up",))
