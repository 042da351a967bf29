"""The experiment to do next: the feasible one in which the rival explanations differ most, each refitted.

T-optimal design (Atkinson and Fedorov 1975; Hunter and Reiner 1965): for every profile, the whitened distance between
the predictions of two rivals, after the rival has been refitted to the prediction of the best within what the existing
data leave open. The profile with the largest such distance is chosen; with several rivals, with the largest least one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.fit import Fit
from evergym.discrepancy.noise import NoiseModel, whitening_matrix
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.profiles import Profile

__all__ = ["NextExperiment", "choose_next"]

Array = NDArray[np.float64]

DIRECTIONS_MAX = 6
"""Directions of a rival's unknowns along which it is refitted: those that the data leave most open."""


@dataclass(frozen=True)
class NextExperiment:
    """The experiment that would tell most.

    Attributes:
        profile: Its commands.
        why: One clause.
        distance: Least distance of the rivals there [sigma, all samples together].
        median: The same of the median profile.
    """

    profile: Profile
    why: str
    distance: float
    median: float

    def describe(self, commands: str) -> dict[str, Any]:
        """Return what it takes to do it, beside the file of its commands."""
        run = self.profile.run
        return {
            "why": self.why,
            "commands": commands,
            "title": self.profile.title,
            "setup": run.setup,
            "gravity_mps2": list(run.gravity),
            "initial_everted_length_mm": round(run.initial_everted_length_mm, 1),
        }


def choose_next(
    predictor: Predictor, noise: NoiseModel, profiles: Sequence[Profile], best: Fit, rivals: Sequence[Fit], why: str
) -> NextExperiment | None:
    """Return the profile in which ``best`` and its rivals differ most, or None if they differ in none.

    Args:
        predictor: Simulations.
        noise: Of each channel; the same channels are taken to be measured.
        profiles: Feasible runs.
        best: The best explanation.
        rivals: The others, or the recalibrated model to see whether an effect is there at all.
        why: What it separates, for the result.
    """
    if not rivals or not profiles:
        return None
    directions = [_open_directions(rival) for rival in rivals]
    least = np.zeros(len(profiles))
    for index, profile in enumerate(profiles):
        whiten = _Whitener(noise, profile.run.time_s)
        reference = whiten(predictor.simulate(best.space.setting(best.z), profile.run))
        distances = [
            _distance(predictor, profile, whiten, reference, rival, open_)
            for rival, open_ in zip(rivals, directions, strict=True)
        ]
        least[index] = min(distances)
    order = int(np.argmax(least))
    if least[order] < 1.0:
        return None
    return NextExperiment(profiles[order], why, float(least[order]), float(np.median(least)))


class _Whitener:
    """Whitens the measured channels of a run that has not been done."""

    def __init__(self, noise: NoiseModel, time: Array) -> None:
        self.parts = [(CHANNELS.index(name), whitening_matrix(part, time)) for name, part in noise.channels.items()]

    def __call__(self, table: Array) -> Array:
        """Return the whitened channels one after another; where a simulation failed, zero."""
        filled = np.where(np.isfinite(table), table, 0.0)
        return np.concatenate([matrix @ filled[:, channel] for channel, matrix in self.parts])


def _open_directions(fit: Fit) -> Array:
    """Return steps in z that the existing data leave open, each one standard deviation long, shape (d, m)."""
    size = fit.space.size
    if size == 0:
        return np.zeros((0, 0))
    precision = fit.jacobian.T @ fit.jacobian + np.diag(fit.space.prior_precision + 1e-6)
    values, vectors = np.linalg.eigh(precision)
    steps: Array = (vectors / np.sqrt(values)).T[: min(DIRECTIONS_MAX, size)]
    return steps


def _distance(
    predictor: Predictor, profile: Profile, whiten: _Whitener, reference: Array, rival: Fit, directions: Array
) -> float:
    low, high = rival.space.limits
    there = whiten(predictor.simulate(rival.space.setting(rival.z), profile.run))
    difference = reference - there
    columns = []
    for step in directions:
        moved = np.clip(rival.z + step, low, high)
        columns.append(whiten(predictor.simulate(rival.space.setting(moved), profile.run)) - there)
    if columns:
        jacobian = np.stack(columns, axis=1)
        normal = jacobian.T @ jacobian + np.eye(len(columns))
        refit = np.linalg.solve(normal, jacobian.T @ difference)
        rest = difference - jacobian @ refit
        return float(np.sqrt(rest @ rest + refit @ refit))
    return float(np.linalg.norm(difference))
