"""Diagnose: find what a model lacks, in stages that each leave a result of their own.

noise -> recalibration -> map of disagreement -> candidates -> screening -> fits -> verdict -> gap -> next experiment
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.calibrate import Calibration, calibrate, find_sensitivity, refine
from evergym.discrepancy.candidates import Candidate, find_candidates
from evergym.discrepancy.dataset import Dataset, load_dataset
from evergym.discrepancy.diagnosis import CandidateRow, Diagnosis, write_json
from evergym.discrepancy.gap import Gap, measure_gap
from evergym.discrepancy.hold_out import choose_held_out
from evergym.discrepancy.hook import UserEffect, load_user_effects
from evergym.discrepancy.interval import Interval, estimate_intervals
from evergym.discrepancy.locate import Cell, locate
from evergym.discrepancy.noise import NoiseModel, estimate_noise
from evergym.discrepancy.predict import Predictor, Setting
from evergym.discrepancy.residual import Measurement
from evergym.discrepancy.rig import apply_robot
from evergym.discrepancy.screen import Signature, group_equivalent, screen_candidates
from evergym.discrepancy.select import Score, Split, fit_candidates, score_fit
from evergym.discrepancy.verdict import (
    NamedEffect,
    Thresholds,
    Verdict,
    decide,
    estimate_confidence,
    explained_share,
    find_equivalents,
    is_excited,
    worst_cell,
)
from evergym.errors import ConfigError
from evergym.model import Model, load_model, save_model

__all__ = ["Evidence", "diagnose", "run_stages"]

Array = NDArray[np.float64]

Stage = Callable[[str, float], None]
"""Told what is being done, and the share of the whole that is done."""

FITTED_MAX = 6
"""Candidates that are fitted in the loop."""
EFFECTS_MAX = 2
"""Effects that are looked for at once."""


@dataclass(frozen=True)
class Evidence:
    """The results of all stages, for the report."""

    dataset: Dataset
    noise: NoiseModel
    measurement: Measurement
    predictor: Predictor
    split: Split
    calibration: Calibration
    base: Score
    signatures: tuple[Signature, ...]
    classes: Mapping[str, Sequence[str]]
    rivals: tuple[Score, ...]
    chosen: Score
    final: Score
    """The chosen effects fitted to all experiments."""
    diagnosis: Diagnosis


def diagnose(
    dataset_path: str | Path,
    model_path: str | Path,
    out: str | Path | None = None,
    effects_file: str | Path | None = None,
    on_stage: Stage | None = None,
) -> Diagnosis:
    """Find out what a model lacks, from measured runs.

    Args:
        dataset_path: Folder with ``dataset.toml`` and ``samples.csv``.
        model_path: Model file, or the name of a shipped model.
        out: Folder for ``diagnosis.json``, ``report.html`` and ``model.toml``; None: nothing is written.
        effects_file: Python file with the user's own effects (`evergym.discrepancy.hook`).
        on_stage: Told what is being done, and the share done.

    Raises:
        ConfigError: bad data or a bad model; nothing is written then.
    """
    model = load_model(model_path)
    dataset = load_dataset(dataset_path, model.robot)
    user = load_user_effects(effects_file) if effects_file is not None else ()
    evidence = run_stages(dataset, model, user, on_stage=on_stage)
    if out is not None:
        write_results(evidence, Path(out))
    return evidence.diagnosis


def write_results(evidence: Evidence, out: Path) -> None:
    """Write the files of a diagnosis into a folder."""
    out.mkdir(parents=True, exist_ok=True)
    save_model(evidence.diagnosis.model, out / "model.toml")
    write_json(evidence.diagnosis, out / "diagnosis.json")


def run_stages(
    dataset: Dataset,
    model: Model,
    user_effects: Sequence[UserEffect] = (),
    thresholds: Thresholds | None = None,
    on_stage: Stage | None = None,
) -> Evidence:
    """Run all stages of a diagnosis and return what each found."""
    begin = time.monotonic()
    thresholds = Thresholds() if thresholds is None else thresholds
    tell: Stage = on_stage if on_stage is not None else _ignore
    model = apply_robot(model, dataset)
    if not dataset.channels:
        raise ConfigError(f"{dataset.path}: no sample has a measurement. Fill at least one measured column.")

    tell("noise", 0.0)
    noise = estimate_noise(dataset)
    measurement = Measurement(dataset, noise)
    users = {effect.name: effect for effect in user_effects}
    predictor = Predictor(dataset, measurement, users)

    tell("recalibration", 0.02)
    sensitivity = find_sensitivity(predictor, Setting(model))
    split = split_samples(dataset, measurement, sensitivity.jacobian)
    calibration = calibrate(predictor, sensitivity, split.use)
    base = score_fit(predictor, calibration.fit, split, ())
    cells = map_disagreement(dataset, measurement, base, split)

    tell("screening", 0.25)
    candidates = find_candidates(model, users)
    signatures = screen_candidates(predictor, calibration.fit, candidates, split.use)
    classes = group_equivalent(signatures, split.use)
    excited = is_excited(signatures, thresholds)

    tell("fits", 0.45)
    rivals: list[Score] = []
    chosen = base
    if worst_cell(cells) >= thresholds.cell_min:
        rivals = fit_candidates(predictor, base, [s for s in signatures if s.gain > 1.0], split, FITTED_MAX)
        chosen, rivals = choose_effects(predictor, base, rivals, candidates, split, thresholds, tell)
    cells_after = map_disagreement(dataset, measurement, chosen, split)
    verdict = decide(base, chosen, cells, cells_after, excited, thresholds)
    if verdict not in (Verdict.EFFECT, Verdict.EFFECT_AND_UNKNOWN_REST):
        chosen, cells_after = base, cells

    tell("intervals", 0.85)
    everything = Split(np.ones(measurement.size, dtype=bool), tuple(range(len(measurement.experiments))), ())
    final = score_fit(predictor, refine(predictor, chosen.fit, everything.use), everything, chosen.effects)
    names, parameters = describe_effects(base, chosen, final, rivals, classes, thresholds)
    held_out = np.isin(measurement.experiment, split.held_out)
    gap: Gap | None = None
    if held_out.any():
        gap = measure_gap(
            dataset, measurement, held_out, calibration.nominal, base.fit.prediction, chosen.fit.prediction
        )
    corrected = final.fit.space.setting(final.fit.z).model
    diagnosis = Diagnosis(
        verdict=verdict,
        effects=names,
        parameters=parameters,
        where=tuple(cells),
        where_after=tuple(cells_after),
        gap=gap,
        calibration=tuple(calibration.estimates(final.fit)),
        silent=calibration.silent,
        candidates=tuple(list_candidates(base, candidates, signatures, rivals, excited)),
        next_experiment=None,
        rows_set_aside=dataset.set_aside,
        simulations=predictor.simulations,
        seconds=time.monotonic() - begin,
        model=dataclasses.replace(corrected, name=f"{model.name}_corrected"[:60]),
    )
    tell("done", 1.0)
    return Evidence(
        dataset,
        noise,
        measurement,
        predictor,
        split,
        calibration,
        base,
        tuple(signatures),
        classes,
        tuple(rivals),
        chosen,
        final,
        diagnosis,
    )


def split_samples(dataset: Dataset, measurement: Measurement, jacobian: Array) -> Split:
    """Set whole experiments aside to judge by; the others choose and fit."""
    held_out = choose_held_out(dataset, measurement, jacobian)
    use = ~np.isin(measurement.experiment, held_out)
    folds = tuple(i for i in range(len(measurement.experiments)) if i not in held_out)
    return Split(use, folds, held_out)


def map_disagreement(dataset: Dataset, measurement: Measurement, score: Score, split: Split) -> list[Cell]:
    """Return where a fitted model and the measurements disagree, among the samples that it was fitted to."""
    freedom = min(score.fit.space.size / max(int(split.use.sum()), 1), 0.5)
    return locate(dataset, measurement, score.fit.prediction, score.fit.residual, freedom, split.use)


def choose_effects(
    predictor: Predictor,
    base: Score,
    rivals: list[Score],
    candidates: Sequence[Candidate],
    split: Split,
    thresholds: Thresholds,
    tell: Stage,
) -> tuple[Score, list[Score]]:
    """Return the best model with one effect, or with more where each further one earns its place, and its rivals."""
    if not rivals:
        return base, rivals
    best = rivals[0]
    for count in range(1, EFFECTS_MAX):
        tell(f"{count + 1} effects", 0.6)
        cells = map_disagreement(predictor.dataset, predictor.measurement, best, split)
        if worst_cell(cells) < thresholds.rest_cell_min:
            break
        names = {effect.name for effect in best.effects}
        others = [candidate for candidate in candidates if candidate.name not in names]
        signatures = screen_candidates(predictor, best.fit, others, split.use)
        further = fit_candidates(predictor, best, [s for s in signatures if s.gain > 1.0], split, FITTED_MAX // 2)
        if not further or not earns_its_place(best, further[0], thresholds):
            break
        best = further[0]
    return best, rivals


def earns_its_place(before: Score, after: Score, thresholds: Thresholds) -> bool:
    """Return whether a further effect predicts left-out experiments better by an amount that matters."""
    gain = 0.5 * (before.validation.total - after.validation.total)
    return (
        gain >= 2.0 * thresholds.gain_min
        and after.excess <= 0.5 * before.excess
        and before.excess - after.excess >= 0.1
    )


def describe_effects(
    base: Score,
    chosen: Score,
    final: Score,
    rivals: Sequence[Score],
    classes: Mapping[str, Sequence[str]],
    thresholds: Thresholds,
) -> tuple[tuple[NamedEffect, ...], dict[str, list[Interval]]]:
    """Return the effects of the chosen model with confidence, share and equivalents, and their parameters."""
    names: list[NamedEffect] = []
    parameters: dict[str, list[Interval]] = {}
    share = explained_share(base, chosen)
    for position, effect in enumerate(chosen.effects):
        alone = next((rival for rival in rivals if rival.effects == (effect,)), None)
        if position == 0 and alone is not None:
            equivalents = find_equivalents(alone, rivals, classes, thresholds)
            confidence = estimate_confidence(share, alone, rivals)
        else:
            equivalents, confidence = (), estimate_confidence(share, chosen, ())
        own = share if len(chosen.effects) == 1 or alone is None else explained_share(base, alone)
        names.append(NamedEffect(effect.name, confidence, own, equivalents))
        paths = {axis.path for axis in effect.axes}
        first = min((i for i, axis in enumerate(final.fit.space.axes) if axis.path in paths), default=None)
        intervals = [] if first is None else estimate_intervals(final.fit, final.validation, first)
        parameters[effect.name] = [interval for interval in intervals if interval.path in paths]
    return tuple(names), parameters


def list_candidates(
    base: Score,
    candidates: Sequence[Candidate],
    signatures: Sequence[Signature],
    rivals: Sequence[Score],
    excited: Sequence[str],
) -> list[CandidateRow]:
    """Return what became of every candidate, the best first."""
    fitted = {rival.effects[0].name: rival for rival in rivals}
    seen = {signature.candidate.name: signature for signature in signatures}
    rows = []
    for candidate in candidates:
        signature, rival = seen.get(candidate.name), fitted.get(candidate.name)
        size, kept = (signature.size, signature.kept) if signature else (0.0, 0.0)
        share, values = None, {}
        if rival is not None:
            share = explained_share(base, rival)
            paths = {axis.path for axis in candidate.axes}
            found = rival.fit.space.values(rival.fit.z)
            values = {path.rpartition(".")[2]: float(found[path]) for path in paths}  # type: ignore[arg-type]
        status = "fitted" if rival else ("screened out" if candidate.name in excited else "not excited")
        rows.append(CandidateRow(candidate.name, status, size, kept, share, values))
    return sorted(rows, key=lambda row: (-(row.explained_share or 0.0), row.status, -row.size))


def _ignore(what: str, share: float) -> None:
    pass
