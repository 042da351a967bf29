"""Compare with a finer simulation first: numerics must not pass for physics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.rig import Fidelity
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.setting import Setting

__all__ = ["NumericsCheck", "choose_fidelities", "measure_spread"]

Array = NDArray[np.float64]

ERROR_MAX = {Fidelity.FAST: 0.75, Fidelity.STANDARD: 1.5}
"""Largest rms difference from the finest simulation [sigma], in any channel, at which a run is given a fidelity. The
difference counts as an error with a known course, so it may be as large as the noise; the finest costs twenty times as
much as the fast one."""
SPREAD = 0.75
"""One standard deviation of what discretisation does to a sample, as a share of the largest difference between
fidelities. It does not fall steadily: where a stiff part ends within a section depends on where the sections lie."""


@dataclass(frozen=True)
class NumericsCheck:
    """How finely each run is simulated.

    Attributes:
        chosen: The coarsest fidelity that is fine enough, by run id.
        errors: Rms difference of it from the finest, in the worst channel [sigma], by run id.
        spread: What discretisation does to each sample, one standard deviation, signed [channel's unit], (n,).
    """

    chosen: Mapping[str, Fidelity]
    errors: Mapping[str, float]
    spread: Array


def choose_fidelities(predictor: Predictor, setting: Setting) -> NumericsCheck:
    """Give every run the coarsest fidelity whose prediction is that of the finest, to a fraction of the noise."""
    tried = _compare(predictor, setting)
    chosen, errors = {}, {}
    for index, run in enumerate(predictor.dataset.runs):
        fidelity, error = Fidelity.FINE, 0.0
        for candidate, difference in tried.items():
            worst = _worst(predictor, difference, index)
            if worst <= ERROR_MAX[candidate]:
                fidelity, error = candidate, worst
                break
        predictor.fidelities[index] = fidelity
        chosen[run.id], errors[run.id] = fidelity, error
    return NumericsCheck(chosen, errors, _find_spread(tried))


def measure_spread(predictor: Predictor, setting: Setting) -> Array:
    """Return what discretisation does to each sample, one standard deviation, signed [channel's unit], (n,).

    An effect may depend on the step as the model without it does not: a pressure that droops by the flow of growth,
    which depends on the pressure.
    """
    return _find_spread(_compare(predictor, setting))


def _compare(predictor: Predictor, setting: Setting) -> dict[Fidelity, Array]:
    """Return the differences of the coarser fidelities from the finest, (n,) each; infinite where only they fail."""
    finest = predictor.predict(setting, Fidelity.FINE)
    differences = {}
    for fidelity in (Fidelity.FAST, Fidelity.STANDARD):
        prediction = predictor.predict(setting, fidelity)
        # Where only the finest goes on, the coarser is no approximation of it.
        fails = np.isnan(prediction) & np.isfinite(finest)
        differences[fidelity] = np.where(fails, np.inf, prediction - finest)
    return differences


def _find_spread(differences: Mapping[Fidelity, Array]) -> Array:
    fast, standard = (np.where(np.isfinite(difference), difference, 0.0) for difference in differences.values())
    return SPREAD * np.where(np.abs(fast) >= np.abs(standard), fast, standard)


def _worst(predictor: Predictor, difference: Array, run: int) -> float:
    measurement = predictor.measurement
    mine = measurement.run == run
    scaled = np.where(np.isnan(difference), 0.0, difference) / measurement.sigma
    squares = [np.mean(scaled[mine & (measurement.channel == c)] ** 2) for c in set(measurement.channel[mine].tolist())]
    return float(np.sqrt(max(squares, default=0.0)))
