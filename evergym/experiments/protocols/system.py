"""Figs. 10 and 11: the full system, over the pressure and under tip loads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evergym.experiments.paper import READING_LENGTH, load_experiment
from evergym.experiments.protocols.bench import DOWN, bend, find_pre_curvature_angle, hang, mount, read_angle
from evergym.model import Model
from evergym.units import MM

__all__ = ["simulate_pressure", "simulate_tip_load", "simulate_tip_position"]


def simulate_pressure(model: Model, name: str) -> NDArray[np.float64]:
    """Return the curvatures [1/m] of "fig10"."""
    points = load_experiment(name).points
    system = mount(model, "full", "opposite")
    rows = points[["pressure", "tendon_pull"]].to_numpy(dtype=float).tolist()
    angles = [read_angle(bend(system, pressure=pressure, tendon_pull=pull)) for pressure, pull in rows]
    return (np.array(angles) - find_pre_curvature_angle(model)) / READING_LENGTH


def simulate_tip_load(model: Model, name: str) -> NDArray[np.float64]:
    """Return the curvatures [1/m] of "fig11a" to "fig11d"."""
    points = load_experiment(name).points
    direction = str(points.load_direction.iloc[0])
    system = mount(model, "full", direction)
    pull = float(points.tendon_pull.iloc[0])
    angles = np.empty(len(points))
    pressures, loads = points.pressure.to_numpy(dtype=float), points.load.to_numpy(dtype=float)
    for pressure in np.unique(pressures).tolist():
        bend(system, pressure=pressure, tendon_pull=pull)
        rows = np.flatnonzero(pressures == pressure)
        for row in rows[np.argsort(loads[rows])].tolist():
            reading = hang(system, loads[row] * DOWN[direction], pressure=pressure, tendon_pull=pull)
            angles[row] = read_angle(reading)
    return (angles - find_pre_curvature_angle(model)) / READING_LENGTH


def simulate_tip_position(model: Model, name: str) -> NDArray[np.float64]:
    """Return lateral and axial tip coordinates [mm] of "tip_position", pair after pair.

    The measured ones are those of arcs whose angles are the readings, less the pre-curvature; so the simulated shape
    is straightened by the pre-curvature before its tip is taken.
    """
    pressures = load_experiment(name).points.pressure.to_numpy()[::2]
    pull = load_experiment(name).points.tendon_pull.iloc[0]
    system = mount(model, "full", "opposite")
    values = []
    for pressure in pressures:
        bend(system, pressure=pressure, tendon_pull=pull)
        shape = system.shape()
        station = shape.station * (READING_LENGTH / shape.station[-1])
        angle = np.arctan2(shape.tangent[:, 0], shape.tangent[:, 2])
        angle = angle - model.effects.pre_curvature.curvature_1_per_m * station
        values += [np.trapezoid(np.sin(angle), station) / MM, np.trapezoid(np.cos(angle), station) / MM]
    return np.array(values)
