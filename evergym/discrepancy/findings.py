"""What the stages found, in the form that the result and the report show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from evergym.discrepancy.candidates import ROUNDING_ERROR, Candidate
from evergym.discrepancy.choose import Choice
from evergym.discrepancy.diagnosis import CandidateRow
from evergym.discrepancy.interval import Interval, estimate_intervals
from evergym.discrepancy.screen import Signature
from evergym.discrepancy.select import Score
from evergym.discrepancy.verdict import (
    STRAINED_CONFIDENCE,
    NamedEffect,
    Thresholds,
    estimate_confidence,
    explained_share,
    find_equivalents,
    relieved_share,
)

__all__ = ["describe_effects", "list_candidates"]


def describe_effects(
    base: Score, choice: Choice, final: Score, classes: Mapping[str, Sequence[str]], thresholds: Thresholds
) -> tuple[tuple[NamedEffect, ...], dict[str, list[Interval]]]:
    """Return the effects of the chosen model with confidence, share and equivalents, and their parameters."""
    names: list[NamedEffect] = []
    parameters: dict[str, list[Interval]] = {}
    chosen = choice.best
    measure = relieved_share if choice.by_strain else explained_share
    share = measure(base, chosen)
    for position, effect in enumerate(chosen.effects):
        alone = next((rival for rival in choice.rivals if rival.effects == (effect,)), None)
        own = share if len(chosen.effects) == 1 or alone is None else measure(base, alone)
        equivalents = find_equivalents(chosen, position, choice.contenders, classes, thresholds)
        confidence = estimate_confidence(share, chosen, position, choice.contenders)
        if choice.by_strain:
            confidence = STRAINED_CONFIDENCE
        names.append(NamedEffect(effect.name, confidence, own, equivalents))
        paths = {axis.path for axis in effect.axes}
        first = min((i for i, axis in enumerate(final.fit.space.axes) if axis.path in paths), default=None)
        fineness = ROUNDING_ERROR if effect.rounds else 0.0
        intervals = [] if first is None else estimate_intervals(final.fit, final.validation, first, fineness)
        parameters[effect.name] = [interval for interval in intervals if interval.path in paths]
    return tuple(names), parameters


def list_candidates(
    base: Score,
    candidates: Sequence[Candidate],
    signatures: Sequence[Signature],
    choice: Choice,
    excited: Sequence[str],
) -> list[CandidateRow]:
    """Return what became of every candidate, the best first."""
    measure = relieved_share if choice.by_strain else explained_share
    fitted = {rival.effects[0].name: rival for rival in choice.rivals}
    seen = {signature.candidate.name: signature for signature in signatures}
    rows = []
    for candidate in candidates:
        signature, rival = seen.get(candidate.name), fitted.get(candidate.name)
        size, kept = (signature.size, signature.kept) if signature else (0.0, 0.0)
        share, values = None, {}
        if rival is not None:
            share = measure(base, rival)
            paths = {axis.path for axis in candidate.axes}
            found = rival.fit.space.values(rival.fit.z)
            values = {path.rpartition(".")[2]: float(found[path]) for path in paths}  # type: ignore[arg-type]
        status = "fitted" if rival else ("screened out" if candidate.name in excited else "not excited")
        rows.append(CandidateRow(candidate.name, status, size, kept, share, values))
    return sorted(rows, key=lambda row: (-(row.explained_share or 0.0), row.status, -row.size))
