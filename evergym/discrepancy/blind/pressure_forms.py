"""Other functional forms of what happens between the regulator, the gauge and the sheath; and of the angle's scale."""

# ruff: noqa: ARG002, D102  (a form overrides what it needs of `Alteration`, which documents the methods)
from __future__ import annotations

import math
from dataclasses import replace

from evergym.discrepancy.blind.alteration import Alteration, Array
from evergym.discrepancy.blind.plan import PlannedRun
from evergym.discrepancy.data.columns import ANGLES, channel_index
from evergym.simulator import Command, Simulator
from evergym.units import KPA, MM

__all__ = ["OrificeDroop", "SecondOrderLag", "SoftBias", "StickyAngle", "ThrottledLeak", "TriangleRipple"]

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
    """A gauge whose bias builds up with the reading; the regulator believes it. Values: bias_kpa (at 25 kPa)."""

    RISE_KPA = 12.0

    def _bias(self, reading_kpa: float) -> float:
        whole = -math.expm1(-25.0 / self.RISE_KPA)
        return self.values["bias_kpa"] * -math.expm1(-max(reading_kpa, 0.0) / self.RISE_KPA) / whole

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        return replace(command, pressure=command.pressure - self._bias(command.pressure / KPA) * KPA)

    def alter_channels(self, time: float, channels: Array, simulator: Simulator) -> Array:
        channels = channels.copy()
        # The reading r of a pressure p: r - bias(r) = p, by iteration, since the bias rises less than r.
        reading = channels[GAUGE]
        for _ in range(60):
            reading = channels[GAUGE] + self._bias(reading)
        channels[GAUGE] = reading
        return channels


class StickyAngle(Alteration):
    """A needle that jumps to the nearest mark only when the angle is well past the middle. Values: step_deg."""

    CATCH_SHARE = 0.65  # of a step, by which the angle must leave a mark

    def begin(self, plan: PlannedRun, first: Command, clock: float) -> None:
        self._marks = dict.fromkeys(ANGLES[1:], math.nan)

    def alter_channels(self, time: float, channels: Array, simulator: Simulator) -> Array:
        channels = channels.copy()
        curvature, angle, _ = (channel_index(name) for name in ANGLES)
        free_length = channels[angle] / channels[curvature] if channels[curvature] != 0.0 else math.inf
        step = self.values["step_deg"]
        for name, mark in self._marks.items():
            index = channel_index(name)
            if math.isnan(mark) or abs(channels[index] - mark) > self.CATCH_SHARE * step:
                self._marks[name] = round(channels[index] / step) * step
            channels[index] = self._marks[name]
        channels[curvature] = channels[angle] / free_length
        return channels
