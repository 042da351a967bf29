"""One fit: the values of the free parameters at which the simulator is closest to a set of readings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from evergym.errors import ConfigError, SimulationDiverged
from evergym.experiments.bars import BARS
from evergym.experiments.identification.free import FreeParameter, set_values
from evergym.experiments.paper import load_experiment
from evergym.experiments.protocols import simulate
from evergym.model import Model

__all__ = ["FitResult", "Selection", "compute_residuals", "fit", "select"]

Array = NDArray[np.float64]

SCALES = {name: bar.fitted for name, bar in BARS.items()} | {"fig8a": 5.0}
"""What counts as one, per experiment and in its unit: the error that the project allows itself. Fig. 8a: as Fig. 8b."""

DIFFERENCE_STEP = 3e-3
"""Step of the derivatives, as a share of a parameter's range: far above the solver's tolerance."""

ROBUST_SCALE = 0.5
"""Beyond this share of the scale (over the root of the number of points), residuals count linearly, as they do in the
mean absolute error that is judged."""


class Selection(NamedTuple):
    """Readings of one experiment that a fit sees: its name, and their rows."""

    experiment: str
    rows: tuple[int, ...]


class FitResult(NamedTuple):
    """What a fit found.

    Attributes:
        values: Of the free parameters, in their order and unit, shape (k,).
        jacobian: Derivative of the scaled residuals by the parameters over their range, shape (n, k).
        cost: Half the sum of the robust squares.
        residuals: Scaled, shape (n,).
    """

    values: Array
    jacobian: Array
    cost: float
    residuals: Array


def select(experiments: Sequence[str], *, without: str = "") -> list[Selection]:
    """Return all readings of the experiments but those of ``without``: an experiment, or a growth curve "v1_120"."""
    chosen = []
    for name in experiments:
        points = load_experiment(name).points
        if name == without:
            continue
        rows = list(range(len(points)))
        if "curve" in points:
            rows = [row for row in rows if points.curve.iloc[row] != without]
        chosen.append(Selection(name, tuple(rows)))
    return chosen


def compute_residuals(model: Model, selections: Sequence[Selection]) -> Array:
    """Return simulated less measured, over the scale of the experiment and the root of the number of its readings."""
    return np.concatenate([_compute_part(model, selection) for selection in selections])


def _compute_part(model: Model, selection: Selection) -> Array:
    experiment, rows = selection
    deviations = load_experiment(experiment).compute_deviations(simulate(model, experiment))[list(rows)]
    return np.asarray(deviations / (SCALES[experiment] * np.sqrt(len(rows))))


def fit(
    base: Model,
    free: Sequence[FreeParameter],
    selections: Sequence[Selection],
    *,
    start: Array | None = None,
    evaluations_max: int = 12,
) -> FitResult:
    """Fit the free parameters of ``base`` to the selected readings, by robust least squares within their bounds.

    A prior counts as much as a figure that is off by its scale where the parameter is off by one standard deviation.

    Args:
        base: The model whose other values stay.
        free: What is fitted.
        selections: What it is fitted to.
        start: First values; None: those of ``free``.
        evaluations_max: Steps of the optimiser; each takes one simulation per parameter more.
    """
    low = np.array([parameter.low for parameter in free])
    span = np.array([parameter.high for parameter in free]) - low
    first = np.array([parameter.start for parameter in free]) if start is None else start
    paths = [parameter.path for parameter in free]

    acting = [
        [i for i, parameter in enumerate(free) if any(name.startswith(figure) for figure in parameter.figures)]
        for name, _ in selections
    ]
    known: dict[tuple[float | str, ...], Array] = {}
    priors = [(i, *parameter.prior) for i, parameter in enumerate(free) if parameter.prior is not None]

    def evaluate(position: Array) -> Array:
        parts = []
        for selection, indices in zip(selections, acting, strict=True):
            # A figure is simulated again only where a parameter has moved that acts in it.
            key = (selection.experiment, *position[indices].tolist())
            if key not in known:
                try:
                    model = set_values(base, paths, (low + position * span).tolist())
                    known[key] = _compute_part(model, selection)
                except (SimulationDiverged, ConfigError):
                    known[key] = np.full(len(selection.rows), 1e3)  # no robot: as far away as can be
            parts.append(known[key])
        values = low + position * span
        parts.append(np.array([(values[i] - mean) / deviation for i, mean, deviation in priors]))
        return np.concatenate(parts)

    found = least_squares(
        evaluate,
        np.clip((first - low) / span, 1e-3, 1.0 - 1e-3),
        bounds=(0.0, 1.0),
        diff_step=np.full(len(free), DIFFERENCE_STEP),
        loss="soft_l1",
        f_scale=ROBUST_SCALE,
        max_nfev=evaluations_max,
        ftol=1e-4,
        xtol=1e-5,
    )
    return FitResult(low + found.x * span, np.asarray(found.jac), float(found.cost), np.asarray(found.fun))
