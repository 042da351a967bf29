"""The models that are compared with the experiments: fitted to all, predicted from the components, one figure left out.

Every model file here is the result of ``evergym identify``; nothing is tuned by hand.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from importlib import resources
from typing import Any

from evergym.config import build, to_mapping
from evergym.errors import ConfigError
from evergym.experiments.experiment import Experiment
from evergym.model import Model, check_model, load_model

__all__ = ["FITTED_MODEL", "PREDICTED_EXPERIMENTS", "PREDICTED_MODEL", "Column", "ParameterSets", "load_parameter_sets"]

FITTED_MODEL = "mammobot_2023_fitted"
"""One parameter set for all figures."""
PREDICTED_MODEL = "mammobot_2023_predicted"
"""Component experiments (Figs. 6 to 9) and the full system's lost tendon motion from one point of Fig. 10."""
PREDICTED_EXPERIMENTS = ("fig10", "fig11a", "fig11b", "fig11c", "fig11d", "tip_position")
"""The system experiments, which `PREDICTED_MODEL` has not seen."""


class Column(Enum):
    """How a column of the table got its parameters."""

    FITTED = "fitted"
    """All figures, one parameter set."""
    PREDICTED = "predicted"
    """The system experiments, from the component experiments."""
    LEFT_OUT = "left_out"
    """Each figure (for Fig. 8: each curve), from all the others."""


@dataclass(frozen=True)
class ParameterSets:
    """The models of the columns.

    Attributes:
        fitted: The model that is validated.
        predicted: Model for the system experiments; None: the column stays empty.
        left_out: Models that have not seen something, by what that is: a figure ("fig9", "fig11"), an experiment
            ("fig11a") or a growth curve ("fig8_v1_120").
    """

    fitted: Model
    predicted: Model | None = None
    left_out: Mapping[str, Model] = field(default_factory=dict)

    def assign(self, column: Column, experiment: Experiment) -> dict[str, tuple[Model, list[int]]]:
        """Return which model gives which values of an experiment, by the name of the parameter set."""
        rows = list(range(len(experiment.points)))
        if column is Column.FITTED:
            return {"fitted": (self.fitted, rows)}
        if column is Column.PREDICTED:
            known = self.predicted is not None and experiment.name in PREDICTED_EXPERIMENTS
            return {"predicted": (self.predicted, rows)} if self.predicted is not None and known else {}
        chosen: dict[str, tuple[Model, list[int]]] = {}
        for row, names in enumerate(_name_left_out(experiment)):
            name = next((name for name in names if name in self.left_out), None)
            if name is not None:
                chosen.setdefault(name, (self.left_out[name], []))[1].append(row)
        return chosen


def load_parameter_sets() -> ParameterSets:
    """Return the parameter sets that ship with the package.

    Raises:
        ConfigError: A file of them is missing or does not fit the model's schema.
    """
    fitted = load_model(FITTED_MODEL)
    left_out = {}
    folder = resources.files("evergym.experiments") / "left_out"
    if folder.is_dir():
        for file in sorted(folder.iterdir(), key=lambda file: file.name):
            if file.name.endswith(".toml"):
                name = file.name.removesuffix(".toml")
                left_out[name] = override(fitted, tomllib.loads(file.read_text(encoding="utf-8")), file.name)
    return ParameterSets(fitted, load_model(PREDICTED_MODEL), left_out)


def override(model: Model, values: Mapping[str, Any], where: str) -> Model:
    """Return ``model`` with the given values, nested as in a model file, in place of its own.

    Raises:
        ConfigError: A key is unknown or a value impossible.
    """
    return check_model(build(Model, _merge(to_mapping(model), values, where), where), where)


def _merge(base: Mapping[str, Any], values: Mapping[str, Any], where: str) -> dict[str, Any]:
    merged = dict(base)
    for key, value in values.items():
        below = base.get(key)
        if isinstance(below, Mapping) and not isinstance(value, Mapping):
            raise ConfigError(f"{where}: '{key}' is {value!r}; it must be a table of values. Write it as [{key}].")
        merged[key] = _merge(below, value, where) if isinstance(below, Mapping) else value
    return merged


def _name_left_out(experiment: Experiment) -> list[tuple[str, ...]]:
    """Names under which a model that has not seen a value may be found, the most specific first, for every value."""
    if "curve" in experiment.points:
        return [(f"fig8_{curve}", "fig8") for curve in experiment.points.curve]
    # The tip positions are computed from the readings of Fig. 10.
    name = "fig10" if experiment.name == "tip_position" else experiment.name
    figure = re.match(r"fig\d+", name)
    names = (name, figure.group()) if figure else (name,)
    return [names] * len(experiment.points)
