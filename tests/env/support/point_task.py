"""A small task with the interface of the Mammobot environments: a point that must be steered to a target."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces


class PointTask(gymnasium.Env[Any, Any]):
    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 4}

    def __init__(
        self,
        render_mode: str | None = None,
        horizon: int = 40,
        fail_at: int = -1,
        accept_nan: bool = False,
        wide: bool = False,
    ):
        self.render_mode, self.horizon, self.fail_at, self.accept_nan = render_mode, horizon, fail_at, accept_nan
        self.observation_space = spaces.Box(-10.0, 10.0, (7 if wide else 6,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (4,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        if options and options.get("family") not in ("held_out", "narrow"):
            raise ValueError(f"unknown family {options}")
        generator = np.random.default_rng(options["index"]) if options else self.np_random
        self.target = generator.uniform(-1.0, 1.0, 3)
        self.position = np.zeros(3)
        self.path, self.count = 0.0, 0
        return self._observe(), self._info(0.0)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        if not self.accept_nan and not np.all(np.isfinite(action)):
            raise ValueError("non-finite action")
        move = 0.1 * np.clip(np.nan_to_num(action[:3]), -1.0, 1.0) + self.np_random.normal(0.0, 0.005, 3)
        before = np.linalg.norm(self.target - self.position)
        self.position = np.clip(self.position + move, -5.0, 5.0)
        self.path += float(np.linalg.norm(move))
        self.count += 1
        if self.count == self.fail_at:
            raise RuntimeError("solver fell over")
        distance = float(np.linalg.norm(self.target - self.position))
        reached = distance < 0.15
        info = self._info(float(np.abs(move).sum()))
        done, late = reached, self.count >= self.horizon and not reached
        if done or late:
            info["path_ratio"] = self.path / float(np.linalg.norm(self.target))
            info["end_reason"] = "reached" if reached else "time"
        return self._observe(), float(before - distance) + float(reached), done, late, info

    def _observe(self) -> Any:
        extra = np.zeros(self.observation_space.shape[0] - 6)
        return np.concatenate([self.position, self.target - self.position, extra]).astype(np.float32)

    def _info(self, force: float) -> dict[str, Any]:
        distance = float(np.linalg.norm(self.target - self.position))
        return {
            "is_success": distance < 0.15,
            "cost": float(force > 0.25),
            "tip_error_mm": 1e3 * distance,
            "wall_force_n": force,
            "wall_force_max_n": force / 2,
            "time_s": 0.25 * self.count,
            "everted_length_mm": 1e3 * self.path,
            "catheter_length_mm": 1e3 * self.path + 2.5,
        }

    def render(self) -> Any:
        return np.full((48, 64, 3), min(255, 20 + 5 * self.count), dtype=np.uint8)


gymnasium.register("PointTask-v0", entry_point=PointTask)
gymnasium.register("PointTaskWide-v0", entry_point=PointTask, kwargs={"wide": True})


class TowardsTarget:
    """A controller that solves the task; `halfway` stops before the target."""

    def __init__(self, env: Any):
        self.env = env

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> Any:
        action = np.zeros(4, dtype=np.float32)
        action[:3] = np.clip(10.0 * observation[3:6], -1.0, 1.0)
        return action, state


class Still:
    """A controller that never moves."""

    def __init__(self, env: Any):
        self.env = env

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> Any:
        return np.zeros(4, dtype=np.float32), state
