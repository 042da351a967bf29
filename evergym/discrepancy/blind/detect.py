"""What can be known at all: computed from noise-free signals by the process that holds the truth.

An effect is *detectable* if the truth differs from the best recalibrated model by at least 3 sigma rms in some cell
(channel x regime), and recalibration cannot absorb more than nine tenths of it. The *true cell* is where that
difference is largest.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from evergym.discrepancy.blind.rig import list_nominals
from evergym.discrepancy.data.columns import channel_index
from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.parameters import get_value, set_values
from evergym.discrepancy.regimes import label_regimes
from evergym.discrepancy.simulate import simulate_run
from evergym.model import Model

__all__ = ["KEPT_SHARE", "SIGMAS", "Cell", "Detection", "Recalibration", "find_cells", "recalibrate", "weigh_part"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SIGMAS = 3.0
KEPT_SHARE = 0.1
VISIBLE_SIGMAS = 1.0
CELL_SAMPLES = 6
"""Least number of samples of a cell."""
BOUND_TOLERANCES = 2.5
"""How far recalibration may move a nominal, in tolerances."""
ITERATIONS = 3


@dataclass(frozen=True)
class Cell:
    """A channel in a regime, and how far the truth is from the recalibrated model there [sigma rms]."""

    channel: str
    regime: str
    sigmas: float


@dataclass(frozen=True)
class Detection:
    """Whether one hidden part can be found.

    Attributes:
        detectable: By the definition above.
        kept_share: Of the part's signature, what the nominals cannot absorb.
        sigmas: Largest cell of what they cannot absorb [sigma rms].
        experiments: In how many a channel differs by more than the noise; with one, nothing can be held out.
    """

    detectable: bool
    kept_share: float
    sigmas: float
    experiments: int

    def to_json(self) -> dict[str, Any]:
        """Return what is sealed."""
        return dataclasses.asdict(self)


class Recalibration:
    """The known model with its nominals fitted to noise-free signals.

    Attributes:
        residual: Signal less the model's prediction [sigma], one array of shape (k, channels) per run; NaN where
            nothing is measured.
        jacobian: Change of the stacked prediction [sigma] per tolerance of each nominal.
        nominals: Values found, by path.
    """

    def __init__(self, residual: list[Array], jacobian: Array, nominals: dict[str, float], used: Mask) -> None:
        self.residual = residual
        self.jacobian = jacobian
        self.nominals = nominals
        self.used = used

    def project(self, signals: Sequence[Array]) -> list[Array]:
        """Return what of a signature [sigma] the nominals cannot absorb, in the shape of the runs."""
        stacked = np.concatenate([signal.ravel() for signal in signals])
        target = stacked[self.used]
        # Within tolerances, as priors: a nominal that would have to move far cannot absorb it.
        count = self.jacobian.shape[1]
        system = np.vstack((self.jacobian, np.eye(count)))
        solution = np.linalg.lstsq(system, np.concatenate((target, np.zeros(count))), rcond=None)[0]
        left = np.full_like(stacked, np.nan)
        left[self.used] = target - self.jacobian @ solution
        edges = np.cumsum([signal.size for signal in signals])[:-1]
        return [a.reshape(b.shape) for a, b in zip(np.split(left, edges), signals, strict=True)]


def recalibrate(model: Model, runs: Sequence[Run], signals: Sequence[Array], sigma: dict[str, float]) -> Recalibration:
    """Fit the nominals of ``model`` to noise-free signals, with their tolerances as priors.

    Args:
        model: As the diagnosis knows it.
        runs: The campaign.
        signals: Noise-free channels of every run, (k, 9).
        sigma: Noise of the measured channels.
    """
    tolerance = list_nominals(model)
    paths = list(tolerance)
    centre = np.array([float(get_value(model, path)) for path in paths])
    scale = np.abs(centre) * np.array([tolerance[path] for path in paths])
    target, used = _stack(signals, runs, sigma)

    def predict(theta: Array) -> Array:
        values = {path: float(value) for path, value in zip(paths, centre + scale * theta, strict=True)}
        changed = set_values(model, values)
        stacked, _ = _stack([simulate_run(changed, run) for run in runs], runs, sigma)
        return stacked

    theta = np.zeros(len(paths))
    base = predict(theta)
    jacobian = _differentiate(predict, theta, base)
    finite = used & np.isfinite(base) & np.isfinite(jacobian).all(axis=1)
    best = base
    for _ in range(ITERATIONS):
        gap = (target - best)[finite]
        system = np.vstack((jacobian[finite], np.eye(len(paths))))
        aim = np.concatenate((gap, -theta))
        step = lsq_linear(system, aim, bounds=(-BOUND_TOLERANCES - theta, BOUND_TOLERANCES - theta)).x
        improved = False
        for share in (1.0, 0.5, 0.25):
            trial = predict(theta + share * step)
            if _cost(target, trial, finite, theta + share * step) < _cost(target, best, finite, theta) - 1e-3:
                theta, best, improved = theta + share * step, trial, True
                break
        if not improved or np.abs(step).max() < 0.02:
            break
    residual = np.where(finite, target - best, np.nan)
    pieces = _split(residual, runs, len(sigma))
    nominals = dict(zip(paths, (centre + scale * theta).tolist(), strict=True))
    return Recalibration(pieces, jacobian[finite], nominals, finite)


def weigh_part(
    recalibration: Recalibration, runs: Sequence[Run], signature: Sequence[Array], sigma: dict[str, float]
) -> Detection:
    """Return whether a part of the truth can be found, from the change that it makes to the noise-free signals."""
    scaled, _ = _stack(signature, runs, sigma)
    pieces = _split(scaled, runs, len(sigma))
    left = recalibration.project(pieces)
    whole = float(
        np.sqrt(sum(np.nansum(np.square(np.where(np.isnan(b), np.nan, a))) for a, b in zip(pieces, left, strict=True)))
    )
    kept = float(np.sqrt(sum(np.nansum(np.square(piece)) for piece in left)))
    share = kept / whole if whole > 0.0 else 0.0
    cells = find_cells(runs, left, list(sigma))
    largest = cells[0].sigmas if cells else 0.0
    seen = bool(largest >= SIGMAS and share >= KEPT_SHARE)
    return Detection(seen, share, largest, _count_experiments(runs, left))


def _count_experiments(runs: Sequence[Run], residual: Sequence[Array]) -> int:
    found = set()
    for run, values in zip(runs, residual, strict=True):
        measured = np.isfinite(values)
        square = np.where(measured, values, 0.0) ** 2
        if np.any(square.sum(axis=0) > VISIBLE_SIGMAS**2 * np.maximum(measured.sum(axis=0), 1)):
            found.add(run.experiment)
    return len(found)


def find_cells(runs: Sequence[Run], residual: Sequence[Array], channels: Sequence[str]) -> list[Cell]:
    """Return all cells with enough samples, the largest difference first.

    Args:
        runs: The campaign.
        residual: Difference [sigma] per run, (k, channels); NaN where nothing is measured.
        channels: Names of the columns.
    """
    sums: dict[tuple[str, str], list[float]] = {}
    for masks, values in zip(label_regimes(runs), residual, strict=True):
        for regime, mask in masks.items():
            for column, channel in enumerate(channels):
                part = values[mask, column]
                part = part[np.isfinite(part)]
                entry = sums.setdefault((channel, regime), [0.0, 0.0])
                entry[0] += float(np.sum(part**2))
                entry[1] += len(part)
    cells = [
        Cell(channel, regime, (square / count) ** 0.5)
        for (channel, regime), (square, count) in sums.items()
        if count >= CELL_SAMPLES
    ]
    return sorted(cells, key=lambda cell: (-cell.sigmas, cell.channel, cell.regime))


def _stack(signals: Sequence[Array], runs: Sequence[Run], sigma: dict[str, float]) -> tuple[Array, Mask]:
    """Return all measured channels of all runs in sigmas, in one row, and which of them the bench measures."""
    index = [channel_index(name) for name in sigma]
    scale = np.array(list(sigma.values()))
    values, used = [], []
    for signal, run in zip(signals, runs, strict=True):
        values.append((signal[:, index] / scale).ravel())
        used.append(np.isfinite(run.measured[:, index]).ravel())
    return np.concatenate(values), np.concatenate(used)


def _split(stacked: Array, runs: Sequence[Run], channels: int) -> list[Array]:
    """Return what `_stack` has joined, one array (k, channels) per run."""
    edges = np.cumsum([len(run.time_s) * channels for run in runs])[:-1]
    return [piece.reshape(-1, channels) for piece in np.split(stacked, edges)]


def _differentiate(predict: Callable[[Array], Array], theta: Array, base: Array) -> Array:
    columns = []
    for i in range(len(theta)):
        moved = theta.copy()
        moved[i] += 0.5
        columns.append((predict(moved) - base) / 0.5)
    return np.stack(columns, axis=1) if columns else np.zeros((len(base), 0))


def _cost(target: Array, value: Array, used: Mask, theta: Array) -> float:
    gap = (target - value)[used]
    cost = float(np.sum(gap**2) + np.sum(theta**2))
    return cost if np.isfinite(cost) else np.inf
