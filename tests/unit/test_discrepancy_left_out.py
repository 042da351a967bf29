"""Leave experiments out: strengths from the others, and the intervals that follow."""

from __future__ import annotations

import numpy as np
import pytest

from evergym.discrepancy.cross_validate import cross_validate
from evergym.discrepancy.fit import Fit
from evergym.discrepancy.interval import estimate_intervals
from evergym.discrepancy.setting import Setting
from evergym.discrepancy.space import Axis, Space
from evergym.model import Model


def make_linear_fit(
    jacobian: np.ndarray, value: np.ndarray, tolerance: tuple[float, ...], rows: np.ndarray | None = None
) -> Fit:
    """The exact minimum of a linear problem."""
    precision = np.array(tolerance) ** -2.0
    use = slice(None) if rows is None else rows
    normal = jacobian[use].T @ jacobian[use] + np.diag(precision)
    z = np.linalg.solve(normal, jacobian[use].T @ value[use])
    axes = tuple(Axis(f"p{i}", 0.0, 1.0, -1e6, 1e6, tolerance=t) for i, t in enumerate(tolerance))
    residual = value - jacobian @ z
    return Fit(Space(Setting(Model()), axes), z, jacobian @ z, residual, jacobian, 0.0)


def test_left_out_experiment_does_not_enter_the_strength() -> None:
    rng = np.random.default_rng(4)
    experiment = np.repeat(np.arange(4), 50)
    jacobian = rng.normal(size=(200, 2))
    value = jacobian @ np.array([0.5, 2.0]) + 0.1 * rng.normal(size=200)
    fit = make_linear_fit(jacobian, value, (1.0, 1e6))
    validation = cross_validate(fit, experiment, range(4), np.ones(200, dtype=bool), nominals=1)
    for k in range(4):
        without = make_linear_fit(jacobian, value, (1.0, 1e6), np.flatnonzero(experiment != k))
        assert validation.z[k, 1] == pytest.approx(without.z[1], abs=2e-3)  # 150 samples against a prior 1 wide
    assert validation.total == pytest.approx(np.sum(validation.residual**2))
    assert validation.total > fit.chi2 - 1e-9  # strengths from elsewhere never fit better


def test_strength_that_only_one_experiment_shows_keeps_the_benefit_of_the_doubt() -> None:
    experiment = np.repeat(np.arange(3), 20)
    column = np.where(experiment == 0, 1.0, 0.0)
    fit = make_linear_fit(column[:, None], 3.0 * column, (30.0,))
    validation = cross_validate(fit, experiment, range(3), np.ones(60, dtype=bool), nominals=0)
    np.testing.assert_allclose(validation.z[:, 0], fit.z[0], rtol=1e-3)


def test_strength_that_other_experiments_contradict_explains_nothing() -> None:
    experiment = np.repeat(np.arange(3), 20)
    value = np.where(experiment == 0, 3.0, 0.0)
    fit = make_linear_fit(np.ones((60, 1)), value, (30.0,))
    validation = cross_validate(fit, experiment, range(3), np.ones(60, dtype=bool), nominals=0)
    assert validation.chi2[0] > 0.9 * np.sum(value[experiment == 0] ** 2)


def test_a_strength_that_recalibration_nearly_makes_up_for_is_judged_with_the_nominals_it_was_fitted_with() -> None:
    rng = np.random.default_rng(5)
    experiment = np.repeat(np.arange(4), 50)
    effect = rng.normal(size=200)
    jacobian = np.column_stack((effect + 0.05 * rng.normal(size=200), effect))
    value = jacobian @ np.array([0.4, 2.0]) + rng.normal(size=200)
    fit = make_linear_fit(jacobian, value, (1.0, 1e6))
    validation = cross_validate(fit, experiment, range(4), np.ones(200, dtype=bool), nominals=1)
    assert np.ptp(validation.z[:, 1]) > 0.1  # alone, each refit is uncertain
    assert validation.total < 1.05 * fit.chi2


def test_a_refit_that_its_own_experiments_do_not_bear_out_is_shortened() -> None:
    """A derivative leads over a leap, behind which everything is far off; half way to it, all is as it should be."""
    experiment = np.repeat(np.arange(3), 20)
    value = np.where(experiment == 0, 2.0, 3.0)
    fit = make_linear_fit(np.ones((60, 1)), value, (30.0,))
    leap = fit.z[0] + 0.15

    def simulate(z: np.ndarray, samples: np.ndarray) -> np.ndarray:
        rest: np.ndarray = value[samples] - z[0] - (50.0 if z[0] > leap else 0.0)
        return rest

    use = np.ones(60, dtype=bool)
    linear = cross_validate(fit, experiment, range(3), use, nominals=0)
    assert linear.z[0, 0] > leap
    validation = cross_validate(fit, experiment, range(3), use, nominals=0, simulate=simulate)
    assert validation.chi2[0] < linear.chi2[0]
    assert validation.chi2[0] > np.sum(fit.residual[experiment == 0] ** 2)
    np.testing.assert_allclose(validation.chi2[1:], linear.chi2[1:])


def test_an_interval_is_no_narrower_than_what_is_left_over_or_than_the_search_was_fine() -> None:
    rng = np.random.default_rng(6)
    experiment = np.repeat(np.arange(2), 100)  # too few for a jackknife
    jacobian = rng.normal(size=(200, 1))

    def width(noise: float, resolution: float = 0.0) -> float:
        fit = make_linear_fit(jacobian, 4.0 * jacobian[:, 0] + noise * rng.normal(size=200), (1e6,))
        validation = cross_validate(fit, experiment, range(2), np.ones(200, dtype=bool), nominals=0)
        (interval,) = estimate_intervals(fit, validation, 0, resolution)
        assert interval.low_90 < 4.0 < interval.high_90
        return interval.high_90 - interval.low_90

    assert width(0.1) == pytest.approx(2 * 1.645 / np.sqrt(np.sum(jacobian**2)), rel=1e-3)
    assert width(5.0) > 4.0 * width(0.1)
    assert width(0.1, resolution=0.1) == pytest.approx(2 * 1.645 * 0.4, rel=0.01)


def test_unknowns_without_a_derivative_stay_when_an_experiment_is_left_out() -> None:
    rng = np.random.default_rng(9)
    experiment = np.repeat(np.arange(4), 50)
    fit = make_linear_fit(rng.normal(size=(200, 2)), rng.normal(size=200), (1e6, 1e6))
    use = np.ones(200, dtype=bool)
    free = cross_validate(fit, experiment, range(4), use, nominals=0)
    steady = cross_validate(fit, experiment, range(4), use, nominals=0, steady=np.array([True, False]))
    assert np.ptp(free.z[:, 0]) > 1e-3
    np.testing.assert_allclose(steady.z[:, 0], fit.z[0], atol=1e-6)
    assert np.ptp(steady.z[:, 1]) > 1e-3


def test_strengths_that_nearly_agree_are_not_contradicted() -> None:
    """Where growth stalls or not, a fortieth of a strength decides about much; a tenth is another strength."""
    experiment = np.repeat(np.arange(3), 20)
    use = np.ones(60, dtype=bool)
    steep = np.where(experiment == 0, 100.0, 1.0)
    for ratio, grows in ((1.025, 1.0), (1.1, 100.0)):
        value = steep * np.where(experiment == 0, ratio, 1.0)
        fit = make_linear_fit(steep[:, None], value, (30.0,))
        assert fit.z[0] == pytest.approx(ratio, abs=1e-3)
        validation = cross_validate(fit, experiment, range(3), use, nominals=0)
        fitted = float(np.sum(fit.residual[experiment == 0] ** 2))
        assert validation.chi2[0] >= grows * fitted * (1.0 - 1e-9)
        assert (validation.chi2[0] > 2.0 * fitted) == (grows > 1.0)
