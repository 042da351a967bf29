"""Recalibrate the model's nominal parameters within their tolerances, and say which of them the runs determine."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.fit import Fit, compute_jacobian, fit_space
from evergym.discrepancy.nominals import find_nominals
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.residual import Measurement
from evergym.discrepancy.setting import Setting
from evergym.discrepancy.space import Space

__all__ = [
    "Calibration",
    "ParameterEstimate",
    "Sensitivity",
    "approach_samples",
    "calibrate",
    "find_sensitivity",
    "refine",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SILENT = 0.3
"""A parameter whose tolerance moves all samples together by less than this many sigma is left at its nominal value."""
FAR_STEP = 2.0
"""Step [tolerances] at which a parameter that changes nothing nearby is tried again."""
RARE_SHARE = 0.003
"""Share of the samples that is not counted for that: those that move most."""
LEARNT_SHARE = 0.5
"""A parameter counts as identifiable if the runs shrink its uncertainty to this share of its tolerance."""
BROYDEN_ITERATIONS = 6
PRECISE_ITERATIONS = 4
MAP_ITERATIONS = 3


@dataclass(frozen=True)
class ParameterEstimate:
    """A recalibrated parameter, in its unit of the model file."""

    path: str
    nominal: float
    estimate: float
    tolerance: float
    sigma: float
    """One standard deviation after the fit."""
    identifiable: bool
    at_limit: bool


@dataclass(frozen=True)
class Sensitivity:
    """What the nominal parameters do to these runs; nothing that was measured enters.

    Attributes:
        space: The parameters that the runs can feel.
        nominal: Prediction of the model as given [channel's unit], (n,).
        jacobian: Change of the whitened prediction by one tolerance of each, (n, m).
        silent: Parameters that change nothing in these runs.
    """

    space: Space
    nominal: Array
    jacobian: Array
    silent: tuple[str, ...]


@dataclass(frozen=True)
class Calibration:
    """The model with recalibrated nominal parameters.

    Attributes:
        fit: The fit; its space holds the parameters that the runs can feel.
        nominal: Prediction of the model as given [channel's unit], (n,).
        silent: Parameters that change nothing in these runs.
    """

    fit: Fit
    nominal: Array
    silent: tuple[str, ...]

    def estimates(self, fit: Fit | None = None) -> list[ParameterEstimate]:
        """Return the nominal parameters as found by this calibration, or by a fit that extends it."""
        fit = self.fit if fit is None else fit
        count = self.fit.space.size
        precision = np.diag(fit.space.prior_precision + 1e-9)
        covariance = np.linalg.inv(fit.jacobian.T @ fit.jacobian + precision) if fit.space.size else np.zeros((0, 0))
        low, high = fit.space.limits
        out = []
        for i, axis in enumerate(fit.space.axes[:count]):
            sigma = float(np.sqrt(covariance[i, i]))
            z = float(fit.z[i])
            at_limit = z <= low[i] + 1e-6 or z >= high[i] - 1e-6
            out.append(
                ParameterEstimate(
                    axis.path,
                    axis.origin,
                    axis.value(z),
                    axis.scale,
                    sigma * axis.scale,
                    sigma < LEARNT_SHARE,
                    at_limit,
                )
            )
        return out


def find_sensitivity(predictor: Predictor, setting: Setting) -> Sensitivity:
    """Simulate every nominal parameter one step off; what the runs do not feel is left out from here on."""
    space = Space(setting, tuple(find_nominals(setting.model, predictor.dataset.runs)))
    start = np.zeros(space.size)
    nominal = predictor.predict(setting)
    jacobian = compute_jacobian(predictor, space, start, list(range(space.size)), mark_inert=False)
    loud = _is_loud(jacobian)
    # A threshold that the nominal robot just does not reach shows only from farther away.
    doubtful = [i for i, axis in enumerate(space.axes) if not loud[i] and axis.path.startswith("effects.")]
    for step in (FAR_STEP, -FAR_STEP):
        doubtful = [place for place in doubtful if not _is_loud(jacobian[:, [place]])[0]]
        far = replace(space, axes=tuple(replace(axis, step=step) for axis in space.axes))
        columns = compute_jacobian(predictor, far, start, doubtful, mark_inert=False)
        for place, column in zip(doubtful, columns.T, strict=True):
            if np.linalg.norm(column) > np.linalg.norm(jacobian[:, place]):
                jacobian[:, place] = column
                axes = list(space.axes)
                axes[place] = far.axes[place]
                space = replace(space, axes=tuple(axes))
    loud = _is_loud(jacobian)
    silent = tuple(axis.path for axis, heard in zip(space.axes, loud, strict=True) if not heard)
    space = replace(space, axes=tuple(axis for axis, heard in zip(space.axes, loud, strict=True) if heard))
    return Sensitivity(space, nominal, np.ascontiguousarray(jacobian[:, loud]), silent)


def _is_loud(jacobian: Array) -> Mask:
    # What moves a few samples only, as where a rolled robot snaps over, cannot be learnt from a gradient.
    common = np.sort(np.abs(jacobian), axis=0)[: max(1, int((1.0 - RARE_SHARE) * len(jacobian)))]
    loud: Mask = np.linalg.norm(common, axis=0) >= SILENT
    return loud


def calibrate(predictor: Predictor, sensitivity: Sensitivity, use: Mask) -> Calibration:
    """Fit the nominal parameters to the samples ``use``."""
    space = sensitivity.space
    fit = fit_space(
        predictor,
        space,
        np.zeros(space.size),
        use,
        jacobian=sensitivity.jacobian,
        refresh=[],
        iterations=BROYDEN_ITERATIONS,
    )
    return Calibration(refine(predictor, fit, use), sensitivity.nominal, sensitivity.silent)


def refine(predictor: Predictor, fit: Fit, use: Mask) -> Fit:
    """Continue a fit from a Jacobian that is computed anew where it stands."""
    jacobian = compute_jacobian(predictor, fit.space, fit.z, list(range(fit.space.size)))
    return fit_space(predictor, fit.space, fit.z, use, jacobian=jacobian, refresh=[], iterations=PRECISE_ITERATIONS)


def approach_samples(predictor: Predictor, measurement: Measurement, fit: Fit) -> Array:
    """Return the prediction [channel's unit] of the recalibrated model that comes nearest to all samples, (n,).

    Correlated noise makes a fit care for changes more than for levels, which it may leave far off. A map shows how far
    off each sample is, so it must not show more of that than the nominal parameters can mend.

    Args:
        predictor: Simulations.
        measurement: The samples as the map is to show them.
        fit: The recalibrated model, fitted to the predictor's measurement.
    """
    fitted = predictor.measurement
    predictor.measurement = measurement.as_independent()
    try:
        jacobian = predictor.measurement.whiten(fitted.restore(fit.jacobian))
        return fit_space(predictor, fit.space, fit.z, None, jacobian, [], MAP_ITERATIONS).prediction
    finally:
        predictor.measurement = fitted
