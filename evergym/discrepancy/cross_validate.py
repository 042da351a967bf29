"""Leave whole experiments out: take an effect's strength from the other experiments, and see how far off it then is.

The nominal parameters stay free in all experiments, for every model alike: what is tested is the effect. (With the
nominal parameters left out too, most of the error would be that of a stiffness which only one experiment shows.)
The refits are linear about the fit to all the data, from its Jacobian, so that no run is simulated again. Experiments
are left out whole: rows of one experiment say nearly the same, and random rows would let any candidate win.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.fit import Fit, solve_normal

__all__ = ["CrossValidation", "cross_validate"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DOUBT_SHARE, DOUBT_OFFSET = 0.5, 0.1
"""A strength that the other experiments say nothing about stays as it is; one that they contradict moves: they are
taken together with a prior about the fitted strength, this share of it (and this much of the typical one) wide."""


@dataclass(frozen=True)
class CrossValidation:
    """What each experiment's residual is when the effects' strengths come from the others.

    Attributes:
        residual: Whitened, of every sample, (n,); zero outside the folds.
        chi2: Sum of squares by experiment, (e,).
        z: Unknowns fitted without each experiment, (e, m).
    """

    residual: Array
    chi2: Array
    z: Array

    @property
    def total(self) -> float:
        """Sum of squares over all experiments."""
        return float(np.sum(self.chi2))


def cross_validate(
    fit: Fit, experiment: NDArray[np.int64], experiments: Sequence[int], use: Mask, nominals: int
) -> CrossValidation:
    """Leave each of ``experiments`` out in turn.

    Args:
        fit: A fit to the samples ``use``.
        experiment: Index of the experiment of every sample, (n,).
        experiments: Experiments that take part; the samples of others are not looked at.
        use: Samples that take part, (n,).
        nominals: Number of nominal parameters: the first unknowns.
    """
    precision, (low, high) = fit.space.prior_precision, fit.space.limits
    centre = np.zeros(fit.space.size)
    centre[nominals:] = fit.z[nominals:]
    doubt = precision.copy()
    doubt[nominals:] += (DOUBT_SHARE * np.abs(fit.z[nominals:]) + DOUBT_OFFSET) ** -2
    size = fit.space.size
    rows = [np.flatnonzero((experiment == index) & use) for index in experiments]
    normals = [fit.jacobian[part].T @ fit.jacobian[part] for part in rows]
    gradients = [fit.jacobian[part].T @ fit.residual[part] for part in rows]
    normal, gradient = sum(normals, np.zeros((size, size))), sum(gradients, np.zeros(size))
    residual = np.zeros_like(fit.residual)
    chi2, unknowns = np.zeros(len(rows)), np.zeros((len(rows), size))
    first, rest = slice(0, nominals), slice(nominals, size)
    for k, part in enumerate(rows):
        step = np.zeros(size)
        if size:
            others = normal - normals[k], gradient - gradients[k]
            step = solve_normal(*others, doubt, fit.z, (low, high), centre=centre)
        unknowns[k] = fit.z + step
        if nominals:
            # The strengths stay as the other experiments have them; the nominal parameters answer to all.
            adapted = gradient[first] - normal[first, rest] @ step[rest]
            limits = low[first], high[first]
            step[first] = solve_normal(normal[first, first], adapted, precision[first], fit.z[first], limits)
        residual[part] = fit.residual[part] - fit.jacobian[part] @ step
        chi2[k] = float(residual[part] @ residual[part])
    return CrossValidation(residual, chi2, unknowns)
