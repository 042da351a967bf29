"""Leave whole experiments out: take an effect's strength from the other experiments, and see how far off it then is.

The nominal parameters stay as fitted to all experiments, for every model alike: what is tested is the effect. (With the
nominal parameters left out too, most of the error would be that of a stiffness which only one experiment shows; and a
strength that moves with them and is then judged without them is off wherever recalibration nearly does what it does.)
The refits are linear about the fit, from its Jacobian; the experiment left out is then simulated at the refitted
strength, which costs one simulation of every run in all. Where growth stalls or a tendon goes slack, no derivative
holds: a refit that seems to contradict its experiment is simulated on the others too, and shortened until it suits
them as well as the strength that it left. Experiments are left out whole: rows of one experiment say
nearly the same, and random rows would let any candidate win.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.fit import Fit, solve_normal

__all__ = ["CrossValidation", "cross_validate"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

Simulate = Callable[[Array, NDArray[np.int64]], Array]

STEP_MIN = 1e-3
"""Refits that move less [z] need no simulation."""
CONTRADICTED = 2.0
"""A refit is tried on its own experiments if it leaves this many times as much of the one left out as the fit does."""
SHARES = (0.5, 0.25)
"""Shares of a refit that are tried, where the whole is worse for the experiments that it was made from; then none."""
DOUBT_SHARE, DOUBT_OFFSET = 0.5, 0.1
"""A strength that the other experiments say nothing about stays as it is; one that they contradict moves: they are
taken together with a prior about the fitted strength, this share of it (and this much of the typical one) wide."""
AGREED = 0.05
"""Strengths that differ by this share of themselves agree: a refit moves a strength by what is beyond. Where growth
stalls or the robot snaps over, a hundredth of a strength may decide about ten sigma."""


@dataclass(frozen=True)
class CrossValidation:
    """What each experiment's residual is when the effects' strengths come from the others.

    Attributes:
        residual: Whitened, of every sample, (n,); zero outside the folds.
        chi2: Sum of squares by experiment, (e,).
        z: All unknowns, nominal parameters included, fitted without each experiment, (e, m).
    """

    residual: Array
    chi2: Array
    z: Array

    @property
    def total(self) -> float:
        """Sum of squares over all experiments."""
        return float(np.sum(self.chi2))


def cross_validate(
    fit: Fit,
    experiment: NDArray[np.int64],
    experiments: Sequence[int],
    use: Mask,
    nominals: int,
    simulate: Simulate | None = None,
    ceiling: Array | None = None,
    steady: Mask | None = None,
) -> CrossValidation:
    """Leave each of ``experiments`` out in turn.

    Args:
        fit: A fit to the samples ``use``.
        experiment: Index of the experiment of every sample, (n,).
        experiments: Experiments that take part; the samples of others are not looked at.
        use: Samples that take part, (n,).
        nominals: Number of nominal parameters: the first unknowns.
        simulate: Returns the whitened residual of some samples (of whole runs) at z; None: linear.
        ceiling: Sum of squares that no experiment counts more than, (e,): a fit that is far off is far off, and one
            experiment in which a robot snaps over must not outvote the others. None: no such limit.
        steady: Unknowns that stay as fitted, (m,): those without a derivative. None: none.
    """
    precision, (low, high) = fit.space.prior_precision, fit.space.limits
    centre = np.zeros(fit.space.size)
    centre[nominals:] = fit.z[nominals:]
    doubt = precision.copy()
    doubt[nominals:] += (DOUBT_SHARE * np.abs(fit.z[nominals:]) + DOUBT_OFFSET) ** -2
    if steady is not None:
        doubt[steady] = 1e12
    size = fit.space.size
    rows = [np.flatnonzero((experiment == index) & use) for index in experiments]
    normals = [fit.jacobian[part].T @ fit.jacobian[part] for part in rows]
    gradients = [fit.jacobian[part].T @ fit.residual[part] for part in rows]
    normal, gradient = sum(normals, np.zeros((size, size))), sum(gradients, np.zeros(size))
    residual = np.zeros_like(fit.residual)
    chi2, unknowns = np.zeros(len(rows)), np.zeros((len(rows), size))
    for k, part in enumerate(rows):
        step = np.zeros(size)
        others = normal - normals[k], gradient - gradients[k]
        if size:
            unknowns[k] = fit.z + solve_normal(*others, doubt, fit.z, (low, high), centre=centre)
        if size > nominals:
            step[nominals:] = solve_normal(
                others[0][nominals:, nominals:],
                others[1][nominals:],
                doubt[nominals:],
                fit.z[nominals:],
                (low[nominals:], high[nominals:]),
                centre=centre[nominals:],
            )
            step *= _beyond_agreement(step[nominals:], fit.z[nominals:])
        residual[part] = fit.residual[part] - fit.jacobian[part] @ step
        if simulate is not None and np.any(np.abs(step) > STEP_MIN):
            residual[part] = simulate(fit.z + step, part)
            fitted = _square(fit.residual[part])
            if _square(residual[part]) > CONTRADICTED * (fitted + len(part)):
                rest = np.concatenate([other for other in rows if other is not part])
                residual[part] = _shorten(fit, simulate, step, part, rest, residual[part])
        chi2[k] = _square(residual[part])
        if ceiling is not None and chi2[k] > ceiling[k]:
            residual[part] *= np.sqrt(ceiling[k] / chi2[k])
            chi2[k] = ceiling[k]
    return CrossValidation(residual, chi2, unknowns)


def _shorten(
    fit: Fit, simulate: Simulate, step: Array, part: NDArray[np.int64], rest: NDArray[np.int64], found: Array
) -> Array:
    """Return the residual of ``part`` at the longest share of a step that makes ``rest`` no worse.

    Args:
        fit: The fit that the step leaves.
        simulate: See `cross_validate`.
        step: In z, (m,).
        part: Samples left out.
        rest: Samples that the step was made from.
        found: Residual of ``part`` at the whole step.
    """
    limit = _square(fit.residual[rest])
    if _square(simulate(fit.z + step, rest)) <= limit:
        return found
    for share in SHARES:
        if _square(simulate(fit.z + share * step, rest)) <= limit:
            return simulate(fit.z + share * step, part)
    return fit.residual[part]


def _beyond_agreement(step: Array, strength: Array) -> float:
    """Return the share of a step (m,) of strengths (m,) that is beyond `AGREED`: they move together."""
    most = float(np.max(np.abs(step) / np.maximum(np.abs(strength), STEP_MIN)))
    return max(0.0, 1.0 - AGREED / most) if most > 0.0 else 0.0


def _square(residual: Array) -> float:
    return float(residual @ residual)
