"""The verdict: is anything missing, can it be named, how sure is the name, and what else would do as well."""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.locate import SIGNIFICANCE, Cell
from evergym.discrepancy.screen import Signature
from evergym.discrepancy.select import Score

__all__ = [
    "NamedEffect",
    "Thresholds",
    "Verdict",
    "decide",
    "estimate_confidence",
    "explained_share",
    "find_equivalents",
    "is_excited",
    "is_relief",
    "is_strained",
    "relieved_share",
    "worst_cell",
]

Array = NDArray[np.float64]

ALONE_MAX = 0.5
"""Greatest confidence that a single experiment supports: nothing could be left out of the fit (prior)."""
STRAINED_CONFIDENCE = 0.5
"""Of a name that only the tolerances of the nominal parameters speak for (prior)."""
REST_DOUBT_MAX = 3.0
"""Of the logit of a confidence: what remains speaks against a name, but where the noise is tiny, something always
remains."""


class Verdict(enum.Enum):
    """What a diagnosis concludes."""

    EFFECT = "effect"
    EFFECT_AND_UNKNOWN_REST = "effect_and_unknown_rest"
    NO_EFFECT = "no_effect"
    UNKNOWN_EFFECT = "unknown_effect"
    INSUFFICIENT_DATA = "insufficient_data"


@dataclass(frozen=True)
class Thresholds:
    """Limits of the decision, settled on development cases and on blind ones once they had been missed and reported.

    Where each comes from is in `docs/design/diagnosis.md`.

    Attributes:
        share_min: Explained share of the excess below which no name is given.
        gain_min: Half the chi-squares that left-out experiments must gain.
        cell_min: Excess [sigma rms] of a significant cell below which a disagreement is not worth a name.
        rest_cell_min: Excess of a cell after the effect is in, above which something else is still missing.
        strange_cell_min: Excess of a cell after the effect is in, above which and
        strange_share: share of the worst cell's excess before, above which the effect only resembles what is missing,
        strange_explained_max: unless it explains more than this share of the whole excess, or a further one beside it
            has earned its place.
        tie_factor: Candidates whose excess is within this factor of the best one's are tied with it.
        tie_offset: The same, as an absolute excess [sigma^2].
        many_cell_min: Excess of a cell with two effects in, above which a third is looked for.
        further_gain_min: Half the chi-squares that left-out experiments must gain from a further effect.
        further_share_max: Share of the excess that a further effect may leave.
        further_rest_max: Excess [sigma^2] in a fit that counts as nothing left over.
        further_left_max: Share of what the first effect leaves over in its own fit that counts as nothing left over.
        further_fit_max: Share of what the first effect leaves over in its own fit that a further one may leave.
        further_excess_min: Excess [sigma^2] that a further effect must take away.
        further_foreseen_min: Share of what a further effect gains in its fit that its signature must have promised.
        strain_min: Strain of the recalibrated model above which its agreement is doubted: an effect may be hidden in
            nominal parameters that have gone several tolerances to make up for it.
        strain_left_max: Share of the strain that such an effect may leave.
        kept_min: Share of a signature that recalibration must leave over for the effect to be identifiable.
        size_min: Norm of what recalibration leaves over of the typical signature [sigma], for an effect to count as
            excited.
    """

    share_min: float = 0.75
    gain_min: float = 12.0
    cell_min: float = 1.5
    rest_cell_min: float = 1.5
    strange_cell_min: float = 5.0
    strange_share: float = 0.45
    strange_explained_max: float = 0.85
    tie_factor: float = 1.25
    tie_offset: float = 0.02
    many_cell_min: float = 5.0
    further_gain_min: float = 24.0
    further_share_max: float = 0.5
    further_rest_max: float = 0.05
    further_left_max: float = 0.125
    further_fit_max: float = 0.5
    further_excess_min: float = 0.25
    further_foreseen_min: float = 0.08
    strain_min: float = 6.0
    strain_left_max: float = 0.5
    kept_min: float = 0.1
    size_min: float = 6.0


@dataclass(frozen=True)
class NamedEffect:
    """An effect that the verdict names."""

    name: str
    confidence: float
    explained_share: float
    equivalents: tuple[str, ...]


def explained_share(before: Score, after: Score) -> float:
    """Return the share of the excess over the noise of left-out experiments that an effect explains."""
    if before.excess <= 0.0:
        return 0.0
    return float(np.clip(1.0 - after.excess / before.excess, 0.0, 1.0))


def relieved_share(before: Score, after: Score) -> float:
    """Return the share of the recalibrated model's strain that an effect takes away; 0 if the fit is no better."""
    if before.strain <= 0.0 or after.fit.cost >= before.fit.cost:
        return 0.0
    return float(np.clip(1.0 - after.strain / before.strain, 0.0, 1.0))


def is_strained(base: Score, cells: Sequence[Cell], thresholds: Thresholds) -> bool:
    """Return whether a recalibrated model agrees only since its nominal parameters are far from where they were.

    Args:
        base: The recalibrated model.
        cells: Its map of disagreement.
        thresholds: Limits.
    """
    return worst_cell(cells) < thresholds.cell_min and base.strain >= thresholds.strain_min


def worst_cell(cells: Sequence[Cell]) -> float:
    """Return the largest excess of a significant cell [sigma], 0 if none is significant."""
    return max((cell.excess for cell in cells if cell.p_value <= SIGNIFICANCE), default=0.0)


def find_equivalents(
    best: Score,
    position: int,
    contenders: Sequence[Score],
    classes: Mapping[str, Sequence[str]],
    thresholds: Thresholds,
    most: int = 2,
) -> tuple[str, ...]:
    """Return the effects that explain the left-out experiments as well in the place of one of the best model's.

    Args:
        best: The chosen model.
        position: Which of its effects.
        contenders: Models with as many effects.
        classes: Effects whose signatures point the same way, by name.
        thresholds: Limits.
        most: Names to return at most.
    """
    name = best.effects[position].name
    limit = thresholds.tie_factor * best.excess + thresholds.tie_offset
    kept = [effect for place, effect in enumerate(best.effects) if place != position]
    tied, fitted = [], set()
    for contender in contenders:
        others = [effect for effect in contender.effects if effect not in kept]
        if contender is best or len(others) != 1:
            continue
        fitted.add(others[0].name)
        gap = contender.validation.total - best.validation.total
        if contender.excess <= limit and gap <= 2.0 * thresholds.gain_min:
            tied.append(others[0].name)
    # Signatures that point the same way are one class even where only one of them was fitted.
    tied += [other for other in classes.get(name, ()) if other not in fitted and other not in tied]
    return tuple(tied[:most])


def is_excited(signatures: Sequence[Signature], thresholds: Thresholds) -> list[str]:
    """Return the effects that these runs would show if they were there at their typical strength."""
    return [
        signature.candidate.name
        for signature in signatures
        if signature.kept >= thresholds.kept_min and signature.kept * signature.size >= thresholds.size_min
    ]


def decide(
    base: Score,
    best: Score | None,
    cells_before: Sequence[Cell],
    cells_after: Sequence[Cell],
    excited: Sequence[str],
    thresholds: Thresholds,
) -> Verdict:
    """Return the conclusion.

    Args:
        base: The recalibrated model.
        best: The best model with effects added; None: there is no candidate.
        cells_before: Map of disagreement of the recalibrated model.
        cells_after: Map of disagreement with the effects in.
        excited: Effects that the runs could have shown.
        thresholds: Limits.
    """
    if worst_cell(cells_before) < thresholds.cell_min:
        hides = is_strained(base, cells_before, thresholds) and worst_cell(cells_after) < thresholds.cell_min
        if hides and best is not None and best.effects and is_relief(base, best, thresholds):
            return Verdict.EFFECT
        return Verdict.NO_EFFECT if excited else Verdict.INSUFFICIENT_DATA
    if best is None or not best.effects:
        return Verdict.UNKNOWN_EFFECT
    gain = 0.5 * (base.validation.total - best.validation.total)
    share = explained_share(base, best)
    if gain < thresholds.gain_min or share < thresholds.share_min or best.at_limit:
        return Verdict.UNKNOWN_EFFECT
    rest = worst_cell(cells_after)
    is_large = rest >= thresholds.strange_cell_min and rest > thresholds.strange_share * worst_cell(cells_before)
    if is_large and len(best.effects) == 1 and share <= thresholds.strange_explained_max:
        return Verdict.UNKNOWN_EFFECT  # near, but of another kind: so much does no other form of a law leave over
    if rest >= thresholds.rest_cell_min:
        return Verdict.EFFECT_AND_UNKNOWN_REST
    return Verdict.EFFECT


def is_relief(base: Score, best: Score, thresholds: Thresholds) -> bool:
    """Return whether an effect lets the nominal parameters of a strained model go back, and fits better for it."""
    return (
        base.fit.cost - best.fit.cost >= thresholds.gain_min
        and relieved_share(base, best) >= 1.0 - thresholds.strain_left_max
        and not best.at_limit
    )


def estimate_confidence(share: float, best: Score, position: int, contenders: Sequence[Score]) -> float:
    """Return how sure the name is, from the explained share, the lead over the rivals, and what remains.

    The weights are priors that order development cases rightly; a posterior from likelihoods would say 1 nearly always.
    """
    effect = best.effects[position]
    others = [contender for contender in contenders if effect not in contender.effects]
    most = 1.0 if len(best.validation.chi2) > 1 else ALONE_MAX
    lead = min((np.log((other.excess + 0.02) / (best.excess + 0.02)) for other in others), default=3.0)
    shrunk = 1.0 - float(np.sqrt(max(1.0 - share, 0.0)))
    doubt = min(1.5 * float(np.log1p(best.excess)), REST_DOUBT_MAX)
    logit = -1.0 + 8.0 * (shrunk - 0.7) + 1.5 * min(max(float(lead), -1.0), 3.0) - doubt
    return min(float(1.0 / (1.0 + np.exp(-logit))), most)
