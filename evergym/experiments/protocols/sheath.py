"""Figs. 8 and 9: the sheath alone, growing, and hanging under its weight."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evergym.eversion import EVERTED_LENGTH_MIN
from evergym.experiments.paper import READING_LENGTH, load_experiment
from evergym.model import Model, Numerics
from evergym.simulator import Command, Simulator
from evergym.units import DEG, MM
from evergym.world import World

__all__ = ["simulate_final_length", "simulate_gravity", "simulate_growth_curve", "simulate_mean_speed"]

_GROWTH = Numerics(section_length_mm=10.0, step_s=1.0)
"""Growth takes steps of its own; the straight sheath's shape does not matter for it."""
_HANGING = Numerics(section_length_mm=0.5, step_s=1.0)
"""The kink at the root is spread over the first section: 0.5 mm make 0.3 degrees."""
_HANGING_TIME = 10.0


def simulate_growth_curve(model: Model, name: str) -> NDArray[np.float64]:
    """Return the grown lengths over time [mm] of "fig8a"."""
    points = load_experiment(name).points
    values = np.empty(len(points))
    for curve in dict.fromkeys(points.curve):
        own = points[points.curve == curve]
        values[own.index] = _grow(model, own.feed_velocity.iloc[0], own.pressure.iloc[0], tuple(own.time)) / MM
    return values


def simulate_final_length(model: Model, name: str) -> NDArray[np.float64]:
    """Return the grown lengths [mm] of "fig8b" at the times at which the measured curves end."""
    points = load_experiment(name).points
    rows = points[["feed_velocity", "pressure", "end_time"]].to_numpy(dtype=float).tolist()
    lengths = [_grow(model, feed, pressure, (end,))[0] for feed, pressure, end in rows]
    return np.array(lengths) / MM


def simulate_mean_speed(model: Model, name: str) -> NDArray[np.float64]:
    """Return the mean growing speeds [mm/s] of "fig8c" up to the times at which the measured curves end."""
    times = load_experiment(name).points.end_time.to_numpy(dtype=float)
    return np.array(simulate_final_length(model, "fig8b") / times)


def simulate_gravity(model: Model, name: str) -> NDArray[np.float64]:
    """Return the angles of the hanging sheath below the horizontal [deg] of "fig9", base to tip."""
    values = []
    # Damping would only delay the rest position, the longer the shorter the first section.
    undamped = replace(model, robot=replace(model.robot, catheter_damping_time_ms=0.0))
    for pressure in load_experiment(name).points.pressure:
        sheath = Simulator(undamped, World.free(), _HANGING, "sheath")
        sheath.reset(everted_length=READING_LENGTH, pressure=pressure)
        command = Command(tail_feed_velocity=0.0, pressure=pressure)
        _, y, z = sheath.advance(command, _HANGING_TIME).tip_position.tolist()
        values.append(math.atan2(-y, z) / DEG)
    return np.array(values)


@functools.lru_cache(maxsize=64)
def _grow(model: Model, feed: float, pressure: float, times: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the length grown [m] at each of the times [s], which increase.

    Final lengths and mean speeds are those of the same run.
    """
    sheath = Simulator(model, World.free(gravity=(0.0, 0.0, 0.0)), _GROWTH, "sheath")
    sheath.reset(everted_length=EVERTED_LENGTH_MIN, pressure=pressure)
    command = Command(tail_feed_velocity=feed, pressure=pressure)
    lengths = []
    for time in times:
        left = time - sheath.reading.time
        reading = sheath.advance(command, left) if left > 0.0 else sheath.reading
        lengths.append(reading.everted_length - EVERTED_LENGTH_MIN)
    return np.array(lengths)
