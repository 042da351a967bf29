"""Fit the most promising candidates with the nominal parameters free, and score them on experiments left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.calibrate import refine
from evergym.discrepancy.candidates import Candidate
from evergym.discrepancy.cross_validate import CrossValidation, cross_validate
from evergym.discrepancy.fit import Fit, fit_space
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.screen import Signature, search_strength

__all__ = ["Score", "Split", "fit_candidates", "score_fit"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ITERATIONS = 5
REFINE_FACTOR = 3.0
"""Candidates within this factor of the best one's excess get a Jacobian of their own before they are scored."""
REFINED_MAX = 3


@dataclass(frozen=True)
class Split:
    """Which samples choose and fit, and which only judge.

    Attributes:
        use: Samples that choose and fit, (n,).
        folds: Experiments among them, left out in turn.
        held_out: Experiments that only judge.
    """

    use: Mask
    folds: tuple[int, ...]
    held_out: tuple[int, ...]


@dataclass(frozen=True)
class Score:
    """A fitted model and how well it predicts experiments that it was not fitted to.

    Attributes:
        effects: The candidates in it; none for the recalibrated model.
        fit: Their fit, nominal parameters included.
        validation: Leave-one-experiment-out.
        excess: Mean square of the left-out residuals [sigma^2], less the noise; not negative.
        signature: Of the last effect; None for the recalibrated model.
    """

    effects: tuple[Candidate, ...]
    fit: Fit
    validation: CrossValidation
    excess: float
    signature: Signature | None = None

    @property
    def name(self) -> str:
        """Names of the effects, joined."""
        return " + ".join(effect.name for effect in self.effects) or "recalibrated model"


def score_fit(
    predictor: Predictor, fit: Fit, split: Split, effects: tuple[Candidate, ...], signature: Signature | None = None
) -> Score:
    """Cross-validate a fit."""
    nominals = fit.space.size - sum(effect.size for effect in effects)
    validation = cross_validate(fit, predictor.measurement.experiment, split.folds, split.use, nominals)
    scaled = predictor.measurement.scale(validation.residual)[split.use]
    excess = max(float(np.mean(scaled**2)) - 1.0, 0.0)
    return Score(effects, fit, validation, excess, signature)


def fit_candidates(
    predictor: Predictor, base: Score, signatures: Sequence[Signature], split: Split, count: int
) -> list[Score]:
    """Fit the first ``count`` candidates on top of ``base`` and return their scores, best first."""
    scores = []
    for signature in signatures[:count]:
        fit = _fit_candidate(predictor, base.fit, signature, split.use)
        effects = (*base.effects, signature.candidate)
        scores.append(score_fit(predictor, fit, split, effects, signature))
    scores.sort(key=lambda score: score.validation.total)
    refined: list[Score] = []
    for rank, score in enumerate(scores):
        if rank < REFINED_MAX and score.excess <= REFINE_FACTOR * scores[0].excess + 0.1:
            fit = refine(predictor, score.fit, split.use)
            score = score_fit(predictor, fit, split, score.effects, score.signature)
        refined.append(score)
    return sorted(refined, key=lambda score: score.validation.total)


def _fit_candidate(predictor: Predictor, base: Fit, signature: Signature, use: Mask) -> Fit:
    candidate = signature.candidate
    space = base.space.extend(candidate.axes, candidate.fixed)
    new = list(range(base.space.size, space.size))
    jacobian = np.concatenate((base.jacobian, np.zeros((len(base.residual), len(new)))), axis=1)
    start = np.concatenate((base.z, search_strength(predictor, base, signature, use)))
    return fit_space(predictor, space, start, use, jacobian=jacobian, refresh=new, iterations=ITERATIONS)
