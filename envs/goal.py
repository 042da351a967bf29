"""``MammobotDuctGoal-v0`` and ``MammobotPegsGoal-v0``: the same tasks with goals as vectors, for hindsight replay."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from evergym.duct_models.centreline import Centreline, Location
from evergym.envs.base import MammobotEnv
from evergym.envs.duct import MammobotDuctEnv
from evergym.envs.pegs import MammobotPegsEnv
from evergym.errors import ConfigError, GeometryError
from evergym.units import MM

__all__ = [
    "GOAL_SCALE",
    "LUMEN_COORDINATES",
    "MammobotDuctGoalEnv",
    "MammobotPegsGoalEnv",
    "compute_lumen_coordinates",
    "measure_tree",
]

GOAL_SCALE = 150.0 * MM
"""Length that a goal shows as 1 [m]: more than the robot can grow, so nothing it reaches is clipped."""
LUMEN_COORDINATES = 16
"""Number of branches that a duct's goals can tell apart; the deepest family has at most 15."""

_DISCOUNTED_HORIZON = 100.0


class _GoalEnv(MammobotEnv):
    """Turns a task into its goal-conditioned form."""

    goal_size: ClassVar[int]

    def __init__(
        self,
        *,
        goal_reward: Literal["sparse", "dense"] = "sparse",
        reward: Mapping[str, float] | None = None,
        **arguments: Any,
    ) -> None:
        if goal_reward not in ("sparse", "dense"):
            raise ConfigError(f"goal_reward is {goal_reward!r}; it must be 'sparse' or 'dense'.")
        self.goal_reward = goal_reward
        # A step costs 1, so a failure must cost more than the steps it saves: the horizon of a discount of 0.99.
        super().__init__(reward={"failure": _DISCOUNTED_HORIZON, **(reward or {})}, **arguments)
        parts: dict[str, spaces.Space[Any]] = {"observation": self.observation_space}
        if isinstance(self.observation_space, spaces.Dict):
            parts = {"observation": self.observation_space["state"], "endoscope": self.observation_space["endoscope"]}
        for name in ("achieved_goal", "desired_goal"):
            parts[name] = spaces.Box(-1.0, 1.0, (self.goal_size,), np.float32)
        self.observation_space = spaces.Dict(parts)

    @abstractmethod
    def _goals(self) -> tuple[list[float], list[float]]:
        """Return the achieved and the desired goal [m]."""

    @staticmethod
    @abstractmethod
    def compute_goal_error(achieved_goal: NDArray[Any], desired_goal: NDArray[Any]) -> NDArray[np.float64]:
        """Return the tip error [m] between goals, shape (...,) for goals of shape (..., goal_size)."""

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """Return the reward of reaching ``achieved_goal`` when ``desired_goal`` was wanted.

        A pure function of its arguments: it holds for transitions of any anatomy.

        Args:
            achieved_goal: One goal, shape (goal_size,), or a batch, shape (n, goal_size).
            desired_goal: The same for the goals wanted.
            info: The step's ``info`` or a sequence of n. Failure and wall force, which no goal changes, are read from
                it where it has them; SB3's ``HerReplayBuffer`` passes empty ones unless ``copy_info_dict=True``.

        Returns:
            A float for one goal, an array of shape (n,) for a batch.
        """
        achieved = np.atleast_2d(np.asarray(achieved_goal, dtype=np.float64))
        desired = np.atleast_2d(np.asarray(desired_goal, dtype=np.float64))
        error = self.compute_goal_error(achieved, desired)
        if self.goal_reward == "sparse":
            reward = -(error > self.settings.success_distance_mm * MM).astype(np.float64)
        else:
            reward = -error * (self.reward_settings.progress_per_mm / MM)
        infos = [info] if isinstance(info, Mapping) else info
        if any(infos):
            for key in ("reward/failure", "reward/wall_force"):
                reward = reward + np.array([entry.get(key, 0.0) for entry in infos])
        return float(reward[0]) if np.ndim(achieved_goal) == 1 else reward

    def _observe(self) -> dict[str, NDArray[Any]]:
        """Return the observation of the current state with both goals."""
        achieved, desired = self._goals()
        parts: dict[str, NDArray[Any]] = {"observation": self._observe_state()}
        if self.has_image:
            parts["endoscope"] = self._observe_image()
        return {**parts, "achieved_goal": _scale_goal(achieved), "desired_goal": _scale_goal(desired)}

    def _reward_terms(self, observation: Any, distance_before: float) -> dict[str, float]:
        """Return the terms of ``compute_reward``."""
        terms = super()._reward_terms(observation, distance_before)
        goal = self.compute_reward(observation["achieved_goal"], observation["desired_goal"], {})
        return {
            "reward/goal": goal,
            "reward/failure": terms["reward/failure"],
            "reward/wall_force": terms["reward/wall_force"],
        }


class MammobotPegsGoalEnv(_GoalEnv, MammobotPegsEnv):
    """``MammobotPegs-v0`` with goals as vectors, for hindsight experience replay.

    Action, reward, start, end, info and arguments are those of ``MammobotDuctGoalEnv``, options those of
    ``MammobotPegsEnv``.

    ## Observation

    A dictionary of ``observation`` (as in ``MammobotPegsEnv``), ``achieved_goal`` and ``desired_goal``, float32 boxes
    -1..1; with ``observation="state+image"`` also ``endoscope``, as there.

    ## Goals

    A goal is a tip position: three coordinates over 150 mm. The error between two goals is their distance.
    """

    goal_size: ClassVar[int] = 3

    def _goals(self) -> tuple[list[float], list[float]]:
        return self._reading.tip_position.tolist(), list(self._route.target)

    @staticmethod
    def compute_goal_error(achieved_goal: NDArray[Any], desired_goal: NDArray[Any]) -> NDArray[np.float64]:
        """Return the distance between tip positions [m]."""
        error: NDArray[np.float64] = np.linalg.norm(achieved_goal - desired_goal, axis=-1) * GOAL_SCALE
        return error


class MammobotDuctGoalEnv(_GoalEnv, MammobotDuctEnv):
    """``MammobotDuct-v0`` with goals as vectors, for hindsight experience replay.

    Action, start, end, info and options are those of ``MammobotDuctEnv``.

    ## Observation

    A dictionary of ``observation`` (as in ``MammobotDuctEnv``), ``achieved_goal`` and ``desired_goal``, float32 boxes
    -1..1; with ``observation="state+image"`` also ``endoscope``, as there.

    ## Goals

    A goal is a place in the lumen, all lengths over 150 mm, so that "within 5 mm along the lumen" can be told from
    two goals alone, in any anatomy:

    | index | meaning |
    |---|---|
    | 0-2 | position in the world (for generalisation; not part of the error) |
    | 3 | distance from the centreline; 0 at the target |
    | 4-19 | for each branch of the duct, how far into it the way from the port leads |

    The way along the lumen between two goals is the sum of the absolute differences of 4-19: branches that both ways
    share cancel, all others add. The error is hypot(way along the lumen, difference of 3), as in
    ``info["tip_error_mm"]``.

    ## Reward

    The sum of ``info["reward/<term>"]``, equal to ``compute_reward(achieved_goal, desired_goal, info)``.

    | term | value |
    |---|---|
    | `goal` | "sparse": -1 while the error is above ``success_distance_mm``, else 0; "dense": -0.1 per mm of error |
    | `failure` | once, -100 on a burst or perforation: what a discount of 0.99 makes of -1 for ever |
    | `wall_force` | as in ``MammobotDuctEnv`` |

    ## Arguments of ``gymnasium.make``

    As in ``MammobotDuctEnv`` or ``MammobotPegsEnv``, and ``goal_reward`` ("sparse", or "dense"). Of ``reward``, the
    weights ``failure``, ``wall_force_per_n_s`` and, for "dense", ``progress_per_mm`` have an effect.
    """

    goal_size: ClassVar[int] = 4 + LUMEN_COORDINATES

    def _goals(self) -> tuple[list[float], list[float]]:
        route: Any = self._route
        location: Location = route.location
        achieved = [*self._reading.tip_position.tolist(), location.offset, *self._lumen_coordinates(location)]
        desired = [*route.target, 0.0, *self._lumen_coordinates(route.target_location)]
        return achieved, desired

    def _lumen_coordinates(self, location: Location) -> list[float]:
        centreline = self.duct.centreline
        if centreline is not getattr(self, "_tree_of", None):
            self._tree = measure_tree(centreline, self.duct.name)
            self._tree_of = centreline
        return compute_lumen_coordinates(self._tree, location)

    @staticmethod
    def compute_goal_error(achieved_goal: NDArray[Any], desired_goal: NDArray[Any]) -> NDArray[np.float64]:
        """Return the tip error [m]: the way between the goals along the lumen and the part across it."""
        gap = np.abs(achieved_goal[..., 3:] - desired_goal[..., 3:])
        error: NDArray[np.float64] = np.hypot(gap[..., 1:].sum(axis=-1), gap[..., 0]) * GOAL_SCALE
        return error


Tree = dict[int, tuple[int, float, list[float]]]


def compute_lumen_coordinates(tree: Tree, location: Location) -> list[float]:
    """Return how far into each branch the way from the port to ``location`` goes [m].

    The sum of the absolute differences of two such vectors, shape (``LUMEN_COORDINATES``,), is the distance along the
    lumen, exactly: branches that both ways share cancel, all others add.
    """
    slot, entry, before = tree[location.branch]
    coordinates = before.copy()
    coordinates[slot] = max(location.station - entry, 0.0)
    return coordinates


def measure_tree(centreline: Centreline, name: str) -> Tree:
    """Return, for every branch, its coordinate, the station where it begins and the coordinates of that point."""
    parent, branch, station = centreline.parent.tolist(), centreline.branch.tolist(), centreline.station.tolist()
    tree: Tree = {}
    for node, owner in enumerate(branch):
        if owner in tree:
            continue
        if len(tree) == LUMEN_COORDINATES:
            raise GeometryError(
                f"Duct {name!r} has {len(set(branch))} branches; goals can tell {LUMEN_COORDINATES} apart. "
                "Use MammobotDuct-v0 for it, or cut the mesh down to the part around the target."
            )
        before = [0.0] * LUMEN_COORDINATES
        entry = station[max(parent[node], 0)]
        if parent[node] >= 0:
            slot, start, upstream = tree[branch[parent[node]]]
            before = upstream.copy()
            before[slot] = entry - start
        tree[owner] = (len(tree), entry, before)
    return tree


def _scale_goal(goal: list[float]) -> NDArray[np.float32]:
    """Return a goal in metres as the space holds it."""
    scaled = np.array(goal) / GOAL_SCALE
    return np.maximum(np.minimum(scaled, 1.0), -1.0).astype(np.float32)
