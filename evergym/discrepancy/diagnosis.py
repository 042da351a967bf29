"""What a diagnosis found: the content of ``diagnosis.json``."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evergym.discrepancy.calibrate import ParameterEstimate
from evergym.discrepancy.gap import Gap
from evergym.discrepancy.interval import Interval
from evergym.discrepancy.locate import SIGNIFICANCE, Cell
from evergym.discrepancy.verdict import NamedEffect, Verdict
from evergym.model import Model
from evergym.whole_file import write_whole

__all__ = ["CandidateRow", "Diagnosis", "write_json"]

CELLS_MAX = 12
"""Cells of the map that are written down."""


@dataclass(frozen=True)
class CandidateRow:
    """One line of the candidate table: what became of an effect that might be missing.

    Attributes:
        name: The effect.
        status: "fitted", "screened out", or "not excited".
        size: Norm of what it would change at a typical strength [sigma].
        kept: Share of it that recalibration cannot absorb.
        explained_share: Of the excess over noise, on left-out experiments; None if it was not fitted. Of the strain
            where the diagnosis is by strain.
        parameters: Fitted values; empty if it was not fitted.
    """

    name: str
    status: str
    size: float
    kept: float
    explained_share: float | None
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class Diagnosis:
    """The result of a diagnosis.

    Attributes:
        verdict: The conclusion.
        effects: Effects named, the most important first.
        parameters: Their parameters with intervals, by effect.
        where: Map of disagreement of the recalibrated model, the worst cell first.
        where_after: The same with the effects in.
        gap: On experiments used neither to choose nor to fit; None if there were too few.
        calibration: Recalibrated nominal parameters.
        silent: Nominal parameters that these runs do not feel.
        numerics_error: Largest rms difference of the simulations from finer ones, in any run and channel [sigma].
        candidates: What became of every candidate.
        next_experiment: Why, and the file of commands; None where nothing is left to separate.
        rows_set_aside: (row, why) of impossible rows.
        simulations: Runs simulated.
        seconds: It took.
        model: The corrected model; if no effect is named, the recalibrated one.
        experiments: In the dataset.
        remarks: What a reader must know beside the conclusion, each in a sentence.
        by_strain: Whether the effect can only be told by the strain of the recalibrated model, which agrees: all shares
            are then of that strain.
    """

    verdict: Verdict
    effects: tuple[NamedEffect, ...]
    parameters: Mapping[str, Sequence[Interval]]
    where: tuple[Cell, ...]
    where_after: tuple[Cell, ...]
    gap: Gap | None
    calibration: tuple[ParameterEstimate, ...]
    silent: tuple[str, ...]
    numerics_error: float
    candidates: tuple[CandidateRow, ...]
    next_experiment: Mapping[str, Any] | None
    rows_set_aside: tuple[tuple[int, str], ...]
    simulations: int
    seconds: float
    model: Model
    experiments: int
    remarks: tuple[str, ...] = ()
    by_strain: bool = False

    def to_mapping(self) -> dict[str, Any]:
        """Return the content of ``diagnosis.json``."""
        return {
            "schema": 1,
            "verdict": self.verdict.value,
            "effects": [self._describe(effect) for effect in self.effects],
            "where": [
                {
                    "channel": cell.channel,
                    "regime": cell.regime,
                    "runs": list(cell.runs),
                    "excess_over_noise": _round(cell.excess),
                    "p_value": cell.p_value,
                }
                for cell in self.where
                if cell.p_value <= SIGNIFICANCE
            ][:CELLS_MAX],
            "gap": self._describe_gap(),
            "next_experiment": dict(self.next_experiment) if self.next_experiment else None,
            "calibration": {
                "parameters": {
                    estimate.path: {
                        "nominal": estimate.nominal,
                        "estimate": _round(estimate.estimate),
                        "sigma": _round(estimate.sigma),
                        "tolerance": _round(estimate.tolerance),
                        "at_limit": bool(estimate.at_limit),
                    }
                    for estimate in self.calibration
                },
                "identifiable": [e.path for e in self.calibration if e.identifiable],
                "not_identifiable": [e.path for e in self.calibration if not e.identifiable] + list(self.silent),
            },
            "candidates": [
                {
                    "name": row.name,
                    "status": row.status,
                    "signature_sigma": _round(row.size),
                    "kept_share": _round(row.kept),
                    **self._describe_share(row.explained_share),
                    "parameters": {key: _round(value) for key, value in row.parameters.items()},
                }
                for row in self.candidates
            ],
            "numerics_error_sigma": _round(self.numerics_error),
            "rows_set_aside": [{"row": row, "why": why} for row, why in self.rows_set_aside],
            "remarks": list(self.remarks),
            "simulations": self.simulations,
            "seconds": round(self.seconds, 1),
        }

    def _describe_share(self, share: float | None) -> dict[str, float | None]:
        rounded = None if share is None else round(share, 4)
        return {"explained_share": None, "relieved_share": rounded} if self.by_strain else {"explained_share": rounded}

    def _describe(self, effect: NamedEffect) -> dict[str, Any]:
        return {
            "name": effect.name,
            "confidence": round(effect.confidence, 3),
            **self._describe_share(effect.explained_share),
            "parameters": {
                interval.path.rpartition(".")[2]: {
                    "estimate": _round(interval.estimate),
                    "low_90": _round(interval.low_90),
                    "high_90": _round(interval.high_90),
                }
                for interval in self.parameters.get(effect.name, ())
            },
            "equivalents": list(effect.equivalents),
        }

    def _describe_gap(self) -> dict[str, Any]:
        unit = "sigma (rms of residual / noise)"
        if self.gap is None:
            return {
                "held_out_runs": [],
                "before": None,
                "after": None,
                "nominal": None,
                "unit": unit,
                "per_channel": {},
                "why_none": "fewer than three experiments: none could be held out",
            }
        per_channel = {}
        for name, (before, after) in self.gap.per_channel.items():
            suffix = _unit_suffix(name)
            per_channel[name] = {f"before{suffix}": _round(before), f"after{suffix}": _round(after)}
        return {
            "held_out_runs": list(self.gap.held_out_runs),
            "before": _round(self.gap.before),
            "after": _round(self.gap.after),
            "nominal": _round(self.gap.nominal),
            "unit": unit,
            "per_channel": per_channel,
        }


def write_json(diagnosis: Diagnosis, path: Path) -> None:
    """Write ``diagnosis.json``, whole or not at all."""
    write_whole(path, json.dumps(_clean(diagnosis.to_mapping()), indent=2, ensure_ascii=False) + "\n")


def _unit_suffix(channel: str) -> str:
    for suffix in ("_mm_s", "_1_per_m", "_mm", "_deg", "_kpa"):
        if channel.endswith(suffix):
            return suffix
    return ""


def _round(value: float) -> float:
    """Four significant digits: more would be noise."""
    if not math.isfinite(value) or value == 0.0:
        return float(value)
    return float(f"{value:.4g}")


def _clean(value: Any) -> Any:
    """Replace numbers that JSON cannot hold by null."""
    if isinstance(value, dict):
        return {key: _clean(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_clean(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
