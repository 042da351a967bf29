"""Fit the unknowns of a space to whitened measurements: Gauss-Newton with tolerances, limits and absolute steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.residual import Measurement
from evergym.discrepancy.space import Space

__all__ = ["Fit", "compute_jacobian", "evaluate_fit", "fit_space", "solve_normal", "solve_step", "whitened_residual"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STEP_MAX = 1.5
"""Largest move of an unknown in one iteration, in units of its scale."""
GAIN_MIN = 0.5
"""A fit has converged when a step promises less than this (in half chi-squares)."""


@dataclass(frozen=True)
class Fit:
    """A fitted space.

    Attributes:
        space: The unknowns.
        z: Their values, shape (m,).
        prediction: Of every sample [channel's unit], (n,).
        residual: Measured minus predicted, whitened, (n,).
        jacobian: Change of the whitened prediction per unit of z, (n, m).
        cost: Half the sum of squares of residual and prior.
    """

    space: Space
    z: Array
    prediction: Array
    residual: Array
    jacobian: Array
    cost: float

    @property
    def chi2(self) -> float:
        """Sum of squares of the whitened residual."""
        return float(self.residual @ self.residual)


def whitened_residual(measurement: Measurement, prediction: Array) -> Array:
    """Return measured minus predicted, whitened; where a simulation failed it counts as far off."""
    return measurement.whiten(measurement.subtract(prediction))


def compute_jacobian(
    predictor: Predictor, space: Space, z: Array, columns: list[int], mark_inert: bool = True
) -> Array:
    """Return the change of the whitened prediction per unit of z for some unknowns, shape (n, len(columns))."""
    low, high = space.limits
    steps, moves = [], []
    for column in columns:
        step = space.axes[column].step
        if z[column] + step > high[column]:
            step = -step
        if z[column] + step < low[column]:
            step = 0.5 * (high[column] - low[column])
        moved = z.copy()
        moved[column] += step
        steps.append(step)
        moves.append((space.axes[column].path, space.setting(moved)))
    out = np.zeros((predictor.measurement.size, len(columns)))
    here = space.setting(z)
    nominal = [space.axes[column].nominal for column in columns]
    for wanted in (True, False):
        places = [place for place, is_nominal in enumerate(nominal) if is_nominal is wanted]
        changes = predictor.predict_changes([moves[place] for place in places], here, mark_inert=wanted and mark_inert)
        for place, change in zip(places, changes, strict=True):
            out[:, place] = np.where(np.isfinite(change), change, 0.0) / steps[place]
    return predictor.measurement.whiten(out)


def solve_step(
    jacobian: Array, residual: Array, precision: Array, z: Array, limits: tuple[Array, Array], reach: float = np.inf
) -> Array:
    """Return the step in z that minimises |r - J d|^2 + prior(z + d) within the limits and ``reach``, shape (m,)."""
    size = jacobian.shape[1]
    if size == 0:
        return np.zeros(0)
    normal = jacobian.T @ jacobian
    return solve_normal(normal, jacobian.T @ residual, precision, z, limits, reach)


def solve_normal(
    normal: Array,
    gradient: Array,
    precision: Array,
    z: Array,
    limits: tuple[Array, Array],
    reach: float = np.inf,
    centre: Array | None = None,
) -> Array:
    """As `solve_step`, from the normal matrix J'J and the gradient J'r; the prior is about ``centre`` (None: 0)."""
    size = len(z)
    matrix = normal + np.diag(precision + 1e-9 * (np.diag(normal) + 1.0))
    right = gradient - precision * (z if centre is None else z - centre)
    factor = np.linalg.cholesky(matrix)
    step = np.linalg.solve(factor.T, np.linalg.solve(factor, right))
    low = np.maximum(limits[0] - z, -reach)
    high = np.minimum(limits[1] - z, reach)
    if size and (np.any(step < low) or np.any(step > high)):
        low, high = np.minimum(low, 0.0) - 1e-12, np.maximum(high, 0.0) + 1e-12
        step = lsq_linear(factor.T, np.linalg.solve(factor, right), (low, high), method="bvls").x
    return np.asarray(step, dtype=np.float64)


def evaluate_fit(predictor: Predictor, space: Space, z: Array, jacobian: Array | None = None) -> Fit:
    """Return the fit at z without moving."""
    prediction = predictor.predict(space.setting(z))
    residual = whitened_residual(predictor.measurement, prediction)
    if jacobian is None:
        jacobian = compute_jacobian(predictor, space, z, list(range(space.size)))
    cost = 0.5 * float(residual @ residual + space.prior_precision @ z**2)
    return Fit(space, z, prediction, residual, jacobian, cost)


def fit_space(
    predictor: Predictor,
    space: Space,
    start: Array,
    rows: Mask | None = None,
    jacobian: Array | None = None,
    refresh: list[int] | None = None,
    iterations: int = 6,
) -> Fit:
    """Fit the unknowns to the samples ``rows`` by Gauss-Newton steps that are shortened until they improve.

    Args:
        predictor: Measurements and simulations.
        space: The unknowns.
        start: z at the start, (m,).
        rows: Samples to fit, (n,); None: all.
        jacobian: A Jacobian near the start to begin with, (n, m); None: computed.
        refresh: Unknowns whose columns are computed anew in every iteration; the others are updated by Broyden's
            formula only. None: all.
        iterations: At most.
    """
    use = np.ones(predictor.measurement.size, dtype=bool) if rows is None else rows
    columns = list(range(space.size)) if refresh is None else refresh
    precision, limits = space.prior_precision, space.limits
    z = np.clip(start, *limits)
    prediction = predictor.predict(space.setting(z))
    residual = whitened_residual(predictor.measurement, prediction)
    if jacobian is None:
        jacobian = compute_jacobian(predictor, space, z, list(range(space.size)))
    elif columns:
        jacobian = jacobian.copy()
        jacobian[:, columns] = compute_jacobian(predictor, space, z, columns)
    cost = _cost(residual, use, precision, z)
    for iteration in range(iterations):
        step = solve_step(jacobian[use], residual[use], precision, z, limits, STEP_MAX)
        promised = cost - _cost(residual - jacobian @ step, use, precision, z + step)
        if promised < GAIN_MIN:
            break
        share, accepted = 1.0, False
        for _ in range(4):
            moved = np.clip(z + share * step, *limits)
            new_prediction = predictor.predict(space.setting(moved))
            new_residual = whitened_residual(predictor.measurement, new_prediction)
            new_cost = _cost(new_residual, use, precision, moved)
            if new_cost < cost - 1e-3 * share * promised:
                accepted = True
                break
            share *= 0.35
        if not accepted:
            break
        move = moved - z
        error = -(new_residual - residual) - jacobian @ move
        jacobian = jacobian + np.outer(error, move) / float(move @ move)
        gained = cost - new_cost
        z, prediction, residual, cost = moved, new_prediction, new_residual, new_cost
        if gained < GAIN_MIN or iteration == iterations - 1:
            break
        if columns:
            jacobian[:, columns] = compute_jacobian(predictor, space, z, columns)
    return Fit(space, z, prediction, residual, jacobian, cost)


def _cost(residual: Array, use: Mask, precision: Array, z: Array) -> float:
    part = residual[use]
    return 0.5 * float(part @ part + precision @ z**2)
