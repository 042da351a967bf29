"""A driven episode as it is kept: the place, and for every instant the robot's pose and what could be read off it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evergym.duct_models.duct import Duct
from evergym.duct_models.pegs import PegField
from evergym.envs.rendering.pose import Pose

__all__ = ["COLUMNS", "DRIVERS", "Episode", "Frame", "Heading"]

COLUMNS = (
    "time_s",
    "tip_x_mm",
    "tip_y_mm",
    "tip_z_mm",
    "tendon_side_x",
    "tendon_side_y",
    "tendon_side_z",
    "everted_length_mm",
    "catheter_length_mm",
    "pressure_kpa",
    "tendon_pull_mm",
    "roll_deg",
    "tip_error_mm",
    "distance_to_go_mm",
    "wall_force_n",
    "wall_force_max_n",
    "tip_force_n",
    "contact_count",
    "penetration_mm",
    "buckled",
    "burst",
    "driver",
    "command_insertion_mm_s",
    "command_roll_rate_deg_s",
    "command_pull_mm",
    "command_pressure_kpa",
    "reward",
)
"""What is read at every instant, in the units that people read; ``driver`` is a number of ``DRIVERS``."""

DRIVERS = ("hand", "duty cycle", "policy")
"""Who may drive."""


class Frame(NamedTuple):
    """One instant of an episode."""

    pose: Pose
    values: Mapping[str, float]
    """A value for each of ``COLUMNS``."""


@dataclass(frozen=True)
class Heading:
    """What an episode is, in plain values."""

    env: str
    """Environment id."""
    model: str
    """Name of the model."""
    anatomy: str
    """Name of the duct or peg field."""
    interval_s: float
    """Robot time between two frames."""
    seed: int = 0
    """Seed of the reset."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Options of the reset: family, index, target, or a mesh."""
    policy: str = ""
    """Run folder of the policy that could drive."""
    end_reason: str = ""
    """Why it ended; empty if it was stopped before."""
    success_distance_mm: float = 5.0
    """Tip error at which the target counts as reached."""

    @property
    def is_success(self) -> bool:
        """Whether the target was reached."""
        return self.end_reason == "reached"


@dataclass(frozen=True, eq=False)
class Episode:
    """A recorded episode; it holds all that is needed to look at it again without the simulator."""

    heading: Heading
    scene: Duct | PegField
    target: tuple[float, float, float]
    """[m]"""
    way: NDArray[np.float64]
    """The way to the target [m], shape (k, 3)."""
    frames: Sequence[Frame]

    def column(self, name: str) -> NDArray[np.float64]:
        """Return one of ``COLUMNS`` over the frames, shape (n,)."""
        return np.array([frame.values[name] for frame in self.frames])
