"""Effects that the library lacks, fixed beforehand: the diagnosis should say that it does not know them."""

# ruff: noqa: ARG002, D102  (a form overrides what it needs of `Alteration`, which documents the methods)
from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from evergym.discrepancy.blind.alteration import Alteration, Array
from evergym.discrepancy.blind.plan import PlannedRun
from evergym.discrepancy.data.columns import channel_index
from evergym.simulator import Command, Simulator
from evergym.units import DEG, KPA, MM

__all__ = [
    "ActuatorSaturation",
    "OutOfRoundSheath",
    "PortPlay",
    "SealStickSlip",
    "ShapeMemory",
    "ThermalDrift",
]

TIP = slice(0, 3)
ANGLE = channel_index("tip_angle_deg")
CURVATURE = channel_index("curvature_1_per_m")
CHORD = channel_index("bending_angle_deg")


class ThermalDrift(Alteration):
    """The bench warms up: the camera's picture of the tip wanders in one direction and settles.

    Values: amplitude_mm, time_s (of the whole campaign), direction_deg (in the x-z plane).
    """

    def begin(self, plan: PlannedRun, first: Command, clock: float) -> None:
        self._clock = clock

    def alter_channels(self, time: float, channels: Array, simulator: Simulator) -> Array:
        channels = channels.copy()
        shift = self.values["amplitude_mm"] * -math.expm1(-(self._clock + time) / self.values["time_s"])
        angle = self.values["direction_deg"] * DEG
        channels[0] += shift * math.sin(angle)
        channels[2] += shift * math.cos(angle)
        return channels


class ShapeMemory(Alteration):
    """Bent far, the catheter keeps a part of the bend until the run's end, as if a pull remained.

    Values: share (of the pull beyond the threshold that stays), threshold_mm.
    """

    def begin(self, plan: PlannedRun, first: Command, clock: float) -> None:
        self._set = 0.0

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        beyond = command.tendon_pull - self.values["threshold_mm"] * MM
        # A plastic set grows with the largest bend so far and lags a little: flow takes time.
        target = max(self.values["share"] * beyond, self._set)
        self._set += -math.expm1(-dt / 0.3) * (target - self._set)
        if self._set <= 0.0:
            return command
        return replace(command, tendon_pull=max(command.tendon_pull, self.values["threshold_mm"] * MM + self._set))


class SealStickSlip(Alteration):
    """The seal at the port holds the tail until it is drawn hard enough, then lets a length of it through at once.

    Values: stuck_mm (of tail that is held up), release_factor (of the feed while it slips).
    """

    def begin(self, plan: PlannedRun, first: Command, clock: float) -> None:
        self._held = 0.0
        self._slipping = False

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        feed = 2.0 * command.insertion_velocity if command.tail_feed_velocity is None else command.tail_feed_velocity
        if feed <= 0.0:
            self._held = 0.0
            return replace(command, tail_feed_velocity=feed)
        self._held += feed * dt
        if not self._slipping:
            self._slipping = self._held >= self.values["stuck_mm"] * MM
        if not self._slipping:
            return replace(command, tail_feed_velocity=0.0)
        released = min(self.values["release_factor"] * feed * dt, self._held)
        self._held -= released
        self._slipping = self._held > 0.0
        return replace(command, tail_feed_velocity=released / dt)


class PortPlay(Alteration):
    """The port tilts within its play: the swinging tip drags it along, and it stays where it was left.

    Values: angle_deg (largest tilt), gain (tilt over swing, before the stop).
    """

    def begin(self, plan: PlannedRun, first: Command, clock: float) -> None:
        self._tilt = np.zeros(2)
        self._last: Array | None = None

    def alter_channels(self, time: float, channels: Array, simulator: Simulator) -> Array:
        channels = channels.copy()
        tip = channels[TIP].copy()
        swing = tip[:2] / max(float(np.linalg.norm(tip)), 1.0)
        if self._last is not None:
            self._tilt += self.values["gain"] * (swing - self._last)
            largest = self.values["angle_deg"] * DEG
            size = float(np.linalg.norm(self._tilt))
            if size > largest:
                self._tilt *= largest / size
        self._last = swing
        turned = _tilt(tip, self._tilt)
        direction = _tilt(simulator.reading.tip_direction, self._tilt)
        angle = math.degrees(math.atan2(math.hypot(direction[0], direction[1]), direction[2]))
        if channels[ANGLE] > 1e-9:
            channels[CURVATURE] *= angle / channels[ANGLE]
        channels[ANGLE] = angle
        channels[CHORD] = math.degrees(math.atan2(math.hypot(turned[0], turned[1]), turned[2]))
        channels[TIP] = turned
        return channels


def _tilt(vector: Array, tilt: Array) -> Array:
    """Return a vector turned about the port so that +z leans by ``tilt`` [rad] to x and y."""
    size = float(np.linalg.norm(tilt))
    if size == 0.0:
        return np.array(vector)
    axis = np.array([-tilt[1], tilt[0], 0.0]) / size
    cos, sin = math.cos(size), math.sin(size)
    return np.asarray(vector * cos + np.cross(axis, vector) * sin + axis * float(axis @ vector) * (1.0 - cos))


class ActuatorSaturation(Alteration):
    """The tendon's motor gives way softly near its largest force. Values: pull_mm (never passed), softness_mm."""

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        soft = self.values["softness_mm"] * MM
        beyond = (command.tendon_pull - self.values["pull_mm"] * MM) / soft
        lost = soft * (max(beyond, 0.0) + math.log1p(math.exp(-abs(beyond))))
        return replace(command, tendon_pull=max(command.tendon_pull - lost, 0.0))


class OutOfRoundSheath(Alteration):
    """A flattened sheath bends easier in one plane, the less the more the pressure rounds it.

    Values: share (of pull and load, at no pressure), plane_deg, rounding_kpa, pull_start_mm.
    """

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        if simulator.setup == "catheter":
            return command
        rounding = math.exp(-max(command.pressure, 0.0) / (self.values["rounding_kpa"] * KPA))
        share = self.values["share"] * rounding
        plane = self.values["plane_deg"] * DEG
        start = min(self.values["pull_start_mm"] * MM, command.tendon_pull)
        ease = 1.0 + share * math.cos(2.0 * (command.roll - plane))
        x, y, z = command.tip_load
        along = x * math.cos(plane) + y * math.sin(plane)
        across = -x * math.sin(plane) + y * math.cos(plane)
        along, across = along * (1.0 + share), across * (1.0 - share)
        load = (
            along * math.cos(plane) - across * math.sin(plane),
            along * math.sin(plane) + across * math.cos(plane),
            z,
        )
        return replace(command, tendon_pull=start + (command.tendon_pull - start) * ease, tip_load=load)
