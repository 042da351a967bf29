"""Intervals of the fitted parameters: the jackknife over whole experiments, never narrower than the fit's own.

The fit's own is scaled by what the fit leaves over: where the residual is more than noise, so is the error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from evergym.discrepancy.cross_validate import CrossValidation
from evergym.discrepancy.fit import Fit

__all__ = ["Interval", "estimate_intervals"]

LEVEL = 0.90


@dataclass(frozen=True)
class Interval:
    """A parameter of a named effect, in its unit of the model file."""

    path: str
    estimate: float
    low_90: float
    high_90: float


def estimate_intervals(fit: Fit, validation: CrossValidation, first: int, resolution: float = 0.0) -> list[Interval]:
    """Return the 90 % intervals of the unknowns from ``first`` on.

    Args:
        fit: Of all samples.
        validation: Its refits without each experiment.
        first: The first unknown that is asked for.
        resolution: Least standard deviation of an unknown as a share of it: how finely it was searched.

    The jackknife needs no model of the noise or of the law's form, but at least three experiments; the curvature of
    the fit is its floor.
    """
    count = len(validation.z)
    precision = np.diag(fit.space.prior_precision + 1e-9)
    spread = np.sqrt(max(fit.chi2 / max(len(fit.residual), 1), 1.0))
    hessian = spread * np.sqrt(np.diag(np.linalg.inv(fit.jacobian.T @ fit.jacobian + precision)))
    low, high = fit.space.limits
    out = []
    for i in range(first, fit.space.size):
        axis = fit.space.axes[i]
        sigma, factor = max(float(hessian[i]), resolution * abs(float(fit.z[i]))), 1.645
        if count >= 3:
            leave_out = validation.z[:, i]
            jackknife = float(np.sqrt((count - 1) / count * np.sum((leave_out - leave_out.mean()) ** 2)))
            if jackknife > sigma:
                sigma, factor = jackknife, float(student.ppf(0.5 + 0.5 * LEVEL, count - 1))
        ends = [axis.value(float(np.clip(fit.z[i] + s * factor * sigma, low[i], high[i]))) for s in (-1.0, 1.0)]
        out.append(Interval(axis.path, axis.value(float(fit.z[i])), min(ends), max(ends)))
    return out
