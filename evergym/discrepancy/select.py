"""Fit the most promising candidates with the nominal parameters free, and score them on experiments left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.calibrate import refine
from evergym.discrepancy.candidates import Candidate
from evergym.discrepancy.cross_validate import CrossValidation, cross_validate
from evergym.discrepancy.fit import Fit, fit_space, whitened_residual
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.screen import Signature, search_strengths

__all__ = ["Score", "Split", "extend_score", "fit_candidates", "rank_score", "score_fit"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FIRST_ITERATIONS, ITERATIONS = 2, 4
"""Steps of a fit before the race is judged, and after."""
RACE_FACTOR, REFINE_FACTOR = 8.0, 5.0
"""Candidates within these factors of the best one's excess are fitted to the end, and the first of them get a Jacobian
of their own before they are scored."""
LIMIT_SHARE = 1e-3
"""A strength this near to a limit of its parameter [z] is at it."""
REFINED_MAX = 3
FITTED_MIN, WORTH = 2, 0.12
"""Candidates whose signature takes less than this share of the best one's off the residual are not fitted, but for two:
a signature is near enough to the truth for that."""
CEILING = 1.5
"""An experiment left out counts at most this many times what it does without the effect."""
SPARE = 2
"""Candidates that are looked at beyond those to be fitted."""


@dataclass(frozen=True)
class Split:
    """Which samples choose and fit, and which only judge.

    Attributes:
        use: Samples that choose and fit, (n,).
        folds: Experiments among them, left out in turn.
        held_out: Experiments that only judge.
        focus: Samples where the recalibrated model is significantly off: the share that an effect explains is counted
            there, since a short transient would drown in all the samples that are as they should be; (n,). None: all.
    """

    use: Mask
    folds: tuple[int, ...]
    held_out: tuple[int, ...]
    focus: Mask | None = None


@dataclass(frozen=True)
class Score:
    """A fitted model and how well it predicts experiments that it was not fitted to.

    Attributes:
        effects: The candidates in it; none for the recalibrated model.
        fit: Their fit, nominal parameters included.
        validation: Leave-one-experiment-out.
        excess: Mean square of the left-out residuals in the focus [sigma^2], less the noise; not negative.
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

    @property
    def strain(self) -> float:
        """How far the nominal parameters are from their values as given: half the sum of squares, in tolerances."""
        count = self.fit.space.size - sum(effect.size for effect in self.effects)
        return 0.5 * float(self.fit.space.prior_precision[:count] @ self.fit.z[:count] ** 2)

    @property
    def at_limit(self) -> bool:
        """Whether a strength has gone as far as its parameter can: it stands in for something that goes farther."""
        low, high = self.fit.space.limits
        z = self.fit.z
        amplitudes = {path for effect in self.effects for path in effect.amplitudes}
        return any(
            axis.path in amplitudes and (0.0 < high[i] <= z[i] + LIMIT_SHARE or 0.0 > low[i] >= z[i] - LIMIT_SHARE)
            for i, axis in enumerate(self.fit.space.axes)
        )


def score_fit(
    predictor: Predictor,
    fit: Fit,
    split: Split,
    effects: tuple[Candidate, ...] = (),
    signature: Signature | None = None,
    base: Score | None = None,
) -> Score:
    """Cross-validate a fit.

    Args:
        predictor: Simulations.
        fit: The fit.
        split: Its folds.
        effects: The candidates in it.
        signature: Of the last of them.
        base: The model that it must be better than.
    """
    nominals = fit.space.size - sum(effect.size for effect in effects)

    def simulate(z: Array, samples: NDArray[np.int64]) -> Array:
        runs = sorted(set(predictor.measurement.run[samples].tolist()))
        prediction = predictor.predict_part(fit.space.setting(z), runs, fit.prediction)
        return whitened_residual(predictor.measurement, prediction)[samples]

    experiment = predictor.measurement.experiment
    ceiling = None
    if base is not None:
        counts = np.array([np.sum((experiment == fold) & split.use) for fold in split.folds])
        ceiling = CEILING * base.validation.chi2 + counts
    exact = simulate if base is not None else None
    rounding = [np.full(effect.size, effect.rounds) for effect in effects]
    steady = np.concatenate([np.zeros(nominals, dtype=bool), *rounding])
    validation = cross_validate(fit, experiment, split.folds, split.use, nominals, exact, ceiling, steady)
    counted = split.use if split.focus is None else split.use & split.focus
    scaled = predictor.measurement.scale(validation.residual)[counted]
    excess = max(float(np.mean(scaled**2)) - 1.0, 0.0)
    return Score(effects, fit, validation, excess, signature)


def fit_candidates(
    predictor: Predictor, base: Score, signatures: Sequence[Signature], split: Split, count: int
) -> list[Score]:
    """Fit the most promising candidates on top of ``base`` and return their scores, best first.

    Args:
        predictor: Simulations.
        base: The recalibrated model, or one with effects in already: what a candidate must be better than.
        signatures: Of the candidates, the most promising first.
        split: Samples that choose.
        count: Candidates to fit at most.
    """
    found = search_strengths(predictor, signatures[: count + SPARE], split.use)
    worth = [pair for rank, pair in enumerate(found) if rank < FITTED_MIN or pair[0].gain > WORTH * found[0][0].gain]
    fits = [
        (
            _begin_fit(predictor, signature.reference, signature.candidate, strength.z, split.use),
            replace(signature, gain=max(signature.gain, strength.gain)),
        )
        for strength, signature in worth[:count]
    ]
    # A race: who is far behind after the first steps stays as it is, but for the one whose signature promised most.
    favourite = worth[0][1].candidate if worth else None
    fits.sort(key=_cost)
    fits = [
        (_continue_fit(predictor, fit, signature.candidate, split.use), signature)
        if signature.candidate is favourite or _is_near(fit, fits[0][0], split.use, RACE_FACTOR)
        else (fit, signature)
        for fit, signature in fits
    ]
    fits.sort(key=_cost)
    fits = [
        (refine(predictor, fit, split.use), signature)
        if rank < REFINED_MAX and _is_near(fit, fits[0][0], split.use, REFINE_FACTOR)
        else (fit, signature)
        for rank, (fit, signature) in enumerate(fits)
    ]
    scores = [
        score_fit(predictor, fit, split, (*base.effects, signature.candidate), signature, base)
        for fit, signature in fits
    ]
    return sorted(scores, key=rank_score)


def extend_score(
    predictor: Predictor,
    score: Score,
    candidate: Candidate,
    strength: Array,
    split: Split,
    signature: Signature | None = None,
) -> Score:
    """Return the score of a fitted model with one more effect, fitted from a given strength z of it, (m,).

    Args:
        predictor: Simulations.
        score: The model without, perhaps the recalibrated one.
        candidate: The effect.
        strength: Where its fit begins.
        split: Samples that choose.
        signature: Of the candidate; None: that of the model without.
    """
    also = score.effects[-1].size if score.effects else 0
    fit = _begin_fit(predictor, score.fit, candidate, strength, split.use, also)
    fit = refine(predictor, fit, split.use)
    return score_fit(predictor, fit, split, (*score.effects, candidate), signature or score.signature, score)


def _cost(pair: tuple[Fit, Signature]) -> float:
    return pair[0].cost


def _is_near(fit: Fit, best: Fit, use: Mask, factor: float) -> bool:
    """Whether what a fit leaves over is within a factor of what the best one does, noise aside."""
    noise = float(use.sum())
    rest, least = (float(one.residual[use] @ one.residual[use]) - noise for one in (fit, best))
    return rest <= factor * max(least, 0.0) + 0.1 * noise


def rank_score(score: Score) -> float:
    """Return what scores are sorted by: how far off they are on experiments left out."""
    return score.validation.total


def _begin_fit(predictor: Predictor, base: Fit, candidate: Candidate, start: Array, use: Mask, also: int = 0) -> Fit:
    """Return a fit after its first steps; the candidate's columns and those of ``also`` unknowns before are renewed."""
    space = base.space.extend(candidate.axes, candidate.fixed)
    renewed = list(range(base.space.size - also, space.size))
    jacobian = np.concatenate((base.jacobian, np.zeros((len(base.residual), candidate.size))), axis=1)
    z = np.concatenate((base.z, start))
    return fit_space(predictor, space, z, use, jacobian=jacobian, refresh=renewed, iterations=FIRST_ITERATIONS)


def _continue_fit(predictor: Predictor, fit: Fit, candidate: Candidate, use: Mask) -> Fit:
    new = list(range(fit.space.size - candidate.size, fit.space.size))
    return fit_space(predictor, fit.space, fit.z, use, jacobian=fit.jacobian, refresh=new, iterations=ITERATIONS)
