"""What the bench's instruments read of a simulator: the measured channels, and the effects that sit in the sensors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import CHANNELS
from evergym.model import Model
from evergym.simulator import Reading, Simulator
from evergym.units import DEG, KPA, MM

__all__ = ["convert_reading", "measure_angle", "quantise_angles", "read_channels"]

Array = NDArray[np.float64]

CURVATURE, TIP_ANGLE = CHANNELS.index("curvature_1_per_m"), CHANNELS.index("tip_angle_deg")


def read_channels(simulator: Simulator, signed: bool = False) -> Array:
    """Return what the instruments read now, in the channels' units, shape (9,), in the order of `CHANNELS`.

    The free length is the robot's length outside the port. Angles are those between +z and the tangent at the tip, or
    the chord from the port to the tip, 0 to 180 degrees; with ``signed`` they are seen along -y by a camera beside the
    bench, positive towards +x, as in the paper's figures.

    The sensor effects act here: `pressure_bias` shifts what the gauge reads (the simulator shifts the pressure itself,
    since the regulator trusts the gauge), `angle_quantisation` rounds the tip's angle, and with it the curvature.
    """
    row = convert_reading(simulator, simulator.reading, signed)
    quantised: Array = quantise_angles(row[None, :], simulator.model)[0]
    return quantised


def convert_reading(simulator: Simulator, reading: Reading, signed: bool = False) -> Array:
    """Return `read_channels` at ``reading``, which is the simulator's present one, before its angles are quantised."""
    state = simulator.state
    free_length = float(state.length[: int(state.links[0])].sum())
    tip_angle = measure_angle(reading.tip_direction, signed)
    chord_angle = measure_angle(reading.tip_position, signed)
    effects = simulator.model.effects
    channels = np.empty(len(CHANNELS))
    channels[0:3] = reading.tip_position
    channels[0:3] /= MM
    channels[3] = reading.everted_length / MM
    channels[4] = reading.growth_rate / MM
    channels[5] = tip_angle * DEG / free_length
    channels[6] = tip_angle
    channels[7] = chord_angle
    channels[8] = reading.pressure / KPA + effects.pressure_bias.bias_kpa
    return channels


def quantise_angles(channels: Array, model: Model) -> Array:
    """Return channels (k, 9) with the tip's angle, and with it the curvature, read to the model's whole steps."""
    quantisation = model.effects.angle_quantisation
    if quantisation.step_deg == 0.0:
        return channels
    out = channels.copy()
    for row in out:
        exact = float(row[TIP_ANGLE])
        if math.isfinite(exact):
            row[TIP_ANGLE] = quantisation.read(exact)
            row[CURVATURE] *= row[TIP_ANGLE] / exact if exact != 0.0 else 1.0
    return out


def measure_angle(direction: Array, signed: bool) -> float:
    """Return the angle of a direction against +z [deg]; ``signed``: as seen along -y, positive towards +x."""
    x, y, z = direction.tolist()
    if signed:
        return math.atan2(x, z) / DEG
    return math.atan2(math.hypot(x, y), z) / DEG
