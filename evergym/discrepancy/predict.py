"""Predictions of a whole dataset by a model, each simulated once."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.columns import CHANNELS
from evergym.discrepancy.dataset import Dataset, Run
from evergym.discrepancy.hook import Hook, UserEffect
from evergym.discrepancy.noise import find_repeats
from evergym.discrepancy.residual import Measurement
from evergym.discrepancy.rig import Fidelity, choose_numerics
from evergym.discrepancy.simulate import try_simulate_run
from evergym.model import Model, Numerics

__all__ = ["Predictor", "Setting"]

Array = NDArray[np.float64]

CACHE_MAX = 40_000
"""Simulated runs kept; the oldest go first."""


@dataclass(frozen=True)
class Setting:
    """A model together with a user's own effects at given strengths: all that a prediction depends on."""

    model: Model
    user: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = ()
    """(effect, ((parameter, value), ...)) of the user's own effects."""


class Predictor:
    """Simulate the runs of a dataset; nothing is simulated twice.

    Args:
        dataset: The runs.
        measurement: Which samples are wanted.
        user_effects: The user's own effects by name.
        fidelity: How finely to simulate.
        on_simulation: Called with the number of runs simulated so far.

    Attributes:
        simulations: Runs simulated so far.
        failures: Why simulations stopped early, newest last.
    """

    def __init__(
        self,
        dataset: Dataset,
        measurement: Measurement,
        user_effects: Mapping[str, UserEffect] | None = None,
        fidelity: Fidelity = Fidelity.FAST,
        on_simulation: Callable[[int], None] | None = None,
    ) -> None:
        self.dataset, self.measurement = dataset, measurement
        self.user_effects = dict(user_effects or {})
        self.fidelity = fidelity
        self.simulations = 0
        self.failures: list[str] = []
        self._on_simulation = on_simulation
        self._twin = list(range(len(dataset.runs)))
        for group in find_repeats(dataset.runs):
            for index in group:
                self._twin[index] = group[0]
        self._inert: set[tuple[str, int]] = set()
        self._cache: OrderedDict[tuple[Setting, int, Fidelity], Array] = OrderedDict()

    def predict(self, setting: Setting, fidelity: Fidelity | None = None) -> Array:
        """Return the predicted value of every measured sample, shape (n,); NaN where the simulation failed."""
        fidelity = self.fidelity if fidelity is None else fidelity
        tables = [self.predict_run(setting, index, fidelity) for index in range(len(self.dataset.runs))]
        return self.measurement.flatten(tables)

    def predict_run(self, setting: Setting, index: int, fidelity: Fidelity | None = None) -> Array:
        """Return the predicted channels of one run, shape (k, 9)."""
        fidelity = self.fidelity if fidelity is None else fidelity
        index = self._twin[index]  # repeats are one simulation
        key = (setting, index, fidelity)
        table = self._cache.get(key)
        if table is None:
            run = self.dataset.runs[index]
            table = self.simulate(setting, run, fidelity)
            self._cache[key] = table
            if len(self._cache) > CACHE_MAX:
                self._cache.popitem(last=False)
        return table

    def predict_change(self, path: str, moved: Setting, setting: Setting) -> Array:
        """Return the change of every sample from ``setting`` to ``moved``, which differ in one parameter, shape (n,).

        A run that the parameter was found not to touch is not simulated again: no growth law acts without a sheath.
        """
        tables = []
        for index in range(len(self.dataset.runs)):
            if (path, self._twin[index]) in self._inert:
                tables.append(np.zeros((len(self.dataset.runs[index].time_s), len(CHANNELS))))
                continue
            change = self.predict_run(moved, index) - self.predict_run(setting, index)
            if not change.any():
                self._inert.add((path, self._twin[index]))
            tables.append(change)
        return self.measurement.flatten(tables)

    def simulate(self, setting: Setting, run: Run, fidelity: Fidelity | None = None) -> Array:
        """Return the predicted channels of any run, of the dataset or not, shape (k, 9)."""
        numerics = self._numerics(setting.model, run.setup, self.fidelity if fidelity is None else fidelity)
        prediction = try_simulate_run(setting.model, run, numerics, self._hooks(setting))
        self.simulations += 1
        if prediction.failure:
            self.failures.append(prediction.failure)
        if self._on_simulation is not None:
            self._on_simulation(self.simulations)
        return prediction.channels

    def _numerics(self, model: Model, setup: str, fidelity: Fidelity) -> Numerics:
        return choose_numerics(model, setup, fidelity)

    def _hooks(self, setting: Setting) -> tuple[Hook, ...]:
        return tuple(self.user_effects[name].create_hook(dict(values)) for name, values in setting.user)
