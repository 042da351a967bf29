"""Before an effect is named: would a tendon drive that stops short explain the measurements better?

Commands are taken as they were given. The pressure has a gauge and growth a length of its own, but how far the tendon's
drive really goes, nothing on a bench measures; and a drive that stops short stops the bending much as a notch that
closes does. It is nothing that the robot's model lacks, so it gets no name: it only takes one away.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.candidates import Candidate
from evergym.discrepancy.data.columns import COMMANDS
from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.fit import Fit, evaluate_fit
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.residual import Measurement
from evergym.discrepancy.screen import rank_candidates, screen_candidates
from evergym.discrepancy.select import Score, Split, fit_candidates
from evergym.discrepancy.space import PULL_LIMIT, Axis
from evergym.discrepancy.verdict import Thresholds

__all__ = ["DOUBTED_CONFIDENCE", "fit_short_drive", "is_as_good", "is_better", "remark_drive"]

Mask = NDArray[np.bool_]

DOUBTED_CONFIDENCE = 0.5
"""Greatest confidence in a name if such a drive does about as well (prior)."""
PULL = COMMANDS.index("tendon_pull_mm")
SCALE = 0.25
"""One unit of the unknown, as a share of the largest pull in the runs."""
LEAST = 0.05
"""Least limit that is tried, as such a share."""


def fit_short_drive(
    predictor: Predictor, base: Score, reference: Fit, measurement: Measurement, split: Split
) -> Score | None:
    """Return the model whose tendon drive stops short, or None where that would not show.

    Args:
        predictor: Simulations.
        base: The recalibrated model.
        reference: The model as given, whitened by
        measurement: this measurement.
        split: Samples that choose.
    """
    candidate = _make_candidate(predictor.dataset.runs)
    if candidate is None:
        return None
    jacobian = predictor.measurement.whiten(measurement.restore(reference.jacobian))
    nominal = evaluate_fit(predictor, reference.space, reference.z, jacobian)
    screenings = screen_candidates(predictor, nominal, [candidate], split.use)
    signatures = rank_candidates(predictor, nominal, screenings, split.use)
    scores = fit_candidates(predictor, base, signatures, split, 1)
    return scores[0] if scores else None


def is_better(short: Score, chosen: Score, thresholds: Thresholds) -> bool:
    """Return whether a drive that stops short predicts left-out experiments better than what would be named."""
    return 0.5 * (chosen.validation.total - short.validation.total) >= thresholds.gain_min


def is_as_good(short: Score, chosen: Score, thresholds: Thresholds) -> bool:
    """Return whether a drive that stops short predicts them about as well."""
    return 0.5 * (short.validation.total - chosen.validation.total) < thresholds.gain_min


def remark_drive(short: Score, chosen: Score, thresholds: Thresholds) -> list[str]:
    """Return that the drive may not do as it is told, if that explains as much as what was chosen."""
    if not is_as_good(short, chosen, thresholds):
        return []
    limit = short.fit.space.axes[-1].value(float(short.fit.z[-1]))
    how = "better than" if is_better(short, chosen, thresholds) else "as well as"
    stops = f"a tendon drive that stops at {limit:.3g} mm, whatever it is told, explains these runs {how} {chosen.name}"
    return [f"{stops}: measure how far the drive goes before believing a name"]


def _make_candidate(runs: tuple[Run, ...]) -> Candidate | None:
    """Return a limit of the pull as an unknown: z = 0 is the largest pull in the runs, which limits nothing."""
    most = max(float(np.max(run.commands[:, PULL])) for run in runs)
    if most <= 0.0:
        return None
    axis = Axis(PULL_LIMIT, most, -SCALE * most, LEAST * most, most, tolerance=30.0, step=0.1)
    return Candidate("short drive", (axis,), {}, ((2.0,), (1.0,), (0.4,)), (), (PULL_LIMIT,), signed=False, strong=2)
