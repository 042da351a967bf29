"""Other functional forms of what happens between the tendon's and the roll's drive and the catheter."""

# ruff: noqa: ARG002, D102  (a form overrides what it needs of `Alteration`, which documents the methods)
from __future__ import annotations

import math
from dataclasses import replace

from evergym.discrepancy.blind.alteration import Alteration
from evergym.discrepancy.blind.plan import PlannedRun
from evergym.simulator import Command, Simulator
from evergym.units import DEG, KPA, MM

__all__ = ["DahlTendon", "SmoothPlay", "StiffeningLine", "WoundRoll", "advance_smooth_play"]

PIECES = 8  # of a change of the drive, so that the smooth edges are followed


def advance_smooth_play(old: float, new: float, follower: float, width: float, edge: float) -> float:
    """Return where the follower of a play with soft edges is after its drive has moved from ``old`` to ``new``.

    The play lies between ``drive - width`` and ``drive``; the follower takes up the share of the motion that a logistic
    function of its distance to the edge gives, so it never lets go or grips at once.

    Args:
        old: Drive before.
        new: Drive after.
        follower: Follower before.
        width: Play.
        edge: Softness of the edges; the play is sharp for 0.
    """
    step = (new - old) / PIECES
    drive = old
    for _ in range(PIECES):
        drive += step
        gap = drive - width - follower if step > 0.0 else follower - drive
        follower += step / (1.0 + math.exp(min(max(-gap / edge, -60.0), 60.0)))
    return follower


class SmoothPlay(Alteration):
    """Backlash whose flanks grip gradually. Values: backlash_mm, lost_motion_mm, edge_share."""

    def begin(self, plan: PlannedRun, first: Command, clock: float) -> None:
        self._lost = 0.0 if plan.setup == "catheter" else self.values["lost_motion_mm"] * MM
        self._width = self.values["backlash_mm"] * MM
        self._drive = max(first.tendon_pull - self._lost, 0.0)
        self._follower = max(self._drive - self._width, 0.0)

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        drive = max(command.tendon_pull - self._lost, 0.0)
        if drive != self._drive:
            edge = self.values["edge_share"] * self._width
            self._follower = advance_smooth_play(self._drive, drive, self._follower, self._width, edge)
            self._drive = drive
        return replace(command, tendon_pull=max(self._follower, 0.0))


class DahlTendon(Alteration):
    """Friction along the bent tendon after Dahl: the lost pull creeps towards mu * angle * tension * compliance.

    Values: mu, rest_share (of the limit, over which the friction builds up), compliance_mm_per_n of the line.
    Source: Dahl 1968 (Aerospace Corp. TOR-158), exponent 1.
    """

    def begin(self, plan: PlannedRun, first: Command, clock: float) -> None:
        self._drive = first.tendon_pull
        self._lost = 0.0

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        reading = simulator.reading
        _, _, z = reading.tip_direction.tolist()
        angle = math.acos(min(max(z, -1.0), 1.0))
        compliance = self.values["compliance_mm_per_n"] * MM
        limit = self.values["mu"] * angle * reading.tendon_tension * compliance
        step = command.tendon_pull - self._drive
        self._drive = command.tendon_pull
        if limit <= 0.0:
            self._lost = 0.0
        elif step != 0.0:
            target = math.copysign(limit, step)
            self._lost = target + (self._lost - target) * math.exp(-abs(step) / (self.values["rest_share"] * limit))
        return replace(command, tendon_pull=max(command.tendon_pull - self._lost, 0.0))


class StiffeningLine(Alteration):
    """A line that stiffens as it is drawn: stretch = C T (1 - s T / (T + T0)), followed with a short lag.

    Values: compliance_mm_per_n, stiffening_share, stiffening_n.
    """

    settles = True
    FOLLOWING_SHARE = 0.15  # of the difference in a step; the tension answers the pull at once, so more would ring

    def begin(self, plan: PlannedRun, first: Command, clock: float) -> None:
        self._stretch = 0.0

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        tension = max(simulator.reading.tendon_tension, 0.0)
        softness = 1.0 - self.values["stiffening_share"] * tension / (tension + self.values["stiffening_n"])
        stretch = self.values["compliance_mm_per_n"] * MM * tension * softness
        self._stretch += self.FOLLOWING_SHARE * (stretch - self._stretch)
        return replace(command, tendon_pull=max(command.tendon_pull - self._stretch, 0.0))


class WoundRoll(Alteration):
    """The catheter's tip turns after its base through a soft play that widens with the pressure.

    Values: play_deg (at 25 kPa), pressure_share, edge_share.
    """

    def begin(self, plan: PlannedRun, first: Command, clock: float) -> None:
        self._drive = first.roll
        # At rest in the middle of the play: no side is preferred.
        self._offset = 0.5 * self._width(first.pressure)
        self._follower = first.roll - self._offset

    def _width(self, pressure: float) -> float:
        share = self.values["pressure_share"]
        return self.values["play_deg"] * DEG * (1.0 - share + share * max(pressure, 0.0) / (25.0 * KPA))

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        width = max(self._width(command.pressure), 1e-6)
        if command.roll != self._drive:
            edge = self.values["edge_share"] * width
            self._follower = advance_smooth_play(self._drive, command.roll, self._follower, width, edge)
            self._drive = command.roll
        return replace(command, roll=self._follower + self._offset)
