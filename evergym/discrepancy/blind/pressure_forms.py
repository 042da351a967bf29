"""Other functional forms of what happens between the regulator, the gauge and the sheath; and of the angle's scale."""

# ruff: noqa: ARG002, D102  (a form overrides what it needs of `Alteration`, which documents the methods)
from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from evergym.discrepancy.blind.alteration import Alteration, Array
from evergym.discrepancy.blind.plan import PlannedRun
from evergym.discrepancy.columns import ANGLES, channel_index
from evergym.simulator import Command, Simulator
from evergym.units import KPA, MM

__all__ = ["OrificeDroop", "SecondOrderLag", "SoftBias", "ThrottledLeak", "TriangleRipple", "TruncatedAngle"]

GAUGE = channel_index("pressure_measured_kpa")


class SecondOrderLag(Alteration):
    """Two equal lags in a row with the same mean delay: the pressure sets off gently. Values: time_s."""

    def begin(self, plan: PlannedRun, first: Command, clock: float) -> None:
        self._first = self._second = first.pressure

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        share = -math.expm1(-dt / (0.5 * self.values["time_s"]))
        self._first += share * (command.pressure - self._first)
        self._second += share * (self._first - self._second)
        return replace(command, pressure=self._second)


class OrificeDroop(Alteration):
    """The supply loses pressure with the square of the flow, as through an orifice. Values: resistance_kpa_s_mm."""

    REFERENCE_MM_S = 1.0

    def begin(self, plan: PlannedRun, first: Command, clock: float) -> None:
        self._speed = 0.0

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        # The trapped air evens the flow out.
        self._speed += (1.0 - math.exp(-dt / 0.3)) * (max(simulator.reading.growth_rate, 0.0) / MM - self._speed)
        droop = self.values["resistance_kpa_s_mm"] * self._speed**2 / self.REFERENCE_MM_S * KPA
        return replace(command, pressure=max(command.pressure - droop, 0.0))


class TriangleRipple(Alteration):
    """The regulator hunts in straight lines instead of a sine. Values: amplitude_kpa, frequency_hz."""

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        phase = (time + 0.5 * dt) * self.values["frequency_hz"] % 1.0
        wave = 4.0 * abs((phase - 0.25) % 1.0 - 0.5) - 1.0
        return replace(command, pressure=max(command.pressure + self.values["amplitude_kpa"] * KPA * wave, 0.0))


class ThrottledLeak(Alteration):
    """The share that leaks away grows with the root of the pressure. Values: share (at 25 kPa)."""

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        share = self.values["share"] * math.sqrt(max(command.pressure, 0.0) / (25.0 * KPA))
        return replace(command, pressure=command.pressure * (1.0 - min(share, 1.0)))


class SoftBias(Alteration):
    """A gauge whose bias builds up over the first kilopascals; the regulator believes it. Values: bias_kpa."""

    RISE_KPA = 3.0

    def _bias(self, reading_kpa: float) -> float:
        return self.values["bias_kpa"] * -math.expm1(-max(reading_kpa, 0.0) / self.RISE_KPA)

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        return replace(command, pressure=command.pressure - self._bias(command.pressure / KPA) * KPA)

    def alter_channels(self, time: float, channels: Array, simulator: Simulator) -> Array:
        channels = channels.copy()
        channels[GAUGE] += self._bias(channels[GAUGE] + self.values["bias_kpa"])
        return channels


class TruncatedAngle(Alteration):
    """Angles read off a scale by cutting the fraction, not by rounding. Values: step_deg."""

    def alter_channels(self, time: float, channels: Array, simulator: Simulator) -> Array:
        channels = channels.copy()
        angle, chord, curvature = (channel_index(f) for f in ("tip_angle_deg", "bending_angle_deg", ANGLES[0]))
        step = self.values["step_deg"]
        read = math.floor(channels[angle] / step) * step
        if channels[angle] > 0.0:
            channels[curvature] *= read / channels[angle]
        channels[angle] = read
        channels[chord] = np.floor(channels[chord] / step) * step
        return channels
