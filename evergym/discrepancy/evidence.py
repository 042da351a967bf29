"""The results of all stages of a diagnosis together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from evergym.discrepancy.calibrate import Calibration
from evergym.discrepancy.data.dataset import Dataset
from evergym.discrepancy.diagnosis import Diagnosis
from evergym.discrepancy.next_experiment import NextExperiment
from evergym.discrepancy.noise import NoiseModel
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.residual import Measurement
from evergym.discrepancy.screen import Signature
from evergym.discrepancy.select import Score, Split

__all__ = ["Evidence"]


@dataclass(frozen=True)
class Evidence:
    """What each stage found; the diagnosis is the conclusion.

    Attributes:
        base: The recalibrated model.
        signatures: What each candidate would change, the most promising first.
        classes: For each candidate, those whose signature points the same way.
        rivals: Models with one effect, the best first.
        chosen: The model of the verdict, fitted to the experiments that choose.
        final: The same, fitted to all experiments.
        upcoming: The experiment that would tell most; None: nothing to tell.
    """

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
    upcoming: NextExperiment | None
    diagnosis: Diagnosis
