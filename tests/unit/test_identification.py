"""The identification: it finds what is hidden in readings, frees nothing that one figure alone knows, and goes on."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evergym.experiments.experiment import Experiment
from evergym.experiments.identification import campaign, fit
from evergym.experiments.identification.fit import Selection, compute_residuals, select
from evergym.experiments.identification.free import BENDING, GROWTH_LAWS, clear_growth_law, set_values
from evergym.experiments.identification.plan import BENDING_FIGURES, GROWTH_CURVES, GROWTH_FIGURES, Task
from evergym.experiments.paper import load_experiment
from evergym.experiments.parameter_sets import load_parameter_sets
from evergym.experiments.protocols import simulate
from evergym.model import load_model

FITTED = load_parameter_sets().fitted
TWO = (BENDING[0], BENDING[2])
"""Bending stiffness and backlash: what Figs. 6 and 7 give."""


def test_a_hidden_robot_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    base = load_model("mammobot_2023")
    hidden = [4.9e-4, 0.52]
    truth = set_values(base, [parameter.path for parameter in TWO], hidden)

    def load(name: str) -> Experiment:
        experiment = load_experiment(name)
        return replace(experiment, measured=np.array(simulate(truth, name)))

    monkeypatch.setattr(fit, "load_experiment", load)
    found = fit.fit(base, TWO, select(("fig6_toward", "fig7")))
    assert found.values == pytest.approx(hidden, rel=2e-3)


@pytest.mark.parametrize("parameter", BENDING, ids=lambda parameter: parameter.path)
def test_every_fitted_parameter_acts_in_the_figures_that_it_names(parameter: fit.FreeParameter) -> None:
    assert len(parameter.figures) >= 2
    step = 0.05 * (parameter.high - parameter.low)
    moved = set_values(FITTED, [parameter.path], [_read(parameter.path) + step])
    acting = set()
    for name in BENDING_FIGURES:
        # A twentieth of what the readings resolve: far above the solver's tolerance.
        if np.abs(simulate(moved, name) - simulate(FITTED, name)).max() > 0.05 * load_experiment(name).resolution:
            found = re.match(r"fig\d+", name)
            assert found is not None
            acting.add(found.group())
    assert acting == set(parameter.figures)


def test_the_shipped_model_is_where_the_fit_ends() -> None:
    selections = select(BENDING_FIGURES)

    def cost(values: list[float]) -> float:
        model = set_values(FITTED, [parameter.path for parameter in BENDING], values)
        priors = [
            (value - parameter.prior[0]) / parameter.prior[1]
            for value, parameter in zip(values, BENDING, strict=True)
            if parameter.prior is not None
        ]
        squares = (np.append(compute_residuals(model, selections), priors) / fit.ROBUST_SCALE) ** 2
        return float(np.sum(np.sqrt(1.0 + squares) - 1.0))

    best = [_read(parameter.path) for parameter in BENDING]
    lowest = cost(best)
    for i, parameter in enumerate(BENDING):
        for sign in (-1.0, 1.0):
            moved = list(best)
            moved[i] += sign * 0.05 * (parameter.high - parameter.low)
            if parameter.low < moved[i] < parameter.high:
                assert cost(moved) > lowest, parameter.path


def test_a_growth_curve_that_is_left_out_is_seen_in_no_figure() -> None:
    curve = GROWTH_CURVES[3]
    for name, rows in select(GROWTH_FIGURES, without=curve):
        points = load_experiment(name).points
        assert curve not in set(points.curve.iloc[list(rows)])
        assert len(rows) == np.sum(points.curve != curve)


def test_the_laws_of_growth_exclude_each_other() -> None:
    bare = clear_growth_law(FITTED).effects.tail_coulomb_friction
    assert (bare.gradient_kpa_per_mm, bare.pressure_gradient_per_mm, bare.yield_growth_per_mm) == (0.0, 0.0, 0.0)
    assert len({free[-1].path for free in GROWTH_LAWS.values()}) == 3


def test_a_finished_fit_is_not_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    task = Task("small", load_model("mammobot_2023"), TWO[:1], (Selection("fig6_toward", (1, 5)),), 3)
    first = campaign._run_task(task, tmp_path)
    assert not list(tmp_path.glob(".*"))

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("fitted again")

    monkeypatch.setattr(campaign, "fit", refuse)
    assert campaign._run_task(task, tmp_path).values.tolist() == first.values.tolist()
    # Another input is another fit.
    with pytest.raises(AssertionError, match="fitted again"):
        campaign._run_task(task._replace(evaluations_max=4), tmp_path)


def _read(path: str) -> float:
    value: object = FITTED
    for key in path.split("."):
        value = getattr(value, key)
    assert isinstance(value, float)
    return value
