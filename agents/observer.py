"""Reads an env's observation back into quantities, and turns commands into its actions, for scripted controllers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from evergym.envs.base import MammobotEnv
from evergym.envs.drive import Drive
from evergym.envs.observation import inverse_scales, term_slices
from evergym.envs.route import WAY_DISTANCES
from evergym.errors import ConfigError
from evergym.units import MM

__all__ = ["Observer", "Seen"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Seen:
    """One observation in SI units."""

    catheter_length: float
    everted_length: float
    roll: float
    tendon_pull: float
    pressure: float
    growth_rate: float
    way_ahead: Array
    """Points of the way in the tip's frame (tendon side, across, ahead), shape (k, 3)."""
    distance_to_go: float
    astray: float
    """How far the tip is in a branch off the way [m]; 0 on the way, and among pegs."""
    is_past: bool
    """Whether the way leads back: the tip has passed the target, or the turning towards it."""
    tip_push: float
    """Force of the surroundings against the tip's way ahead."""
    buckled: bool

    def find_way(self, distance: float) -> tuple[float, float, float]:
        """Return the point of the way that far ahead of the tip [m]: towards the tendon, across, and ahead."""
        x, y, z = (float(np.interp(distance, WAY_DISTANCES, self.way_ahead[:, axis])) for axis in range(3))
        return x, y, z


class Observer:
    """What a scripted controller knows of an env: the observation's layout, the drive's limits, the robot's data sheet.

    Args:
        env: A MammobotDuct or MammobotPegs environment, wrapped or not.

    Raises:
        ConfigError: another environment.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        base = env.unwrapped
        if not isinstance(base, MammobotEnv):
            raise ConfigError(
                f"The scripted controllers drive MammobotDuct and MammobotPegs environments, not {type(base).__name__}."
            )
        self.task = "duct" if any(term.name == "astray" for term in base.terms) else "pegs"
        self.control_step: float = base.settings.control_step_s
        self.limits = base.drive.limits
        self._drive = Drive(self.limits)
        self._slices = term_slices(base.terms)
        self._scale = 1.0 / inverse_scales(base.terms, hide_map=False)
        # The curvature that a pull gives, as on the robot's data sheet; what it really gives, the feedback finds out.
        robot, effects = base.model.robot, base.model.effects
        arm = robot.tendon_arm_mm * MM
        stretch = robot.catheter_bending_stiffness_n_m2 * effects.tendon_stretch.compliance_mm_per_n * 1e-3 / arm
        self._pull_per_curvature = arm * robot.catheter_flexible_length_mm * MM + stretch
        self._lost_pull = (effects.tendon_backlash.backlash_mm + effects.tendon_backlash.lost_motion_mm) * MM
        self._pre_curvature = effects.pre_curvature.curvature_1_per_m

    def is_batch(self, observation: Any) -> bool:
        """Return whether an observation is that of several envs."""
        return self._array(observation).ndim == 2

    def split(self, observation: Any) -> Array:
        """Return the observations as rows, shape (n, size)."""
        return np.atleast_2d(self._array(observation))

    @staticmethod
    def _array(observation: Any) -> Array:
        if isinstance(observation, dict):
            observation = observation["observation"] if "observation" in observation else observation["state"]
        return np.asarray(observation, np.float64)

    def read(self, row: Array) -> Seen:
        """Return one observation in SI units."""
        values = row * self._scale
        at = {name: values[place] for name, place in self._slices.items()}
        everted = float(at["everted_length"][0])
        return Seen(
            catheter_length=everted + float(at["protrusion"][0]),
            everted_length=everted,
            roll=math.atan2(float(at["roll"][0]), float(at["roll"][1])),
            tendon_pull=float(at["tendon_pull"][0]),
            pressure=float(at["pressure"][0]),
            growth_rate=float(at["growth_rate"][0]),
            way_ahead=at["way_ahead"].reshape(-1, 3),
            distance_to_go=float(at["distance_to_go"][0]),
            astray=self._find_depth(at),
            is_past=float(at["way_ahead"][-1]) < 0.0,
            tip_push=max(-float(at["tip_force"][2]), 0.0),
            buckled=float(at["buckled"][0]) > 0.5,
        )

    @staticmethod
    def _find_depth(at: dict[str, Array]) -> float:
        """Return how far the tip is in a wrong branch [m]: the way goes back by that much before it goes ahead."""
        if "astray" not in at or at["astray"][0] < 0.5:
            return 0.0
        distance = np.minimum(WAY_DISTANCES, at["distance_to_go"])  # beyond the target, the target itself is shown
        return 0.5 * max(float(np.max(distance - at["way_ahead"].reshape(-1, 3)[:, 2])), 0.0)

    def find_pull(self, curvature: float) -> float:
        """Return the tendon pull [m] for a curvature [1/m] of the free catheter."""
        wanted = curvature - self._pre_curvature
        if wanted <= 0.0:
            return 0.0
        return min(wanted * self._pull_per_curvature + self._lost_pull, self.limits.tendon_pull)

    @property
    def curvature_max(self) -> float:
        """The curvature that the largest pull gives the free catheter [1/m]."""
        return self.find_curvature(self.limits.tendon_pull)

    def find_curvature(self, pull: float) -> float:
        """Return the curvature [1/m] of the free catheter at a tendon pull [m]."""
        return max(pull - self._lost_pull, 0.0) / self._pull_per_curvature + self._pre_curvature

    def make_action(self, insertion: float, roll_rate: float, pull: float, pressure: float) -> NDArray[np.float32]:
        """Return the action that commands these SI values, clipped to the drive's limits."""
        return self._drive.action_for(insertion, roll_rate, pull, pressure)
