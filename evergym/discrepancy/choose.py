"""Choose the effects: the best one, and further ones only where each earns its place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.calibrate import refine
from evergym.discrepancy.fit import Fit, evaluate_fit, fit_space
from evergym.discrepancy.locate import Cell, select_significant
from evergym.discrepancy.numerics_check import measure_spread
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.residual import Measurement
from evergym.discrepancy.screen import Screening, Signature, rank_candidates
from evergym.discrepancy.select import Score, Split, extend_score, fit_candidates, rank_score, score_fit
from evergym.discrepancy.verdict import Thresholds, is_relief, is_strained, worst_cell

__all__ = ["Choice", "choose_effects", "earns_its_place"]

Array = NDArray[np.float64]

FITTED_MAX = 5
"""Candidates that are fitted in the loop."""
FURTHER_MAX = 3
"""The same, for a further effect."""
EFFECTS_MAX = 3
"""Effects in a model at most: beyond that, each explains what the others leave, and none is known."""
GAIN_MIN = 1.0
"""Signatures that promise less (in half chi-squares) are not fitted."""

FIRSTS_MAX = 2
"""First effects beside which a further one is looked for: the second one, where it does as well alone."""
SWAPPED_MAX = 3
"""First effects that are tried in place of the best one, once there is a second."""

WIDER_MIN = 1.3
"""How many times as large some sample's sigma must be with what discretisation does to an effect, to look again."""
REFITTED_MAX = 2
"""Candidates that are fitted anew then."""
FORM_DOUBT_MAX = 0.2
"""How far off a right effect may be because its law has another form, as a share of what it changes. Prior."""

Mapper = Callable[[Score], list[Cell]]
"""Draws the map of disagreement of a fitted model, by the predictor's present measurement."""


@dataclass(frozen=True)
class Choice:
    """The chosen model, and what it was chosen from.

    Attributes:
        base: The recalibrated model.
        best: The model with no, one or several effects.
        rivals: Models with one effect, the best first.
        contenders: Models with as many effects as the best one.
        by_strain: Whether an effect can only be told by what it takes off the strain of the recalibrated model, which
            agrees, but with nominal parameters that are far from where they were.
    """

    base: Score
    best: Score
    rivals: tuple[Score, ...]
    contenders: tuple[Score, ...]
    by_strain: bool = False


def choose_effects(
    predictor: Predictor,
    base: Score,
    signatures: Sequence[Signature],
    screenings: Sequence[Screening],
    split: Split,
    thresholds: Thresholds,
    draw_map: Mapper,
) -> Choice:
    """Return the best model, with no, one or several effects, and what it was compared with.

    What discretisation does to an effect that is looked at is noise from then on, in the predictor's measurement.

    Args:
        predictor: Simulations.
        base: The recalibrated model.
        signatures: Of the candidates, the most promising first.
        screenings: The same before they were ranked.
        split: Samples that choose.
        thresholds: Limits.
        draw_map: To see what a model leaves over.
    """
    rivals = _fit_promising(predictor, base, signatures, split, FITTED_MAX)
    if not rivals:
        return Choice(base, base, (), ())
    led = _recalibrate_from(predictor, base, rivals, split, thresholds)
    if led is not base:
        base, split, rivals = _score_anew(predictor, led, rivals, split, draw_map)
    cells = draw_map(base)
    if worst_cell(cells) < thresholds.cell_min:
        if not is_strained(base, cells, thresholds):
            return Choice(base, base, (), ())
        fitted = sorted(rivals, key=_rank_cost)
        tied = [one for one in fitted if is_relief(base, one, thresholds) and _is_near_cost(one, fitted[0], thresholds)]
        return Choice(base, fitted[0], tuple(fitted), tuple(tied), by_strain=True)
    screened = predictor.measurement
    if worst_cell(draw_map(rivals[0])) >= thresholds.rest_cell_min:
        base, rivals = _recheck_numerics(predictor, base, rivals, split)
    best, contenders = rivals[0], rivals
    search = _Search(predictor, base, screenings, screened, split, thresholds, draw_map)
    for _ in range(FIRSTS_MAX):
        if worst_cell(draw_map(best)) < thresholds.rest_cell_min:
            break
        pair = search.find_further(best, thresholds.rest_cell_min)
        if pair is None:
            break
        contenders = sorted([pair, *_swap_first(predictor, base, pair, rivals, split)], key=rank_score)
        best = contenders[0]
        alone = _drop_first(predictor, base, best, split)
        if _predicts_better(alone, best, thresholds):
            break
        rivals = [alone, *(rival for rival in rivals if rival.effects != alone.effects)]
        if worst_cell(draw_map(alone)) >= thresholds.rest_cell_min:
            base, rivals = _recheck_numerics(predictor, base, rivals, split)
            search = replace(search, base=base)
        best, contenders = next(rival for rival in rivals if rival.effects == alone.effects), rivals
    while 1 < len(best.effects) < EFFECTS_MAX:
        more = search.find_further(best, thresholds.many_cell_min)
        if more is None:
            break
        best, contenders = more, [more]
    return Choice(base, best, tuple(rivals), tuple(contenders))


def _rank_cost(score: Score) -> float:
    return score.fit.cost


def _is_near_cost(score: Score, best: Score, thresholds: Thresholds) -> bool:
    return score.fit.cost - best.fit.cost < thresholds.gain_min


def _recalibrate_from(
    predictor: Predictor, base: Score, rivals: Sequence[Score], split: Split, thresholds: Thresholds
) -> Score:
    """Return the recalibrated model, fitted anew from where a rival has left the nominal parameters if that is better.

    Where growth stalls, a fit may end in a valley that an effect of hardly any strength leads out of. What is gained by
    having been led there is not that effect's. Tried are the rivals that predict and that fit best.
    """
    size = base.fit.space.size
    fits = []
    for rival in dict.fromkeys((0, min(range(len(rivals)), key=lambda i: rivals[i].fit.cost))):
        start, jacobian = rivals[rival].fit.z[:size], rivals[rival].fit.jacobian[:, :size]
        fits.append(fit_space(predictor, base.fit.space, start, split.use, jacobian, []))
    fit = min(fits, key=lambda fit: fit.cost)
    if fit.cost > base.fit.cost - thresholds.gain_min:
        return base
    return score_fit(predictor, refine(predictor, fit, split.use), split)


def _score_anew(
    predictor: Predictor, base: Score, rivals: Sequence[Score], split: Split, draw_map: Mapper
) -> tuple[Score, Split, list[Score]]:
    """Return all scores, and the split, as they are with another recalibrated model: it decides what matters."""
    focus = select_significant(predictor.dataset, predictor.measurement, draw_map(base))
    split = replace(split, focus=focus if focus.any() else None)
    base = score_fit(predictor, base.fit, split)
    scores = [score_fit(predictor, one.fit, split, one.effects, one.signature, base) for one in rivals]
    return base, split, sorted(scores, key=rank_score)


def _recheck_numerics(
    predictor: Predictor, base: Score, rivals: Sequence[Score], split: Split
) -> tuple[Score, list[Score]]:
    """Count what discretisation does to the best model as noise, too, and return all scores as they are then."""
    before = predictor.measurement
    best = rivals[0].fit
    after = before.widen(measure_spread(predictor, best.space.setting(best.z)))
    if float(np.max(after.sigma / before.sigma, initial=1.0)) < WIDER_MIN:
        return base, list(rivals)
    predictor.measurement = after
    base = score_fit(predictor, _rewhiten(predictor, base.fit, before, split), split)
    scores = []
    for rank, rival in enumerate(rivals):
        fit = _rewhiten(predictor, rival.fit, before, split)
        if rank < REFITTED_MAX:
            fit = refine(predictor, fit, split.use)
        scores.append(score_fit(predictor, fit, split, rival.effects, rival.signature, base))
    return base, sorted(scores, key=rank_score)


@dataclass(frozen=True)
class _Search:
    """What a search for further effects needs to know.

    Attributes:
        base: The recalibrated model.
        screenings: Of all candidates, made with
        screened: this measurement.
    """

    predictor: Predictor
    base: Score
    screenings: Sequence[Screening]
    screened: Measurement
    split: Split
    thresholds: Thresholds
    draw_map: Mapper

    def find_further(self, known: Score, cell_min: float) -> Score | None:
        """Return the model with one more effect that earns its place, or None.

        What the known effects change is taken to be uncertain by a share of itself: where a law has another form, what
        it leaves over is no further effect, and must not hide one that acts elsewhere.

        Args:
            known: The model so far.
            cell_min: Excess of a cell [sigma] below which nothing more is looked for.
        """
        predictor, split = self.predictor, self.split
        plain = predictor.measurement
        change = _find_change(predictor, self.base, known)
        doubtful = plain.add_doubt(_judge_form(predictor, known, change, split) * np.abs(change))
        predictor.measurement = doubtful
        try:
            fit = _rewhiten(predictor, known.fit, plain, split)
            linear = score_fit(predictor, fit, split, known.effects)
            before = score_fit(predictor, fit, split, known.effects, base=linear)
            if worst_cell(self.draw_map(before)) < cell_min:
                return None
            # As the first one, further effects are searched with the nominals as given: fitted ones make up for their
            # absence.
            space = before.fit.space
            effects = np.arange(space.size) >= self.base.fit.space.size
            reference = evaluate_fit(predictor, space, np.where(effects, fit.z, 0.0), fit.jacobian)
            others = self._rewhiten_screenings(known, doubtful)
            further = rank_candidates(predictor, reference, others, split.use, fit)
            scores = _fit_promising(predictor, before, further, split, FURTHER_MAX)
            if not scores or not earns_its_place(before, scores[0], split, self.thresholds):
                return None
        finally:
            predictor.measurement = plain
        fit = refine(predictor, _rewhiten(predictor, scores[0].fit, doubtful, split), split.use)
        return score_fit(predictor, fit, split, scores[0].effects, scores[0].signature, known)

    def _rewhiten_screenings(self, known: Score, measurement: Measurement) -> list[Screening]:
        restore, whiten = self.screened.restore, measurement.whiten
        return [
            replace(one, columns=tuple((z, whiten(restore(column))) for z, column in one.columns))
            for one in self.screenings
            if one.candidate not in known.effects
        ]


def _find_change(predictor: Predictor, base: Score, score: Score) -> Array:
    """Return what the effects of a model change [channel's unit], (n,), its nominal parameters as they are."""
    space = base.fit.space
    change = score.fit.prediction - predictor.predict(space.setting(score.fit.z[: space.size]))
    return np.where(np.isfinite(change), change, 0.0)


def _judge_form(predictor: Predictor, score: Score, change: Array, split: Split) -> float:
    """Return how far off the law of an effect may be, as a share of ``change`` (n,): what it leaves over where it acts.

    The median of the experiments is taken: in some of them something else may act as well.
    """
    changed, rest = predictor.measurement.whiten(change) ** 2, score.fit.residual**2
    shares = []
    for experiment in split.folds:
        rows = (predictor.measurement.experiment == experiment) & split.use
        count, acted = float(rows.sum()), float(np.sum(changed[rows]))
        if acted > count:
            shares.append(np.sqrt(max(float(np.sum(rest[rows])) - count, 0.0) / acted))
    return min(float(np.median(shares)), FORM_DOUBT_MAX) if shares else FORM_DOUBT_MAX


def _rewhiten(predictor: Predictor, fit: Fit, before: Measurement, split: Split) -> Fit:
    """Return a fit made with the measurement ``before`` as it is with the predictor's."""
    measurement = predictor.measurement
    residual = measurement.whiten(before.restore(fit.residual))
    jacobian = measurement.whiten(before.restore(fit.jacobian))
    cost = 0.5 * float(np.sum(residual[split.use] ** 2) + fit.space.prior_precision @ fit.z**2)
    return replace(fit, residual=residual, jacobian=jacobian, cost=cost)


def _swap_first(predictor: Predictor, base: Score, pair: Score, rivals: Sequence[Score], split: Split) -> list[Score]:
    """Return pairs with another first effect: the best one alone is not always one of the best two."""
    first, second = pair.effects
    others = [rival for rival in rivals if rival.effects[0] not in pair.effects and rival.excess < base.excess]
    size = base.fit.space.size
    strength = pair.fit.z[size + first.size :]
    return [extend_score(predictor, rival, second, strength, split) for rival in others[:SWAPPED_MAX]]


def _drop_first(predictor: Predictor, base: Score, pair: Score, split: Split) -> Score:
    """Return the second effect of a pair alone: the first may only have led to it."""
    second = pair.effects[1]
    strength = pair.fit.z[pair.fit.space.size - second.size :]
    return extend_score(predictor, base, second, strength, split, pair.signature)


def _predicts_better(before: Score, after: Score, thresholds: Thresholds) -> bool:
    """Return whether a model predicts left-out experiments better than one with an effect less, by what matters."""
    gain = 0.5 * (before.validation.total - after.validation.total)
    return gain >= thresholds.further_gain_min and before.excess - after.excess >= thresholds.further_excess_min


def earns_its_place(before: Score, after: Score, split: Split, thresholds: Thresholds) -> bool:
    """Return whether a further effect predicts left-out experiments better by an amount that matters.

    It must also fit the experiments that it was fitted to that much better: one that only steadies the strength of the
    first, by a free parameter more, is none. (One that leaves hardly anything over in its fit need not halve the rest
    of those left out: a law of another form has another strength in every experiment.) And what it gains must be in
    its signature: one that gains only with all nominal parameters moved is a shape that happens to fit. So is one whose
    strength is at the limit of its parameter.
    """
    noise = float(split.use.sum())
    fitted_before, fitted_after = (float(np.sum(one.fit.residual[split.use] ** 2)) - noise for one in (before, after))
    foreseen = after.signature.gain if after.signature is not None else 0.0
    halved = after.excess <= thresholds.further_share_max * before.excess
    return (
        _predicts_better(before, after, thresholds)
        and not after.at_limit
        and (
            halved
            or fitted_after <= max(thresholds.further_rest_max * noise, thresholds.further_left_max * fitted_before)
        )
        and fitted_after <= thresholds.further_fit_max * fitted_before
        and foreseen >= thresholds.further_foreseen_min * 0.5 * (fitted_before - fitted_after)
    )


def _fit_promising(
    predictor: Predictor, base: Score, signatures: Sequence[Signature], split: Split, count: int
) -> list[Score]:
    promising = [signature for signature in signatures if signature.gain > GAIN_MIN]
    return fit_candidates(predictor, base, promising, split, count)
