"""A diagnosis in sentences that need no statistics to read."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from evergym.discrepancy.diagnosis import Diagnosis
from evergym.discrepancy.locate import SIGNIFICANCE, Cell
from evergym.discrepancy.regimes import REGIMES
from evergym.discrepancy.verdict import Verdict, worst_cell
from evergym.effects.catalogue import EFFECTS

__all__ = [
    "describe_channel",
    "describe_confidence",
    "describe_effect",
    "describe_gap",
    "describe_verdict",
    "describe_where",
]

_CHANNELS = {
    "tip_x_mm": "the tip's x",
    "tip_y_mm": "the tip's y",
    "tip_z_mm": "the tip's z",
    "everted_length_mm": "the everted length",
    "growth_speed_mm_s": "the growth speed",
    "curvature_1_per_m": "the curvature",
    "tip_angle_deg": "the tip's angle",
    "bending_angle_deg": "the bending angle",
    "pressure_measured_kpa": "the measured pressure",
}


def describe_channel(name: str) -> str:
    """Return a channel's name as people say it."""
    return _CHANNELS.get(name, name)


def describe_verdict(diagnosis: Diagnosis) -> str:
    """Return the conclusion in one or two sentences."""
    names = " and ".join(f"{effect.name}{_or_equivalents(effect.equivalents)}" for effect in diagnosis.effects)
    plural = "effects are" if len(diagnosis.effects) > 1 else "effect is"
    match diagnosis.verdict:
        case Verdict.EFFECT if diagnosis.by_strain:
            return (
                f"The model may lack {names}. Recalibrated without it, it agrees with the measurements, too, but only "
                "with nominal parameters that are far from where they should be."
            )
        case Verdict.EFFECT:
            added = "them" if len(diagnosis.effects) > 1 else "it"
            close = _how_well(diagnosis.where_after)
            return f"The model lacks {names}. With {added}, model and measurements agree {close}."
        case Verdict.EFFECT_AND_UNKNOWN_REST:
            return (
                f"The model lacks {names}. Once the {plural} in, a smaller disagreement remains that no effect of the "
                "catalogue explains."
            )
        case Verdict.NO_EFFECT:
            close = _how_well(diagnosis.where)
            return f"Nothing is missing that these runs could show: the recalibrated model agrees with them {close}."
        case Verdict.UNKNOWN_EFFECT:
            return (
                "Something is missing, and no effect of the catalogue explains it: the measurements disagree with "
                "every model that was tried. No name is given."
            )
        case Verdict.INSUFFICIENT_DATA:
            return "These runs excite nothing that could tell: no effect of the catalogue would show in them."


def describe_effect(name: str) -> str:
    """Return what an effect of the catalogue is, in a sentence; nothing for one of the user's own."""
    if name not in EFFECTS:
        return ""
    text = sys.modules[EFFECTS[name].__module__].__doc__ or ""
    return text.strip().splitlines()[0].partition(": ")[2]


def describe_confidence(confidence: float) -> str:
    """Return how sure a name is: never quite."""
    return "more than 99 %" if confidence > 0.99 else f"{100 * confidence:.0f} %"


def describe_where(diagnosis: Diagnosis) -> str:
    """Return where model and measurements disagree most, in one sentence."""
    if not diagnosis.where:
        return "There are too few samples to say where they disagree: no channel has six of them in any regime."
    cells = [cell for cell in diagnosis.where if cell.p_value <= SIGNIFICANCE]
    if not cells:
        return "Nowhere is the disagreement beyond the noise."
    cell = cells[0]
    return (
        f"The disagreement is largest in {describe_channel(cell.channel)} during '{cell.regime}' "
        f"({REGIMES.get(cell.regime, '')}): {cell.excess:.1f} times the noise."
    )


def describe_gap(diagnosis: Diagnosis) -> str:
    """Return what became of the disagreement on the held-out runs, in one sentence."""
    gap = diagnosis.gap
    if gap is None:
        return "There were too few experiments to hold any out, so how well this carries over is not known."
    runs = ", ".join(gap.held_out_runs)
    text = (
        f"On runs used neither to choose nor to fit ({runs}) the residual was {gap.nominal:.2f} times the noise with "
        f"the model as given, {gap.before:.2f} after recalibration"
    )
    return text + (f", and {gap.after:.2f} with what was found." if diagnosis.effects else ".")


def _how_well(cells: Sequence[Cell]) -> str:
    rest = worst_cell(cells)
    return f"to {rest:.1f} times the noise" if rest > 0.0 else "within the noise"


def _or_equivalents(names: tuple[str, ...]) -> str:
    return f" (or {' or '.join(names)}: these runs cannot tell)" if names else ""
