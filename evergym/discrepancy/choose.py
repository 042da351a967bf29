"""Choose the effects: the best one, and further ones only where each earns its place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from evergym.discrepancy.locate import Cell
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.screen import Screening, Signature, rank_candidates
from evergym.discrepancy.select import Score, Split, extend_score, fit_candidates, rank_score
from evergym.discrepancy.verdict import Thresholds, worst_cell

__all__ = ["Choice", "choose_effects"]

FITTED_MAX = 5
"""Candidates that are fitted in the loop."""
FURTHER_MAX = 3
"""The same, for a further effect."""
GAIN_MIN = 1.0
"""Signatures that promise less (in half chi-squares) are not fitted."""

SWAPPED_MAX = 3
"""First effects that are tried in place of the best one, once there is a second."""

Mapper = Callable[[Score], list[Cell]]
"""Draws the map of disagreement of a fitted model."""


@dataclass(frozen=True)
class Choice:
    """The chosen model, and what it was chosen from.

    Attributes:
        best: With no, one or several effects.
        rivals: Models with one effect, the best first.
        contenders: Models with as many effects as the best one.
    """

    best: Score
    rivals: tuple[Score, ...]
    contenders: tuple[Score, ...]


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
        return Choice(base, (), ())
    best, contenders = rivals[0], rivals
    if worst_cell(draw_map(best)) >= thresholds.rest_cell_min:
        others = [screening for screening in screenings if screening.candidate not in best.effects]
        further = rank_candidates(predictor, best.fit, others, split.use)
        pairs = _fit_promising(predictor, best, further, split, FURTHER_MAX)
        if pairs and earns_its_place(best, pairs[0], split, thresholds):
            contenders = sorted(pairs + _swap_first(predictor, base, pairs[0], rivals, split), key=rank_score)
            best = contenders[0]
    return Choice(best, tuple(rivals), tuple(contenders))


def _swap_first(predictor: Predictor, base: Score, pair: Score, rivals: Sequence[Score], split: Split) -> list[Score]:
    """Return pairs with another first effect: the best one alone is not always one of the best two."""
    first, second = pair.effects
    others = [rival for rival in rivals if rival.effects[0] not in pair.effects and rival.excess < base.excess]
    size = base.fit.space.size
    strength = pair.fit.z[size + first.size :]
    return [extend_score(predictor, rival, second, strength, split) for rival in others[:SWAPPED_MAX]]


def earns_its_place(before: Score, after: Score, split: Split, thresholds: Thresholds) -> bool:
    """Return whether a further effect predicts left-out experiments better by an amount that matters.

    It must also fit the experiments that it was fitted to that much better: one that only steadies the strength of the
    first, by a free parameter more, is none.
    """
    gain = 0.5 * (before.validation.total - after.validation.total)
    noise = float(split.use.sum())
    fitted_before, fitted_after = (float(np.sum(one.fit.residual[split.use] ** 2)) - noise for one in (before, after))
    return (
        gain >= thresholds.further_gain_min
        and after.excess <= thresholds.further_share_max * before.excess
        and before.excess - after.excess >= thresholds.further_excess_min
        and fitted_after <= thresholds.further_fit_max * fitted_before
    )


def _fit_promising(
    predictor: Predictor, base: Score, signatures: Sequence[Signature], split: Split, count: int
) -> list[Score]:
    promising = [signature for signature in signatures if signature.gain > GAIN_MIN]
    return fit_candidates(predictor, base, promising, split, count)
