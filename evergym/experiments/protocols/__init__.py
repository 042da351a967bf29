"""The bench protocols: every experiment of the paper, run through the simulator and read as the authors did."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from evergym.errors import ConfigError
from evergym.experiments.protocols import catheter, sheath, system
from evergym.experiments.protocols.bench import ASSUMPTIONS
from evergym.model import Model

__all__ = ["ASSUMPTIONS", "PROTOCOLS", "simulate"]

PROTOCOLS: dict[str, Callable[[Model, str], NDArray[np.float64]]] = {
    "fig6_toward": catheter.simulate_tip_load,
    "fig6_opposite": catheter.simulate_tip_load,
    "fig6_90deg": catheter.simulate_tip_load,
    "fig7": catheter.simulate_tendon_pull,
    "fig8a": sheath.simulate_growth_curve,
    "fig8b": sheath.simulate_final_length,
    "fig8c": sheath.simulate_mean_speed,
    "fig9": sheath.simulate_gravity,
    "fig10": system.simulate_pressure,
    "fig11a": system.simulate_tip_load,
    "fig11b": system.simulate_tip_load,
    "fig11c": system.simulate_tip_load,
    "fig11d": system.simulate_tip_load,
    "tip_position": system.simulate_tip_position,
}
"""The protocol of every experiment."""


def simulate(model: Model, experiment: str) -> NDArray[np.float64]:
    """Return what a model gives for an experiment of the paper, in its unit and the order of its points.

    Raises:
        ConfigError: There is no such experiment.
        SimulationDiverged: The simulator found no equilibrium on the way.
    """
    if experiment not in PROTOCOLS:
        raise ConfigError(f"Unknown experiment {experiment!r}. The experiments are: {', '.join(PROTOCOLS)}.")
    return PROTOCOLS[experiment](model, experiment)
