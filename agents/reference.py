"""Reference arms that every policy has to beat: push only, at full and at quarter speed, and random."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

__all__ = ["PushOnlyPolicy", "RandomPolicy", "SlowPushPolicy"]


class _BlindPolicy:
    """A policy that does not look; with the ``predict`` signature of Stable-Baselines3."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        self.action_space = env.action_space

    @staticmethod
    def _count(observation: Any) -> int | None:
        """Return the number of envs of a batched observation, None for a single one."""
        array = np.asarray(observation["observation"] if isinstance(observation, dict) else observation)
        return len(array) if array.ndim == 2 else None


class PushOnlyPolicy(_BlindPolicy):
    """Full insertion and full pressure, no roll, no pull: where the robot goes when nobody steers."""

    ACTION = np.array([1.0, 0.0, -1.0, 1.0], np.float32)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the one action, for each observation of a batch."""
        count = self._count(observation)
        return (self.ACTION.copy() if count is None else np.tile(self.ACTION, (count, 1))), state


class SlowPushPolicy(PushOnlyPolicy):
    """The same at a quarter of the insertion: whether it is only the haste that fails."""

    ACTION = np.array([0.25, 0.0, -1.0, 1.0], np.float32)


class RandomPolicy(_BlindPolicy):
    """Uniform actions; seeded by the env's action space."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return one sample of the action space for each observation of a batch."""
        count = self._count(observation)
        if count is None:
            return self.action_space.sample(), state
        return np.stack([self.action_space.sample() for _ in range(count)]), state
