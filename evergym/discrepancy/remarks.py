"""What a reader of a diagnosis must know beside its conclusion, each in a sentence."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.calibrate import ParameterEstimate
from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.dataset import Dataset
from evergym.discrepancy.noise import NoiseModel
from evergym.discrepancy.residual import Measurement

__all__ = ["remark_failures", "remark_limits", "remark_own_effects", "remark_scatter", "remark_strain"]

Array = NDArray[np.float64]

SCATTER_FACTOR = 1.5
"""Scatter from sample to sample beyond this many times the noise is worth a remark."""
NEIGHBOURS_S = 0.5
"""Samples farther apart than this are no neighbours [s]: between them the robot goes elsewhere."""
PAIRS_MIN = 30
"""Pairs of neighbouring samples that it takes to say so."""


def remark_scatter(dataset: Dataset, measurement: Measurement, noise: NoiseModel, prediction: Array) -> list[str]:
    """Return the channels whose residual jumps from sample to sample more than their noise says.

    A model that is wrong is wrong for a while; noise that was stated too small shows in every pair of neighbours. (The
    median of second differences is not moved by the few samples in which a robot jumps.)

    Args:
        dataset: The runs.
        measurement: The samples.
        noise: Their noise as taken.
        prediction: Of the best model [channel's unit], (n,).
    """
    residual = measurement.value - prediction
    remarks = []
    for channel in sorted(set(measurement.channel.tolist())):
        jumps = []
        for run in sorted(set(measurement.run.tolist())):
            places = np.flatnonzero((measurement.run == run) & (measurement.channel == channel))
            mine, time = residual[places], dataset.runs[run].time_s[measurement.row[places]]
            jumps.append((mine[2:] - 2.0 * mine[1:-1] + mine[:-2])[time[2:] - time[:-2] <= 2.0 * NEIGHBOURS_S])
        second = np.concatenate(jumps)
        second = np.abs(second[np.isfinite(second)])
        if len(second) < PAIRS_MIN:
            continue
        # White noise of unit size has second differences of size sqrt(6), and a median of 0.6745 times that.
        scatter = float(np.median(second)) / (0.6745 * np.sqrt(6.0))
        name = CHANNELS[channel]
        stated = noise.channels[name].total
        if scatter > SCATTER_FACTOR * stated:
            remarks.append(
                f"{name} scatters from sample to sample by {scatter:.3g}, {scatter / stated:.1f} times the noise of "
                f"{stated:.3g} that it is judged by: check [noise] in dataset.toml before believing that anything is "
                "missing"
            )
    return remarks


def remark_failures(
    dataset: Dataset, measurement: Measurement, prediction: Array, failures: Sequence[str]
) -> list[str]:
    """Return the runs that the best model cannot be simulated through.

    Args:
        dataset: The runs.
        measurement: The samples.
        prediction: Of the best model [channel's unit], (n,); NaN where the simulation failed.
        failures: Why simulations stopped early, newest last, each beginning with its run.
    """
    failed = [dataset.runs[i].id for i in sorted(set(measurement.run[~np.isfinite(prediction)].tolist()))]
    remarks = []
    for run in failed:
        why = next((text for text in reversed(failures) if text.startswith(f"run '{run}':")), f"run '{run}'")
        remarks.append(f"the model cannot be simulated to the end of a run, which counts as far off there: {why}")
    return remarks


def remark_limits(calibration: Sequence[ParameterEstimate]) -> list[str]:
    """Return which nominal parameters went as far as recalibration may take them."""
    names = [estimate.path for estimate in calibration if estimate.at_limit]
    if not names:
        return []
    taken = f"recalibration took {', '.join(names)} to a limit (three tolerances, or the end of its range)"
    return [f"{taken}: measure them, or doubt the values found for them"]


def remark_strain(recalibrated: Sequence[ParameterEstimate]) -> list[str]:
    """Return that the recalibrated model agrees as well, and what it takes for that.

    Args:
        recalibrated: Nominal parameters of the model without an effect, which agrees.
    """
    far = [one for one in sorted(recalibrated, key=_count_tolerances, reverse=True) if _count_tolerances(one) > 1.0][:3]
    moves = ", ".join(f"{one.path} by {_count_tolerances(one):.1f} tolerances" for one in far)
    agrees = f"without the effect the recalibrated model agrees with these runs, too, but it takes {moves}"
    return [f"{agrees}: measure these parameters, and the name is confirmed or refuted"]


def _count_tolerances(estimate: ParameterEstimate) -> float:
    return abs(estimate.estimate - estimate.nominal) / estimate.tolerance


def remark_own_effects(named: Sequence[str], own: Collection[str]) -> list[str]:
    """Return that a model file cannot hold the user's own effects."""
    return [
        f"{name} is an effect of your own, which no model file can hold: model.toml is without it"
        for name in named
        if name in own
    ]
