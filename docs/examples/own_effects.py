"""Two effects of one's own, for a diagnosis that looks for them beside those of the catalogue.

A diagnosis runs this file and takes what is in EFFECTS. A hook stands between the commands and the robot
(`transform_command`, SI units) and between the robot and the instruments (`transform_channels`, in the units of the
channels' names); it overrides what it needs.
"""

from __future__ import annotations

import dataclasses
import math

from evergym.config import ParameterInfo
from evergym.discrepancy.data.columns import channel_index
from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.hook import Array, PassiveHook, UserEffect
from evergym.simulator import Command, Reading


class SlowTendonDrive(PassiveHook):
    """The tendon's motor follows its set point with a delay of first order."""

    def __init__(self, time_s: float) -> None:
        self.time_constant = time_s
        self.pull: float | None = None

    def reset(self, run: Run) -> None:
        """Forget the motor's position: at rest it is where it was told to be."""
        del run
        self.pull = None

    def transform_command(self, time: float, dt: float, command: Command, reading: Reading) -> Command:
        """Return the command with the pull that the motor has reached after ``dt``."""
        del time
        if self.pull is None:
            self.pull = reading.tendon_pull
        share = -math.expm1(-dt / self.time_constant) if self.time_constant > 0.0 else 1.0
        self.pull += share * (command.tendon_pull - self.pull)
        return dataclasses.replace(command, tendon_pull=self.pull)


class TiltedCamera(PassiveHook):
    """The camera is turned about its optical axis, so x and z mix."""

    def __init__(self, angle_deg: float) -> None:
        self.cos, self.sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))

    def transform_channels(self, time: float, channels: Array) -> Array:
        """Return the channels with the tip's position as the camera sees it."""
        del time
        x, z = channel_index("tip_x_mm"), channel_index("tip_z_mm")
        seen = channels.copy()
        seen[x] = self.cos * channels[x] - self.sin * channels[z]
        seen[z] = self.sin * channels[x] + self.cos * channels[z]
        return seen


EFFECTS = [
    UserEffect(
        name="slow_tendon_drive",
        hook=SlowTendonDrive,
        parameters={"time_s": ParameterInfo(unit="s", low=0.0, high=5.0)},
        off={"time_s": 0.0},
        typical={"time_s": 0.5},
    ),
    UserEffect(
        name="tilted_camera",
        hook=TiltedCamera,
        parameters={"angle_deg": ParameterInfo(unit="deg", low=-90.0, high=90.0)},
        off={"angle_deg": 0.0},
        typical={"angle_deg": 4.0},
    ),
]
