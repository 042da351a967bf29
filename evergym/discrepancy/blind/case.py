"""Make a case: play its truth, measure it, and judge what could be found."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evergym.config import check
from evergym.discrepancy.blind.alteration import Alteration
from evergym.discrepancy.blind.detect import KEPT_SHARE, SIGMAS, find_cells, recalibrate, weigh_part
from evergym.discrepancy.blind.faults import FAULTS
from evergym.discrepancy.blind.growth_forms import GrowthLaw, remove_resistance
from evergym.discrepancy.blind.hidden import list_hidden
from evergym.discrepancy.blind.instruments import draw_bench, format_dataset, measure_run
from evergym.discrepancy.blind.outside import OUTSIDE
from evergym.discrepancy.blind.plan import convert_plan
from evergym.discrepancy.blind.play import play_campaign
from evergym.discrepancy.blind.truth import HiddenPart, Truth, draw_truth
from evergym.discrepancy.parameters import set_values
from evergym.errors import SimulationDiverged
from evergym.model import Model

__all__ = ["ATTEMPTS", "Case", "assemble_truth", "make_case", "play_truth"]

Array = NDArray[np.float64]

ATTEMPTS = 4
"""A case whose effect is not detectable is drawn again, this often at most; the last one stands as it is."""
EXPERIMENTS_MIN = 2
"""An effect that shows in a single experiment is drawn again, too: nothing could be held out to test it on."""
CELLS_SEALED = 12


@dataclass(frozen=True)
class Case:
    """What the sealing process writes.

    Attributes:
        files: The dataset.
        model: The lab's model.
        sealed: What is kept from the diagnosis.
        signals: Noise-free channels of every run.
    """

    files: dict[str, str]
    model: Model
    sealed: dict[str, Any]
    signals: list[Array]


def assemble_truth(truth: Truth, parts: Sequence[HiddenPart]) -> tuple[Model, list[Alteration]]:
    """Return the true robot with some of its hidden parts: a model of the library, and code of the truth's own.

    Args:
        truth: The case.
        parts: Those of its parts that are to act.
    """
    library = list_hidden()
    values: dict[str, Any] = dict(truth.nominals)
    growth: dict[str, Any] = {}
    forms: list[str] = []
    alterations: list[Alteration] = []
    for part in parts:
        if part.form == "outside":
            alterations.append(OUTSIDE[part.name].form(part.values))
            continue
        paths = {f"effects.{part.name}.{key}": value for key, value in part.values.items()}
        hidden = library[part.name]
        if part.form == "library":
            values.update(paths)
        elif hidden.growth_form:
            growth.update(paths)
            forms.append(hidden.growth_form)
        else:
            assert hidden.form is not None and hidden.form_values is not None
            alterations.append(hidden.form(hidden.form_values(part.values, truth.known)))
    model = set_values(truth.known, values)
    if forms:
        alterations.append(GrowthLaw(set_values(model, growth), forms))
        model = remove_resistance(model)
    check(model, f"truth {truth.seed}/{truth.index}")
    return model, alterations


def play_truth(truth: Truth, parts: Sequence[HiddenPart] | None = None) -> list[Array]:
    """Return the noise-free channels of every run, with all hidden parts or some of them."""
    model, alterations = assemble_truth(truth, truth.parts if parts is None else parts)
    return play_campaign(model, truth.plans, truth.numerics, alterations)


def make_case(seed: int, index: int) -> Case:
    """Make the case of a seed and an index.

    Raises:
        SimulationDiverged: No attempt gave a robot that can be simulated.
    """
    failure: SimulationDiverged | None = None
    cases: list[Case] = []
    for attempt in range(ATTEMPTS):
        try:
            cases.append(_make_attempt(draw_truth(seed, index, attempt)))
        except SimulationDiverged as error:
            failure = error
            continue
        found = cases[-1].sealed["detections"]
        if all(part["detectable"] and part["experiments"] >= EXPERIMENTS_MIN for part in found):
            return cases[-1]
    if not cases:
        assert failure is not None
        raise failure
    # The first that can be found at all, though perhaps in one experiment only; else the last.
    return next((case for case in cases if all(p["detectable"] for p in case.sealed["detections"])), cases[-1])


def _make_attempt(truth: Truth) -> Case:
    noise = np.random.default_rng([truth.seed, truth.index, truth.attempt, 4])
    bench = draw_bench(noise)
    signals = play_truth(truth)
    measured = [measure_run(noise, bench, plan, signal) for plan, signal in zip(truth.plans, signals, strict=True)]
    files = format_dataset(f"bench-{noise.integers(1000, 9999)}", truth.plans, measured, bench, truth.overrides)
    sealed: dict[str, Any] = {"schema": 1, **truth.to_json(), "bench": bench.sigma, "stride": bench.stride}
    if truth.fault:
        spoiled = FAULTS[truth.fault](noise, files)
        return Case(spoiled.files, truth.lab, {**sealed, "words": list(spoiled.words), "detections": []}, signals)
    with tempfile.TemporaryDirectory() as folder:
        for plan in truth.plans:
            if plan.pegs:
                (Path(folder) / plan.peg_file).write_text(plan.format_pegs(), encoding="utf-8")
        runs = [convert_plan(plan, values, Path(folder)) for plan, values in zip(truth.plans, measured, strict=True)]
        # The true cell is one of noise-free signals where something was measured.
        best = recalibrate(truth.known, runs, signals, bench.sigma)
    cells = find_cells(runs, best.residual, list(bench.sigma))
    detections = []
    for place, part in enumerate(truth.parts):
        rest = [other for i, other in enumerate(truth.parts) if i != place]
        without = play_truth(truth, rest)
        change = [a - b for a, b in zip(signals, without, strict=True)]
        found = weigh_part(best, runs, change, bench.sigma)
        if len(truth.parts) == 1:
            # The definition itself, where there is one part only: the truth against the recalibrated model.
            largest = cells[0].sigmas if cells else 0.0
            found = replace(found, sigmas=largest, detectable=largest >= SIGMAS and found.kept_share >= KEPT_SHARE)
        detections.append({"name": part.name, **found.to_json()})
    sealed["detections"] = detections
    sealed["recalibrated"] = best.nominals
    sealed["cells"] = [
        {"channel": cell.channel, "regime": cell.regime, "sigmas": round(cell.sigmas, 4)}
        for cell in cells[:CELLS_SEALED]
    ]
    return Case(files, truth.lab, sealed, signals)
