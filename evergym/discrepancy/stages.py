"""Diagnose: find what a model lacks, in stages that each leave a result of their own.

noise -> recalibration -> map of disagreement -> candidates -> screening -> fits -> verdict -> gap -> next experiment
"""

from __future__ import annotations

import csv
import dataclasses
import math
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.alignment import align_dataset
from evergym.discrepancy.calibrate import approach_samples, calibrate, find_sensitivity, refine
from evergym.discrepancy.candidates import find_candidates
from evergym.discrepancy.choose import Choice, choose_effects
from evergym.discrepancy.data.dataset import Dataset
from evergym.discrepancy.data.reading import load_dataset
from evergym.discrepancy.data.rig import apply_robot, soften_line
from evergym.discrepancy.diagnosis import Diagnosis, write_json
from evergym.discrepancy.drive_check import DOUBTED_CONFIDENCE, fit_short_drive, is_better, remark_drive
from evergym.discrepancy.evidence import Evidence
from evergym.discrepancy.findings import describe_effects, list_candidates
from evergym.discrepancy.fit import Fit, evaluate_fit, fit_space, whitened_residual
from evergym.discrepancy.gap import measure_gap
from evergym.discrepancy.hold_out import choose_held_out
from evergym.discrepancy.hook import UserEffect, load_user_effects
from evergym.discrepancy.locate import Cell, locate, select_significant
from evergym.discrepancy.next_experiment import NextExperiment, choose_next
from evergym.discrepancy.noise import NoiseModel, estimate_noise
from evergym.discrepancy.numerics_check import choose_fidelities
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.profiles import list_profiles, to_columns
from evergym.discrepancy.remarks import (
    remark_failures,
    remark_limits,
    remark_own_effects,
    remark_scatter,
    remark_strain,
)
from evergym.discrepancy.report import write_report
from evergym.discrepancy.residual import Measurement
from evergym.discrepancy.screen import group_equivalent, rank_candidates, screen_candidates
from evergym.discrepancy.select import Score, Split, score_fit
from evergym.discrepancy.setting import Setting
from evergym.discrepancy.typical import find_faint, measure_rig, scale_candidates
from evergym.discrepancy.verdict import NamedEffect, Thresholds, Verdict, decide, is_excited, is_strained, worst_cell
from evergym.errors import ConfigError
from evergym.model import Model, load_model, save_model

__all__ = ["diagnose", "map_disagreement", "plan_next", "run_stages", "split_samples", "write_results"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

Stage = Callable[[str, float], None]
"""Told what is being done, and the share of the whole that is done."""

STAGE_SHARES = (0.01, 0.04, 0.25, 0.5, 0.85, 0.92, 1.0)
"""Shares of the whole at which stages begin."""
SIMULATIONS_PER_STAGE = 600.0
OVERALL_ITERATIONS = 3
NEXT_FILE = "next.csv"


def diagnose(
    dataset_path: str | Path,
    model_path: str | Path,
    out: str | Path | None = None,
    effects_file: str | Path | None = None,
    jobs: int = 1,
    on_stage: Stage | None = None,
) -> Diagnosis:
    """Find out what a model lacks, from measured runs.

    Args:
        dataset_path: Folder with ``dataset.toml`` and ``samples.csv``.
        model_path: Model file, or the name of a shipped model.
        out: Folder for ``diagnosis.json``, ``report.html`` and ``model.toml``; None: nothing is written.
        effects_file: Python file with the user's own effects (`evergym.discrepancy.hook`).
        jobs: Processes that simulate; 0: one per core.
        on_stage: Told what is being done, and the share done.

    Raises:
        ConfigError: bad data, a bad model, or a folder whose data or model would be overwritten; nothing is written
            then.
    """
    if out is not None:
        _refuse_overwriting(Path(out), model_path)
    model = load_model(model_path)
    dataset = load_dataset(dataset_path, model.robot)
    user = load_user_effects(effects_file) if effects_file is not None else ()
    evidence = run_stages(dataset, model, user, jobs=jobs, on_stage=on_stage)
    if out is not None:
        write_results(evidence, Path(out))
    return evidence.diagnosis


def _refuse_overwriting(out: Path, model_path: str | Path) -> None:
    if (out / "dataset.toml").exists():
        raise ConfigError(f"'{out}' holds measured data, which results must not mix with. Choose another folder.")
    if (out / "model.toml").exists() and (out / "model.toml").resolve() == Path(model_path).resolve():
        raise ConfigError(f"The result would overwrite the model '{model_path}'. Choose another folder.")


def write_results(evidence: Evidence, out: Path) -> None:
    """Write the files of a diagnosis into a folder; ``diagnosis.json`` comes last, so that it means "complete"."""
    out.mkdir(parents=True, exist_ok=True)
    for stale in ("diagnosis.json", NEXT_FILE):
        (out / stale).unlink(missing_ok=True)
    save_model(evidence.diagnosis.model, out / "model.toml")
    if evidence.upcoming is not None:
        columns = to_columns(evidence.upcoming.profile.run)
        with (out / NEXT_FILE).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))
    write_report(evidence, out / "report.html")
    write_json(evidence.diagnosis, out / "diagnosis.json")


def run_stages(
    dataset: Dataset,
    model: Model,
    user_effects: Sequence[UserEffect] = (),
    thresholds: Thresholds | None = None,
    jobs: int = 1,
    on_stage: Stage | None = None,
) -> Evidence:
    """Run all stages of a diagnosis and return what each found."""
    if not dataset.channels:
        raise ConfigError(f"{dataset.path}: no sample has a measurement. Fill at least one measured column.")
    thresholds = Thresholds() if thresholds is None else thresholds
    tell = _Progress(on_stage)
    tell("noise", 0.0)
    model = apply_robot(model, dataset)
    model, softened = soften_line(model)  # first: an inextensible line may settle elsewhere in each simulation
    dataset, aligned = align_dataset(model, dataset)
    noise = estimate_noise(dataset)
    measurement = Measurement(dataset, noise)
    users = {effect.name: effect for effect in user_effects}
    predictor = Predictor(dataset, measurement, users, jobs=jobs or os.cpu_count() or 1, on_simulation=tell.count)
    try:
        evidence = _run_stages(predictor, noise, model, thresholds, tell)
    finally:
        predictor.close()
    remarks = (*aligned, *softened, *evidence.diagnosis.remarks)
    return dataclasses.replace(evidence, diagnosis=dataclasses.replace(evidence.diagnosis, remarks=remarks))


def _run_stages(
    predictor: Predictor, noise: NoiseModel, model: Model, thresholds: Thresholds, tell: _Progress
) -> Evidence:
    dataset = predictor.dataset
    tell("numerics", 0.01)
    numerics = choose_fidelities(predictor, Setting(model))
    measurement = predictor.measurement = Measurement(dataset, noise, numerics.spread)
    tell("recalibration", 0.04)
    sensitivity = find_sensitivity(predictor, Setting(model))
    space = sensitivity.space
    reference = evaluate_fit(predictor, space, np.zeros(space.size), sensitivity.jacobian)
    split = split_samples(predictor, reference)
    calibration = calibrate(predictor, sensitivity, split.use)
    base = score_fit(predictor, calibration.fit, split)

    def draw_map(score: Score, use: Mask = split.use) -> list[Cell]:
        return map_disagreement(dataset, predictor.measurement, score.fit.prediction, score.fit.space.size, use)

    cells = draw_map(base)
    focus = select_significant(dataset, measurement, cells)
    if focus.any():
        split = dataclasses.replace(split, focus=focus)
        base = score_fit(predictor, calibration.fit, split)

    tell("screening", 0.25)
    scale = measure_rig(model.robot, dataset.runs)
    found = find_candidates(model, predictor.user_effects, find_faint(model, scale))
    candidates = scale_candidates(found, scale)
    screenings = screen_candidates(predictor, reference, candidates, split.use)
    signatures = rank_candidates(predictor, reference, screenings, split.use, calibration.fit)
    classes = group_equivalent(signatures, split.use)
    excited = is_excited(signatures, thresholds)

    tell("fits", 0.5)
    choice = Choice(base, base, (), ())
    known = measurement
    if worst_cell(cells) >= thresholds.cell_min or is_strained(base, cells, thresholds):
        choice = choose_effects(predictor, base, signatures, screenings, split, thresholds, draw_map)
        base, measurement = choice.base, predictor.measurement
        cells = draw_map(base)
    chosen = choice.best
    verdict = decide(base, chosen, cells, draw_map(chosen), excited, thresholds)
    drive: list[str] = []
    if verdict in (Verdict.EFFECT, Verdict.EFFECT_AND_UNKNOWN_REST):
        short = fit_short_drive(predictor, base, reference, known, split)
        if short is not None:
            drive = remark_drive(short, chosen, thresholds)
            if is_better(short, chosen, thresholds):
                verdict = Verdict.UNKNOWN_EFFECT
    if verdict not in (Verdict.EFFECT, Verdict.EFFECT_AND_UNKNOWN_REST):
        chosen = base
        choice = dataclasses.replace(choice, best=base)

    tell("intervals", 0.85)
    everything = Split(np.ones(measurement.size, dtype=bool), tuple(range(len(measurement.experiments))), ())
    final = score_fit(predictor, refine(predictor, chosen.fit, everything.use), everything, chosen.effects)
    # The verdict was reached without the held-out runs; the map that is shown is of all.
    nearest = approach_samples(predictor, known, base.fit)
    where = map_disagreement(dataset, known, nearest, space.size, everything.use)
    where_after = draw_map(final, everything.use) if chosen.effects else where
    effects, parameters = describe_effects(base, choice, final, classes, thresholds)
    if drive:
        effects = tuple(dataclasses.replace(one, confidence=min(one.confidence, DOUBTED_CONFIDENCE)) for one in effects)
    held_out = np.isin(measurement.experiment, split.held_out)
    predictions = calibration.nominal, base.fit.prediction, chosen.fit.prediction
    # Not by what discretisation does to the effect that was chosen: that would discount what it leaves over.
    gap = measure_gap(dataset, known, held_out, *predictions) if held_out.any() else None

    tell("next experiment", 0.92)
    rows = list_candidates(base, candidates, signatures, choice, excited)
    upcoming = plan_next(predictor, noise, model, choice, effects)
    # A model file can hold none of the user's own effects: where there is no other, it is the recalibrated model.
    is_corrected = any(effect.name not in predictor.user_effects for effect in effects)
    kept = final.fit if is_corrected or not effects else base.fit
    corrected = kept.space.setting(kept.z).model
    calibrated = tuple(calibration.estimates(final.fit))
    remarks = (
        *remark_failures(dataset, measurement, final.fit.prediction, predictor.failures),
        *remark_scatter(dataset, measurement, noise, final.fit.prediction),
        *drive,
        *remark_limits(calibrated),
        *(remark_strain(calibration.estimates(base.fit)) if choice.by_strain and effects else ()),
        *remark_own_effects([effect.name for effect in effects], predictor.user_effects),
    )
    diagnosis = Diagnosis(
        verdict=verdict,
        effects=effects,
        parameters=parameters,
        where=tuple(where),
        where_after=tuple(where_after),
        gap=gap,
        calibration=calibrated,
        silent=calibration.silent,
        numerics_error=max(numerics.errors.values(), default=0.0),
        candidates=tuple(rows),
        next_experiment=upcoming.describe(NEXT_FILE) if upcoming else None,
        rows_set_aside=dataset.set_aside,
        simulations=predictor.simulations,
        seconds=time.monotonic() - tell.begin,
        model=dataclasses.replace(corrected, name=f"{model.name}_{'corrected' if is_corrected else 'recalibrated'}"),
        experiments=len(everything.folds),
        remarks=remarks,
        by_strain=choice.by_strain and bool(effects),
    )
    tell("done", 1.0)
    return Evidence(
        dataset=dataset,
        noise=noise,
        measurement=measurement,
        predictor=predictor,
        split=split,
        calibration=calibration,
        base=base,
        signatures=tuple(signatures),
        classes=classes,
        rivals=choice.rivals,
        chosen=chosen,
        final=final,
        upcoming=upcoming,
        diagnosis=diagnosis,
    )


def split_samples(predictor: Predictor, reference: Fit) -> Split:
    """Set whole experiments aside to judge by; the others choose and fit.

    Args:
        predictor: Simulations.
        reference: The model as given.
    """
    dataset, measurement = predictor.dataset, predictor.measurement
    overall = fit_space(predictor, reference.space, reference.z, None, reference.jacobian, [], OVERALL_ITERATIONS)
    count = len(measurement.experiments)
    chi2 = np.bincount(measurement.experiment, overall.residual**2, minlength=count)
    excess = chi2 - np.bincount(measurement.experiment, minlength=count)
    held_out = choose_held_out(dataset, measurement, reference.jacobian, np.sqrt(np.maximum(excess, 0.0)))
    use = ~np.isin(measurement.experiment, held_out)
    folds = tuple(i for i in range(count) if i not in held_out)
    return Split(use, folds, held_out)


def map_disagreement(
    dataset: Dataset, measurement: Measurement, prediction: Array, unknowns: int, use: Mask
) -> list[Cell]:
    """Return where measurements and the prediction of a model fitted to the samples ``use`` disagree among them."""
    freedom = min(unknowns / max(int(use.sum()), 1), 0.5)
    residual = whitened_residual(measurement, prediction)
    return locate(dataset, measurement, prediction, residual, freedom, use)


def plan_next(
    predictor: Predictor, noise: NoiseModel, model: Model, choice: Choice, effects: Sequence[NamedEffect]
) -> NextExperiment | None:
    """Return the experiment that separates the first effect with ties from those that explain the data as well."""
    for effect in effects:
        rivals = {
            name: contender.fit
            for contender in choice.contenders
            for name in effect.equivalents
            if name in {other.name for other in contender.effects}
        }
        if rivals:
            why = f"separates {effect.name} from {' and '.join(rivals)}"
            profiles = list_profiles(predictor.dataset, model.robot)
            return choose_next(predictor, noise, profiles, choice.best.fit, list(rivals.values()), why)
    return None


class _Progress:
    """Tells the stages, and between them how the simulations advance: how many a stage takes is not known before."""

    def __init__(self, on_stage: Stage | None) -> None:
        self.begin = time.monotonic()
        self._on_stage = on_stage
        self._what, self._share, self._left = "", 0.0, 0.0
        self._before = self._now = 0

    def __call__(self, what: str, share: float) -> None:
        """Begin a stage."""
        later = [end for end in STAGE_SHARES if end > share]
        self._what, self._share, self._left = what, share, (later[0] - share if later else 0.0)
        self._before = self._now
        self._tell(share)

    def count(self, simulations: int) -> None:
        """Take note of a simulation."""
        self._now = simulations
        self._tell(self._share + self._left * (1.0 - math.exp((self._before - simulations) / SIMULATIONS_PER_STAGE)))

    def _tell(self, share: float) -> None:
        if self._on_stage is not None:
            self._on_stage(self._what, share)
