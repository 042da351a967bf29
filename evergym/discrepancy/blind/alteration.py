"""Code of the truth's own, between the commands and the simulator, or between the simulator and the readings."""

# ruff: noqa: ARG002  (what a form may need)
from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.blind.plan import PlannedRun
from evergym.simulator import Command, Simulator

__all__ = ["Alteration", "Array", "Values"]

Array = NDArray[np.float64]
Values = Mapping[str, float]


class Alteration:
    """Does nothing; a form overrides what it needs. One instance serves all runs of a campaign, in their order.

    Args:
        values: The form's numbers, with units in their names.

    Attributes:
        settles: The run's first commands are held for a while before the run begins, until the form is at rest.
    """

    settles = False

    def __init__(self, values: Values) -> None:
        self.values = dict(values)

    def begin(self, plan: PlannedRun, first: Command, clock: float) -> None:
        """Prepare for a run.

        Args:
            plan: The run.
            first: Its first command [SI], under which the robot rests.
            clock: Time since the campaign began [s], pauses between runs included.
        """

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        """Return what really acts over the next ``dt`` [s] instead of ``command``."""
        return command

    def alter_channels(self, time: float, channels: Array, simulator: Simulator) -> Array:
        """Return what the instruments read instead of ``channels``, shape (9,), in the channels' units."""
        return channels
