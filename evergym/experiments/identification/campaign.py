"""Run an identification: all its fits, on all cores, each kept in a file so that an interrupted run goes on."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import joblib
import numpy as np
from numpy.typing import NDArray

from evergym import stepper
from evergym.cache import compute_source_digest
from evergym.experiments.identification.fit import FitResult, fit
from evergym.experiments.identification.free import GROWTH_LAWS, LAW_COEFFICIENTS, clear_growth_law, set_values
from evergym.experiments.identification.plan import (
    ARMS_MM,
    GROWTH_CURVES,
    LEFT_OUT_FIGURES,
    Task,
    plan_alternatives,
    plan_first,
    plan_left_out,
)
from evergym.model import Model
from evergym.whole_file import write_whole

__all__ = ["Identification", "identify"]

Array = NDArray[np.float64]


class Identification(NamedTuple):
    """All fits of an identification.

    Attributes:
        base: The model that it started from.
        law: The growth law with the lowest cost.
        fits: By name, see `evergym.experiments.identification.plan`.
        paths: What was free in each of them.
    """

    base: Model
    law: str
    fits: dict[str, FitResult]
    paths: dict[str, list[str]]

    @property
    def fitted(self) -> Model:
        """Statics and growth fitted to all figures."""
        return self.combine("statics", f"growth_{self.law}")

    @property
    def predicted(self) -> Model:
        """Statics of the component experiments and one point of Fig. 10; growth as fitted."""
        return self.combine("components", "predicted", f"growth_{self.law}")

    def combine(self, *names: str) -> Model:
        """Return the base model with the values of some fits."""
        model = self.base
        for name in names:
            if any(path in LAW_COEFFICIENTS for path in self.paths[name]):
                model = clear_growth_law(model)
            model = set_values(model, self.paths[name], self.fits[name].values.tolist())
        return model


def identify(
    base: Model,
    folder: Path,
    *,
    evaluations_max: int = 25,
    workers: int = -1,
    on_progress: Callable[[int, int], None] | None = None,
) -> Identification:
    """Fit statics and growth to all figures, then once more without each of them.

    Args:
        base: The model whose other values stay; its play must be off.
        folder: Keeps one file per finished fit.
        evaluations_max: Steps of the optimiser.
        workers: Processes; -1: one per core.
        on_progress: Called with fits done and fits in all.
    """
    folder.mkdir(parents=True, exist_ok=True)
    first = plan_first(base, evaluations_max)
    total = len(first) + len(ARMS_MM) + 1 + len(LEFT_OUT_FIGURES) + len(GROWTH_CURVES)
    fits: dict[str, FitResult] = {}
    paths: dict[str, list[str]] = {}

    def run(tasks: Sequence[Task]) -> None:
        stream = joblib.Parallel(n_jobs=workers, return_as="generator")(
            joblib.delayed(_run_task)(task, folder) for task in tasks
        )
        for task, result in zip(tasks, stream, strict=True):
            fits[task.name] = result
            paths[task.name] = [parameter.path for parameter in task.free]
            if on_progress is not None:
                on_progress(len(fits), total)

    run(first)
    law = min(GROWTH_LAWS, key=lambda name: fits[f"growth_{name}"].cost)
    found = Identification(base, law, fits, paths)
    statics = fits["statics"].values.tolist()
    run(plan_alternatives(base, statics, found.combine("components"), evaluations_max))
    run(plan_left_out(base, law, evaluations_max))
    return found


def _run_task(task: Task, folder: Path) -> FitResult:
    """Return the result of a fit, from its file if that was made from the same input by the same physics."""
    path = folder / f"{task.name}.json"
    digest = f"{task.compute_digest()}-{compute_source_digest(Path(stepper.__file__))[:16]}"
    if path.exists():
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["digest"] == digest:
            values, jacobian, residuals = (np.array(kept[key]) for key in ("values", "jacobian", "residuals"))
            return FitResult(values, jacobian, float(kept["cost"]), residuals)
    result = fit(task.base, task.free, task.selections, evaluations_max=task.evaluations_max)
    content = {
        "digest": digest,
        "values": result.values.tolist(),
        "jacobian": result.jacobian.tolist(),
        "cost": result.cost,
        "residuals": result.residuals.tolist(),
    }
    write_whole(path, json.dumps(content))
    return result
