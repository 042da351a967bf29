"""The report of a diagnosis: one HTML file that holds everything it shows."""

from __future__ import annotations

from pathlib import Path

import jinja2
import numpy as np

from evergym.discrepancy.evidence import Evidence
from evergym.discrepancy.figures import draw_commands, draw_held_out, draw_map, encode
from evergym.discrepancy.next_experiment import NextExperiment
from evergym.discrepancy.words import (
    describe_confidence,
    describe_effect,
    describe_gap,
    describe_verdict,
    describe_where,
)
from evergym.whole_file import write_whole

__all__ = ["write_report"]

BAR_PX = 320.0


def write_report(evidence: Evidence, path: Path) -> None:
    """Write ``report.html``, whole or not at all."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("evergym.discrepancy"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    write_whole(path, environment.get_template("diagnosis.html").render(**_collect(evidence)))


def _collect(evidence: Evidence) -> dict[str, object]:
    diagnosis, dataset, measurement = evidence.diagnosis, evidence.dataset, evidence.measurement
    named = bool(diagnosis.effects)
    held = np.flatnonzero(np.isin(measurement.experiment, evidence.split.held_out))
    runs = sorted(set(measurement.run[held].tolist())) or list(range(len(dataset.runs)))
    after = evidence.chosen.fit.prediction if named else None
    curves = draw_held_out(dataset, measurement, runs, evidence.base.fit.prediction, after)
    upcoming = evidence.upcoming
    return {
        "dataset": dataset,
        "verdict": describe_verdict(diagnosis),
        "where": describe_where(diagnosis),
        "gap": describe_gap(diagnosis),
        "bars": _list_bars(evidence),
        "effects": [
            (effect, describe_effect(effect.name), describe_confidence(effect.confidence))
            for effect in diagnosis.effects
        ],
        "left_out": diagnosis.experiments > 1,
        "by_strain": diagnosis.by_strain,
        "parameters": diagnosis.parameters,
        "map_before": encode(draw_map(diagnosis.where)),
        "map_after": encode(draw_map(diagnosis.where_after)) if named else None,
        "curves": encode(curves),
        "held_out": bool(len(held)),
        "candidates": diagnosis.candidates,
        "ties": [f"{e.name} and {' and '.join(e.equivalents)}" for e in diagnosis.effects if e.equivalents],
        "untestable": [row.name for row in diagnosis.candidates if row.status == "not excited"],
        "per_channel": diagnosis.gap.per_channel if diagnosis.gap else {},
        "calibration": diagnosis.calibration,
        "silent": diagnosis.silent or ("none",),
        "noise": evidence.noise.channels,
        "next_commands": encode(draw_commands(upcoming.profile.run)) if upcoming else None,
        "next_why": _describe_next(upcoming) if upcoming else "",
        "rows_set_aside": diagnosis.rows_set_aside,
        "remarks": diagnosis.remarks,
        "simulations": diagnosis.simulations,
        "seconds": diagnosis.seconds,
    }


def _list_bars(evidence: Evidence) -> list[tuple[str, str, float, float]]:
    """Return the bars of the held-out gap: label, kind, value [sigma], width [px]."""
    gap = evidence.diagnosis.gap
    if gap is None:
        return []
    bars = [("model as given", "nominal", gap.nominal), ("recalibrated", "before", gap.before)]
    if evidence.diagnosis.effects:
        bars.append(("corrected", "after", gap.after))
    top = max(value for _, _, value in bars)
    return [(label, kind, value, BAR_PX * value / max(top, 1e-9)) for label, kind, value in bars]


def _describe_next(upcoming: NextExperiment) -> str:
    run = upcoming.profile.run
    gravity = ", ".join(f"{value:g}" for value in run.gravity)
    return (
        f"{upcoming.profile.title.capitalize()}: {upcoming.why}. It begins with {run.initial_everted_length_mm:.1f} mm "
        f'everted, setup "{run.setup}", gravity ({gravity}) m/s².'
    )
