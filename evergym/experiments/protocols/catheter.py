"""Figs. 6 and 7: the catheter alone, its tip loaded with the tendon removed, and its tendon pulled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evergym.experiments.paper import READING_LENGTH, load_experiment
from evergym.experiments.protocols.bench import DOWN, bend, hang, mount, read_angle, remove_tendon
from evergym.model import Model
from evergym.simulator import Command

__all__ = ["simulate_tendon_pull", "simulate_tip_load"]

_SETTLING_TIME = 6.0
"""Robot time between two pulls [s]; the catheter settles in a tenth of a second."""


def simulate_tip_load(model: Model, name: str) -> NDArray[np.float64]:
    """Return the curvatures in the notch plane [1/m] of "fig6_toward", "fig6_opposite" or "fig6_90deg"."""
    points = load_experiment(name).points
    direction = str(points.load_direction.iloc[0])
    catheter = mount(remove_tendon(model), "catheter", direction)
    rest = read_angle(bend(catheter))
    angles = [read_angle(hang(catheter, load * DOWN[direction])) for load in points.load]
    return (np.array(angles) - rest) / READING_LENGTH


def simulate_tendon_pull(model: Model, name: str) -> NDArray[np.float64]:
    """Return the curvatures [1/m] of "fig7": each series pulls on and on, from none."""
    points = load_experiment(name).points
    catheter = mount(model, "catheter", "opposite")
    rest = read_angle(bend(catheter))
    angles = []
    for series in dict.fromkeys(points.series):
        catheter.reset()
        pulls = points.tendon_pull[points.series == series]
        angles += [read_angle(catheter.advance(Command(tendon_pull=pull), _SETTLING_TIME)) for pull in pulls]
    return (np.array(angles) - rest) / READING_LENGTH
