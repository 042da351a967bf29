"""Predictions of a whole dataset by a model, each simulated once."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.channels import quantise_angles
from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.data.rig import Fidelity
from evergym.discrepancy.hook import UserEffect
from evergym.discrepancy.noise import find_repeats
from evergym.discrepancy.residual import Measurement
from evergym.discrepancy.setting import Setting, without_rounding
from evergym.discrepancy.simulate import Prediction
from evergym.discrepancy.workers import Workers, simulate_setting

__all__ = ["Predictor"]

Array = NDArray[np.float64]

CACHE_MAX = 2 * 1024**3
"""Bytes of simulated runs that are kept; the oldest go first."""


class Predictor:
    """Simulate the runs of a dataset; nothing is simulated twice.

    Args:
        dataset: The runs.
        measurement: Which samples are wanted.
        user_effects: The user's own effects by name.
        jobs: Processes; 1: none beside this one. With more, `close` must be called in the end.
        on_simulation: Called with the number of runs simulated so far.

    Attributes:
        fidelities: How finely each run is simulated.
        simulations: Runs simulated so far.
        failures: Why simulations stopped early, newest last.
    """

    def __init__(
        self,
        dataset: Dataset,
        measurement: Measurement,
        user_effects: Mapping[str, UserEffect] | None = None,
        jobs: int = 1,
        on_simulation: Callable[[int], None] | None = None,
    ) -> None:
        self.dataset, self.measurement = dataset, measurement
        self.user_effects = dict(user_effects or {})
        self.fidelities = [Fidelity.FAST for _ in dataset.runs]
        self.simulations = 0
        self.failures: list[str] = []
        self._on_simulation = on_simulation
        self._workers = Workers(dataset.runs, self.user_effects, jobs)
        self._twin = list(range(len(dataset.runs)))
        for group in find_repeats(dataset.runs):
            for index in group:
                self._twin[index] = group[0]
        self._inert: set[tuple[str, int]] = set()
        self._cache: OrderedDict[tuple[Setting, int, Fidelity], Array] = OrderedDict()
        self._cached = 0

    def close(self) -> None:
        """End the processes."""
        self._workers.close()

    def predict(self, setting: Setting, fidelity: Fidelity | None = None) -> Array:
        """Return the predicted value of every measured sample, shape (n,); NaN where the simulation failed.

        Args:
            setting: Model and the user's own effects.
            fidelity: For all runs; None: each run's own.
        """
        indices = range(len(self.dataset.runs))
        self._prefetch(((setting, index) for index in indices), fidelity)
        return self.measurement.flatten([self._predict_run(setting, index, fidelity) for index in indices])

    def predict_part(self, setting: Setting, runs: Sequence[int], elsewhere: Array) -> Array:
        """Return the predicted value of every sample of some runs, ``elsewhere`` (n,) for the others, shape (n,)."""
        self._prefetch(((setting, index) for index in runs), None)
        empty = np.full((0, len(CHANNELS)), np.nan)
        tables = [empty] * len(self.dataset.runs)
        for index in runs:
            tables[index] = self._predict_run(setting, index, None)
        return self.measurement.flatten(tables, elsewhere)

    def predict_changes(
        self, moves: Iterable[tuple[str, Setting]], setting: Setting, mark_inert: bool = False
    ) -> list[Array]:
        """Return the change of every sample from ``setting`` to each of several settings, each of shape (n,).

        Args:
            moves: (what is changed, the setting with the change).
            setting: The setting without.
            mark_inert: Remember the runs that no change of a name touches, and do not simulate them again for changes
                of that name: no growth law acts without a sheath. Only for changes that would show if they could.
        """
        moves = list(moves)
        indices = range(len(self.dataset.runs))
        wanted = [(setting, index) for index in indices]
        wanted += [(moved, i) for name, moved in moves for i in indices if (name, self._twin[i]) not in self._inert]
        self._prefetch(wanted, None)
        tables = [self._change(name, moved, setting) for name, moved in moves]
        if mark_inert:
            for name in {name for name, _ in moves}:
                mine = [table for (other, _), table in zip(moves, tables, strict=True) if other == name]
                for index in indices:
                    if not any(table[index].any() for table in mine):
                        self._inert.add((name, self._twin[index]))
        return [self.measurement.flatten(table) for table in tables]

    def simulate(self, setting: Setting, run: Run, fidelity: Fidelity | None = None) -> Array:
        """Return the predicted channels of any run, of the dataset or not, shape (k, 9); it is not remembered."""
        prediction = simulate_setting(setting, run, fidelity or Fidelity.FAST, self.user_effects)
        self._count(prediction)
        return prediction.channels

    def _change(self, name: str, moved: Setting, setting: Setting) -> list[Array]:
        tables = []
        for index, run in enumerate(self.dataset.runs):
            if (name, self._twin[index]) in self._inert:
                tables.append(np.zeros((len(run.time_s), len(CHANNELS))))
            else:
                tables.append(self._predict_run(moved, index, None) - self._predict_run(setting, index, None))
        return tables

    def _key(self, setting: Setting, index: int, fidelity: Fidelity | None) -> tuple[Setting, int, Fidelity]:
        index = self._twin[index]  # repeats are one simulation
        return without_rounding(setting), index, self.fidelities[index] if fidelity is None else fidelity

    def _predict_run(self, setting: Setting, index: int, fidelity: Fidelity | None) -> Array:
        key = self._key(setting, index, fidelity)
        table = self._cache.get(key)
        if table is None:
            prediction = simulate_setting(key[0], self.dataset.runs[key[1]], key[2], self.user_effects)
            table = self._keep(key, prediction)
        return quantise_angles(table, setting.model)

    def _prefetch(self, wanted: Iterable[tuple[Setting, int]], fidelity: Fidelity | None) -> None:
        if not self._workers.active:
            return
        keys = dict.fromkeys(self._key(setting, index, fidelity) for setting, index in wanted)
        missing = [key for key in keys if key not in self._cache]
        if len(missing) > 1:
            for key, prediction in zip(missing, self._workers.simulate(missing), strict=True):
                self._keep(key, prediction)

    def _keep(self, key: tuple[Setting, int, Fidelity], prediction: Prediction) -> Array:
        self._count(prediction)
        self._cache[key] = prediction.channels
        self._cached += prediction.channels.nbytes
        while self._cached > CACHE_MAX and len(self._cache) > 1:
            self._cached -= self._cache.popitem(last=False)[1].nbytes
        return prediction.channels

    def _count(self, prediction: Prediction) -> None:
        self.simulations += 1
        if prediction.failure:
            self.failures.append(prediction.failure)
        if self._on_simulation is not None:
            self._on_simulation(self.simulations)
