"""What an identification says about its parameters: uncertainties, what it cannot tell, and the files it writes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from evergym.config import to_mapping
from evergym.experiments.identification.campaign import Identification
from evergym.experiments.identification.free import BENDING, GROWTH_LAWS, FreeParameter, make_tables
from evergym.experiments.identification.plan import ARMS_MM, GROWTH_CURVES, LEFT_OUT_FIGURES
from evergym.experiments.parameter_sets import FITTED_MODEL, PREDICTED_MODEL
from evergym.experiments.provenance import dump_model
from evergym.model import Model
from evergym.whole_file import write_whole

__all__ = ["describe", "write_models"]

Array = NDArray[np.float64]

WEAK_SHARE = 0.5
"""A parameter whose uncertainty exceeds this share of its value is called weakly identified."""
CORRELATION_MAX = 0.95
"""Parameters more correlated than this are known only together."""
SIMILAR_COST = 1.3
"""Alternatives whose cost is within this factor of the best cannot be told from it."""


def describe(found: Identification) -> dict[str, Any]:
    """Return the findings as plain values: estimates, what is not identifiable, and the alternatives' costs."""
    growth = f"growth_{found.law}"
    records = {
        **_describe_group(found, BENDING, "statics", [f"without_{name}" for name in LEFT_OUT_FIGURES]),
        **_describe_group(found, GROWTH_LAWS[found.law], growth, [f"without_fig8_{curve}" for curve in GROWTH_CURVES]),
    }
    best = found.fits[growth].cost
    laws = {law: found.fits[f"growth_{law}"].cost / best for law in GROWTH_LAWS}
    arms = {f"{arm:g}": found.fits[f"arm_{arm:g}"].cost / found.fits["statics"].cost for arm in ARMS_MM}
    notes = [
        f"{path}: weakly identified, {record['estimate']:.3g} +- {record['uncertainty']:.2g}"
        for path, record in records.items()
        if record["uncertainty"] > WEAK_SHARE * abs(record["estimate"])
    ]
    for name, free in (("statics", BENDING), (growth, GROWTH_LAWS[found.law])):
        correlation = _compute_correlation(found.fits[name].jacobian)
        for i, j in zip(*np.triu_indices(len(free), 1), strict=True):
            if abs(correlation[i, j]) > CORRELATION_MAX:
                notes.append(f"{free[i].path} and {free[j].path}: known only together (r = {correlation[i, j]:.2f})")
    same = [law for law, ratio in laws.items() if law != found.law and ratio < SIMILAR_COST]
    if same:
        notes.append(f"growth law: {found.law} fits best, {' and '.join(same)} cannot be told from it by Fig. 8")
    same = [arm for arm, ratio in arms.items() if ratio < SIMILAR_COST]
    if same:
        notes.append(f"robot.tendon_arm_mm: {' and '.join(same)} mm do as well, with another line compliance")
    return {
        "parameters": records,
        "not_identifiable": notes,
        "growth_law": found.law,
        "growth_law_cost_over_best": laws,
        "tendon_arm_mm_cost_over_fitted": arms,
    }


def write_models(found: Identification, folder: Path) -> list[Path]:
    """Write the fitted, predicted and alternative models, and what each left-out fit changes in the fitted one."""
    records = describe(found)["parameters"]
    words = {
        path: f"{_name_figures(record['figures'])} +- {record['uncertainty']:.2g} (jackknife over figures)"
        for path, record in records.items()
    }
    growth = f"growth_{found.law}"
    files = {
        f"{FITTED_MODEL}.toml": _dump(found.fitted, FITTED_MODEL, words),
        f"{PREDICTED_MODEL}.toml": _dump(found.predicted, PREDICTED_MODEL, _describe_prediction(words)),
        "identification.json": json.dumps(describe(found), indent=2) + "\n",
    }
    for law, free in GROWTH_LAWS.items():
        if law != found.law:
            name = f"{FITTED_MODEL}_{law}"
            own = {parameter.path: f"Fig. 8, {law} law of the tail's friction" for parameter in free}
            files[f"{name}.toml"] = _dump(found.combine("statics", f"growth_{law}"), name, words | own)
    for name in found.fits:
        if name.startswith("without_"):
            parts = ("statics", name) if name.startswith("without_fig8") else (growth, name)
            values = _find_changes(found.fitted, found.combine(*parts))
            files[f"left_out/{name.removeprefix('without_')}.toml"] = tomli_w.dumps(make_tables(values))
    (folder / "left_out").mkdir(parents=True, exist_ok=True)
    paths = []
    for name, text in files.items():
        write_whole(folder / name, text)
        paths.append(folder / name)
    return paths


def _describe_group(
    found: Identification, free: tuple[FreeParameter, ...], name: str, left_out: list[str]
) -> dict[str, dict[str, Any]]:
    estimates = found.fits[name].values
    others = np.array([found.fits[other].values for other in left_out])
    # Whole figures are left out: what one says too much or too little for its size is part of the uncertainty.
    count = len(others)
    spread = np.sqrt((count - 1) / count * np.sum((others - others.mean(axis=0)) ** 2, axis=0))
    return {
        parameter.path: {
            "estimate": float(estimates[i]),
            "uncertainty": float(spread[i]),
            "low": parameter.low,
            "high": parameter.high,
            "figures": list(parameter.figures),
        }
        for i, parameter in enumerate(free)
    }


def _compute_correlation(jacobian: Array) -> Array:
    """Return the correlation of the estimates, shape (k, k), from the derivatives of the residuals."""
    covariance = np.linalg.pinv(jacobian.T @ jacobian)
    size = np.sqrt(np.clip(np.diag(covariance), 1e-300, None))
    return np.asarray(covariance / np.outer(size, size))


def _describe_prediction(words: Mapping[str, str]) -> dict[str, str]:
    text = {path: line for path, line in words.items() if "Fig. 8" in line}
    for parameter in BENDING:
        text[parameter.path] = "component experiments, Figs. 6, 7 and 9"
    text["effects.tendon_backlash.lost_motion_mm"] = "one point of Fig. 10 (130 kPa absolute)"
    text["effects.clearance_play.angle_deg"] = "off: the component experiments do not know it"
    return text


def _name_figures(figures: list[str]) -> str:
    numbers = list(dict.fromkeys(figure.removeprefix("fig").rstrip("abcd") for figure in figures))
    return f"Fig{'s' if len(numbers) > 1 else ''}. {', '.join(numbers)}"


def _dump(model: Model, name: str, words: Mapping[str, str]) -> str:
    return dump_model(replace(model, name=name), words)


def _find_changes(model: Model, other: Model) -> dict[str, float]:
    """Return the values by path in which ``other`` differs from ``model``."""
    changes = {}
    for table in ("robot", "effects"):
        for key, value in to_mapping(getattr(other, table)).items():
            own = to_mapping(getattr(model, table))[key]
            if isinstance(value, dict):
                changes.update({f"{table}.{key}.{k}": v for k, v in value.items() if v != own[k]})
            elif value != own:
                changes[f"{table}.{key}"] = value
    return changes
