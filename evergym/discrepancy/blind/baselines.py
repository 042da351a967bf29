"""What simpler methods make of the same data: they stand in the same table as the diagnosis.

Every baseline sees the dataset and the model file only, and holds out the same experiments. Candidates enter with one
simulation at their typical strength; their amplitude is fitted linearly, then simulated on the held-out runs.

    python -m evergym.discrepancy.blind.baselines DATASET MODEL OUT
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from evergym.discrepancy.blind.detect import recalibrate
from evergym.discrepancy.blind.folders import write_json
from evergym.discrepancy.data.columns import channel_index
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.data.reading import load_dataset
from evergym.discrepancy.data.rig import apply_robot
from evergym.discrepancy.parameters import find_info, get_value, set_values
from evergym.discrepancy.simulate import simulate_run
from evergym.effects.catalogue import EFFECTS
from evergym.model import Model, load_model

__all__ = ["compare_baselines", "main"]

Array = NDArray[np.float64]

HELD_OUT_EVERY = 4
"""One experiment in so many is held out."""
AMPLITUDE_MAX = 4.0
"""Largest strength, in typical ones."""
GP_SAMPLES = 200
"""Samples that the Gaussian process learns from, per channel."""


@dataclass(frozen=True)
class _Bench:
    """The data and what the model says of them, in sigmas, stacked over all runs."""

    runs: Sequence[Run]
    names: list[str]
    data: Array
    used: NDArray[np.bool_]
    held_out: NDArray[np.bool_]

    def predict(self, model: Model, sigma: Mapping[str, float]) -> Array:
        """Return the model's prediction [sigma], stacked as the data."""
        index = [channel_index(name) for name in self.names]
        scale = np.array([sigma[name] for name in self.names])
        return np.concatenate([(simulate_run(model, run)[:, index] / scale).ravel() for run in self.runs])

    def measure(self, residual: Array, held_out: bool) -> float:
        """Return the rms of a residual [sigma] on the held-out samples, or on the others."""
        part = residual[self.used & (self.held_out == held_out)]
        part = part[np.isfinite(part)]
        return float(np.sqrt(np.mean(part**2))) if len(part) else math.nan


def compare_baselines(dataset_path: Path, model_path: Path) -> dict[str, Any]:
    """Return what every baseline says, in the form of a diagnosis: verdict, names, gap on held-out runs."""
    raw = load_model(model_path)
    dataset = load_dataset(dataset_path, raw.robot)
    model = apply_robot(raw, dataset)
    sigma = {name: dataset.noise[name] for name in dataset.channels}
    bench = _stack(dataset, list(sigma))
    nominal = bench.data - bench.predict(model, sigma)
    training = [run for run in bench.runs if not _is_held_out(dataset, run)]
    best = recalibrate(model, training, [run.measured for run in training], sigma)
    recalibrated = set_values(model, best.nominals)
    base = bench.predict(recalibrated, sigma)
    residual = bench.data - base
    before = bench.measure(residual, held_out=True)
    candidates = _list_candidates(model)
    signatures = {
        name: bench.predict(set_values(recalibrated, values), sigma) - base for name, values in candidates.items()
    }
    jacobian = np.zeros((len(base), len(best.nominals)))
    jacobian[
        np.concatenate([np.repeat(not _is_held_out(dataset, run), len(run.time_s) * len(sigma)) for run in bench.runs])
    ] = _pad(best.jacobian, best.used)

    def finish(name: str | None, values: Mapping[str, Any], start: Model) -> dict[str, Any]:
        after = before
        if name is not None:
            after = bench.measure(bench.data - bench.predict(set_values(start, values), sigma), held_out=True)
        return _describe(name, before, after)

    result = {"recalibrate_only": _describe(None, before, before)}
    fitted, amplitude = _choose(bench, nominal, signatures, np.zeros((len(base), 0)))
    result["nominal_fixed"] = finish(fitted, _scale(candidates, fitted, amplitude), model)
    fitted, amplitude = _choose(bench, residual, signatures, jacobian)
    result["independent_bic"] = finish(fitted, _scale(candidates, fitted, amplitude), recalibrated)
    learned = residual - _learn_residual(bench, residual)
    result["gaussian_process"] = _describe(None, before, bench.measure(learned, held_out=True))
    digits = [int(character) for character in dataset.name if character.isdigit()]
    drawn = str(np.random.default_rng([*digits, 9]).choice(list(candidates))) if candidates else None
    result["random_name"] = finish(drawn, _scale(candidates, drawn, 1.0), recalibrated)
    return result


def _describe(name: str | None, before: float, after: float) -> dict[str, Any]:
    effects = [] if name is None else [{"name": name, "confidence": 1.0, "equivalents": [], "parameters": {}}]
    gap = {"before": before if math.isfinite(before) else None, "after": after if math.isfinite(after) else None}
    return {
        "verdict": "no_effect" if name is None else "effect",
        "effects": effects,
        "where": [],
        "gap": gap,
        "rows_set_aside": [],
    }


def _is_held_out(dataset: Dataset, run: Run) -> bool:
    experiments = list(dict.fromkeys(other.experiment for other in dataset.runs))
    return experiments.index(run.experiment) % HELD_OUT_EVERY == HELD_OUT_EVERY - 1


def _stack(dataset: Dataset, names: list[str]) -> _Bench:
    index = [channel_index(name) for name in names]
    scale = np.array([dataset.noise[name] for name in names])
    data = np.concatenate([(run.measured[:, index] / scale).ravel() for run in dataset.runs])
    held = [np.repeat(_is_held_out(dataset, run), len(run.time_s) * len(names)) for run in dataset.runs]
    return _Bench(dataset.runs, names, data, np.isfinite(data), np.concatenate(held))


def _pad(rows: Array, used: NDArray[np.bool_]) -> Array:
    full = np.zeros((len(used), rows.shape[1]))
    full[used] = rows
    return full


def _list_candidates(model: Model) -> dict[str, dict[str, Any]]:
    """Return the effects that are off in the model, with the values that make them clearly visible."""
    candidates = {}
    for name, kind in EFFECTS.items():
        info = kind.info
        off = {f"effects.{name}.{key}": value for key, value in info.off.items()}
        typical = {f"effects.{name}.{key}": value for key, value in info.typical.items()}
        if typical and all(get_value(model, path) == value for path, value in off.items()):
            candidates[name] = typical
    return candidates


def _scale(candidates: Mapping[str, Mapping[str, Any]], name: str | None, amplitude: float) -> dict[str, Any]:
    """Return the values of a candidate at an amplitude, within their limits; switches stay as they are."""
    values: dict[str, Any] = {}
    for path, value in candidates.get(name or "", {}).items():
        if isinstance(value, bool):
            values[path] = value
            continue
        info = find_info(path)
        scaled = amplitude * float(value)
        low = -math.inf if info.low is None else info.low
        high = math.inf if info.high is None else info.high
        values[path] = min(max(scaled, low), high)
    return values


def _choose(
    bench: _Bench, residual: Array, signatures: Mapping[str, Array], jacobian: Array
) -> tuple[str | None, float]:
    """Return the candidate with the lowest BIC of independent samples, and its amplitude; None: no effect is better."""
    used = bench.used & ~bench.held_out & np.isfinite(residual) & np.isfinite(jacobian).all(axis=1)
    target, count = residual[used], int(used.sum())
    penalty = math.log(max(count, 2))

    def fit(columns: Array) -> tuple[float, Array]:
        if columns.shape[1] == 0:
            return float(target @ target), np.zeros(0)
        solution: Array = np.asarray(np.linalg.lstsq(columns, target, rcond=None)[0], dtype=np.float64)
        return float(np.sum((target - columns @ solution) ** 2)), solution

    best, name, amplitude = fit(jacobian[used])[0], None, 0.0
    for candidate, signature in signatures.items():
        if not np.isfinite(signature[used]).all() or not np.any(signature[used]):
            continue
        cost, solution = fit(np.column_stack((jacobian[used], signature[used])))
        if solution[-1] > 0.0 and cost + penalty < best:
            best, name, amplitude = cost + penalty, candidate, min(float(solution[-1]), AMPLITUDE_MAX)
    return name, amplitude


def _learn_residual(bench: _Bench, residual: Array) -> Array:
    """Return what a Gaussian process over commands and time expects of the residual, everywhere."""
    features = np.concatenate([_describe_samples(run) for run in bench.runs])
    features = (features - features.mean(axis=0)) / np.maximum(features.std(axis=0), 1e-9)
    columns = residual.reshape(-1, len(bench.names))
    training = (bench.used & ~bench.held_out).reshape(columns.shape)
    learned = np.zeros_like(columns)
    generator = np.random.default_rng(0)
    for j in range(columns.shape[1]):
        rows = np.flatnonzero(training[:, j] & np.isfinite(columns[:, j]))
        if len(rows) < 10:
            continue
        rows = generator.choice(rows, size=min(GP_SAMPLES, len(rows)), replace=False)
        kernel = ConstantKernel(1.0) * RBF(3.0) + WhiteKernel(1.0)
        process = GaussianProcessRegressor(kernel, normalize_y=True, random_state=0)
        with warnings.catch_warnings():
            # A length scale at its limit means that a command does not matter.
            warnings.simplefilter("ignore", ConvergenceWarning)
            process.fit(features[rows], columns[rows, j])
        learned[:, j] = process.predict(features)
    return np.asarray(learned.ravel())


def _describe_samples(run: Run) -> Array:
    """Return the commands of every sample and what they have done so far, shape (k, n)."""
    commands = np.nan_to_num(run.commands)
    step = np.diff(run.time_s, prepend=run.time_s[0])
    fed = np.cumsum(commands[:, 1] * step) + run.initial_everted_length_mm
    return np.column_stack(
        (
            commands[:, 1:],
            np.gradient(commands[:, 3]) if len(commands) > 1 else commands[:, 3],
            np.maximum.accumulate(commands[:, 3]),
            fed,
            run.time_s,
            np.tile(run.gravity, (len(commands), 1)),
            np.full(len(commands), float(run.setup == "catheter")),
        )
    )


def main(arguments: Sequence[str]) -> int:
    """Write what all baselines say of one dataset."""
    dataset, model, out = map(Path, arguments)
    write_json(compare_baselines(dataset, model), out)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
