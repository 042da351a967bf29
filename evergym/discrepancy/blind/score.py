"""Compare a diagnosis with the sealed truth: what each case counts for."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from evergym.discrepancy.blind.truth import Kind

__all__ = ["CaseScore", "compute_gap_ratio", "score_case"]

NAMING = ("effect", "effect_and_unknown_rest")
SET_MAX = 3
"""A reported set counts only up to this many names."""
CONFIDENT = 0.8
"""A name with at least this confidence is a confident one."""
TIED_SHARE = 0.9
"""Cells whose noise-free difference is at least this share of the largest are tied with the true cell."""
TOP_CELLS = 2


@dataclass(frozen=True)
class CaseScore:
    """One case: what was hidden, what was said, and what it counts for (None: it does not count there).

    Attributes:
        case: Number.
        kind: See `evergym.discrepancy.blind.truth.Kind`.
        truth: What was hidden.
        form: "library", "other", "outside" or "".
        detectable: Of all hidden parts.
        verdict: Of the diagnosis; "failed" if there is none, "refused" if the data were.
        named: Effects that the diagnosis names, in its order; empty if its verdict names none.
        confidence: Of the first name.
        top1: The hidden effect is named first.
        in_set: It is the first name or among that name's equivalents, at most three in all.
        set_size: Of that set.
        false_alarm: An effect is named where none is missing.
        abstained: The verdict is "unknown_effect" for an effect outside the library.
        confident_wrong: A wrong name is given with confidence.
        both: Both hidden effects are named.
        both_in_sets: The same, equivalents counted.
        extra: A name is given beyond the hidden effects and their ties.
        gap_before: Disagreement on held-out runs [sigma rms] after recalibration, as the diagnosis says.
        gap_after: The same with what was found.
        gap_ratio: Excess on held-out runs after over before, as the diagnosis says.
        gap_ratio_checked: The same distances, measured from the noise-free truth.
        covered: For every strength of library form, whether its 90 % interval holds the true value.
        located: The true cell is among the first two of the map.
        located_tied: The same, cells within 10 % of the true cell's difference counted.
        refused: Bad data are refused with a message that names the place, and nothing is written.
        seconds: Of the diagnosis.
        message: What went wrong, if anything.
    """

    case: int
    kind: str
    truth: tuple[str, ...]
    form: str
    detectable: bool | None
    verdict: str
    named: tuple[str, ...] = ()
    confidence: float | None = None
    top1: bool | None = None
    in_set: bool | None = None
    set_size: int | None = None
    false_alarm: bool | None = None
    abstained: bool | None = None
    confident_wrong: bool | None = None
    both: bool | None = None
    both_in_sets: bool | None = None
    extra: bool | None = None
    gap_before: float | None = None
    gap_after: float | None = None
    gap_ratio: float | None = None
    gap_ratio_checked: float | None = None
    covered: tuple[bool, ...] = ()
    located: bool | None = None
    located_tied: bool | None = None
    refused: bool | None = None
    seconds: float = math.nan
    message: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the score as plain values."""
        return {
            key: list(value) if isinstance(value, tuple) else value for key, value in dataclasses.asdict(self).items()
        }


def score_case(
    case: int,
    truth: Mapping[str, Any],
    outcome: Mapping[str, Any],
    diagnosis: Mapping[str, Any] | None,
    checked_ratio: float | None = None,
) -> CaseScore:
    """Score one case.

    Args:
        case: Its number.
        truth: Content of the sealed truth.json.
        outcome: Exit code, seconds, message and the names of the files that the diagnosis wrote.
        diagnosis: Content of diagnosis.json, or None.
        checked_ratio: What `evergym.discrepancy.blind.recheck` has found for the gap.
    """
    kind = Kind(truth["kind"])
    parts = truth["parts"]
    names = tuple(part["name"] for part in parts)
    forms = sorted({part["form"] for part in parts})
    detectable = all(part["detectable"] for part in truth["detections"]) if parts else None
    base = CaseScore(
        case=case,
        kind=kind.value,
        truth=(truth["fault"],) if truth["fault"] else names or tuple(truth["wrong"]),
        form="+".join(forms),
        detectable=detectable,
        verdict="failed" if diagnosis is None else str(diagnosis["verdict"]),
        seconds=float(outcome["seconds"]),
        message=str(outcome["message"]) if diagnosis is None else "",
    )
    if kind is Kind.FAULT:
        return _score_fault(base, truth, outcome, diagnosis)
    effects: Sequence[Mapping[str, Any]] = ()
    if diagnosis is not None and diagnosis["verdict"] in NAMING:
        effects = diagnosis["effects"]
    base = dataclasses.replace(
        base,
        named=tuple(effect["name"] for effect in effects),
        confidence=float(effects[0]["confidence"]) if effects else None,
    )
    if kind is Kind.NONE:
        return dataclasses.replace(base, false_alarm=bool(effects))
    if not detectable:
        return base
    base = _locate(base, truth, diagnosis)
    if kind is Kind.OUTSIDE:
        return dataclasses.replace(
            base,
            abstained=base.verdict == "unknown_effect",
            confident_wrong=any(float(effect["confidence"]) >= CONFIDENT for effect in effects),
        )
    base = dataclasses.replace(
        base,
        gap_before=diagnosis["gap"]["before"] if diagnosis is not None else None,
        gap_after=diagnosis["gap"]["after"] if diagnosis is not None else None,
        gap_ratio=compute_gap_ratio(diagnosis),
        gap_ratio_checked=checked_ratio,
        covered=_cover(parts, effects),
    )
    first = _set_of(effects[0]) if effects else ()
    extra = any(not set(_set_of(effect)) & set(names) for effect in effects)
    if kind is Kind.SINGLE:
        return dataclasses.replace(
            base,
            top1=base.named[:1] == names,
            in_set=names[0] in first and len(first) <= SET_MAX,
            set_size=len(first) if first else None,
            extra=extra if effects else None,
        )
    counted = [name for effect in effects for name in _set_of(effect)[:SET_MAX]]
    return dataclasses.replace(
        base, both=set(names) <= set(base.named), both_in_sets=set(names) <= set(counted), extra=extra
    )


def compute_gap_ratio(diagnosis: Mapping[str, Any] | None) -> float | None:
    """Return the excess over the noise on held-out runs, after over before; 1 without a diagnosis.

    None where the recalibrated model leaves nothing to explain, or nothing was held out.
    """
    if diagnosis is None:
        return 1.0
    before, after = diagnosis["gap"]["before"], diagnosis["gap"]["after"]
    if before is None or after is None or before <= 1.0:
        return None
    return math.sqrt(max(0.0, after**2 - 1.0)) / math.sqrt(before**2 - 1.0)


def _score_fault(
    base: CaseScore, truth: Mapping[str, Any], outcome: Mapping[str, Any], diagnosis: Mapping[str, Any] | None
) -> CaseScore:
    words: list[str] = truth["words"]
    if base.truth == ("add_impossible_rows",):
        # No fault of the format: the rows are set aside, and the diagnosis goes on.
        aside = {str(entry["row"]) for entry in diagnosis["rows_set_aside"]} if diagnosis is not None else set()
        return dataclasses.replace(base, refused=aside == set(words))
    message = str(outcome["message"])
    clean = outcome["exit"] == 1 and not outcome["written"] and "Traceback" not in message
    return dataclasses.replace(base, verdict="refused", refused=clean and all(word in message for word in words))


def _set_of(effect: Mapping[str, Any]) -> tuple[str, ...]:
    return (effect["name"], *(name for name in effect["equivalents"] if name != effect["name"]))


def _cover(parts: Sequence[Mapping[str, Any]], effects: Sequence[Mapping[str, Any]]) -> tuple[bool, ...]:
    """Return whether the intervals hold the true strengths, where all that is hidden has the library's form."""
    if any(part["form"] != "library" for part in parts):
        return ()
    covered = []
    for part in parts:
        for effect in effects:
            if effect["name"] != part["name"]:
                continue
            for key, interval in effect["parameters"].items():
                true = part["values"].get(key)
                if isinstance(true, bool) or true is None or true == 0.0 or interval.get("low_90") is None:
                    continue
                covered.append(bool(interval["low_90"] <= true <= interval["high_90"]))
    return tuple(covered)


def _locate(base: CaseScore, truth: Mapping[str, Any], diagnosis: Mapping[str, Any] | None) -> CaseScore:
    cells = [(cell["channel"], cell["regime"], cell["sigmas"]) for cell in truth["cells"]]
    if not cells:
        return base
    where = diagnosis["where"][:TOP_CELLS] if diagnosis is not None else []
    shown = {(cell["channel"], cell["regime"]) for cell in where}
    tied = {cell[:2] for cell in cells if cell[2] >= TIED_SHARE * cells[0][2]}
    return dataclasses.replace(base, located=cells[0][:2] in shown, located_tied=bool(tied & shown))
