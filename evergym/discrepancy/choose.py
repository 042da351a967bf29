"""Choose the effects: the best one, and further ones only where each earns its place."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from evergym.discrepancy.locate import Cell
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.screen import Screening, Signature, rank_candidates
from evergym.discrepancy.select import Score, Split, fit_candidates
from evergym.discrepancy.verdict import Thresholds, worst_cell

__all__ = ["choose_effects"]

FITTED_MAX = 5
"""Candidates that are fitted in the loop."""
FURTHER_MAX = 3
"""The same, for a further effect."""
EFFECTS_MAX = 2
"""Effects that are looked for at once."""
GAIN_MIN = 1.0
"""Signatures that promise less (in half chi-squares) are not fitted."""

Mapper = Callable[[Score], list[Cell]]
"""Draws the map of disagreement of a fitted model."""


def choose_effects(
    predictor: Predictor,
    base: Score,
    signatures: Sequence[Signature],
    screenings: Sequence[Screening],
    split: Split,
    thresholds: Thresholds,
    draw_map: Mapper,
) -> tuple[Score, list[Score]]:
    """Return the best model, with no, one or several effects, and all models with one, the best first."""
    rivals = _fit_promising(predictor, base, signatures, split, FITTED_MAX)
    if not rivals:
        return base, rivals
    best = rivals[0]
    for _ in range(1, EFFECTS_MAX):
        if worst_cell(draw_map(best)) < thresholds.rest_cell_min:
            break
        names = {effect.name for effect in best.effects}
        others = [screening for screening in screenings if screening.candidate.name not in names]
        further = rank_candidates(best.fit, others, split.use)
        pairs = _fit_promising(predictor, best, further, split, FURTHER_MAX)
        if not pairs or not earns_its_place(best, pairs[0], thresholds):
            break
        best = pairs[0]
    return best, rivals


def earns_its_place(before: Score, after: Score, thresholds: Thresholds) -> bool:
    """Return whether a further effect predicts left-out experiments better by an amount that matters."""
    gain = 0.5 * (before.validation.total - after.validation.total)
    return (
        gain >= thresholds.further_gain_min
        and after.excess <= thresholds.further_share_max * before.excess
        and before.excess - after.excess >= thresholds.further_excess_min
    )


def _fit_promising(
    predictor: Predictor, base: Score, signatures: Sequence[Signature], split: Split, count: int
) -> list[Score]:
    promising = [signature for signature in signatures if signature.gain > GAIN_MIN]
    return fit_candidates(predictor, base, promising, split, count)
