"""Every registered id, and every option of an environment, passes both checkers without one warning."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
import stable_baselines3.common.env_checker as sb3_checker
from gymnasium.utils import env_checker

import evergym

IDS = sorted(evergym.ENTRY_POINTS)
# Small pools: what is checked is the interface, and every duct costs the time to make it once.
VARIANTS: list[tuple[str, dict[str, Any]]] = [
    *((name, {}) for name in IDS),
    ("MammobotDuct-v0", {"localisation_noise_mm": 0.5}),
    ("MammobotDuct-v0", {"hide_map": True}),
    ("MammobotDuct-v0", {"model_randomisation": 1.0}),
    ("MammobotDuct-v0", {"control_step_s": 0.6, "time_limit_s": 400.0, "reward": {"success": 10.0}}),
    ("MammobotDuct-v0", {"family": "true_scale_train", "model": "mammobot_2021"}),
    ("MammobotPegs-v0", {"family": "paper", "localisation_noise_mm": 0.5, "hide_map": True}),
    ("MammobotPegs-v0", {"family": "dense"}),
    ("MammobotDuct-v0", {"view": "endoscope", "width": 48, "height": 40}),
    ("MammobotPegs-v0", {"view": "map"}),
    ("MammobotDuct-v0", {"observation": "state+image"}),
    ("MammobotPegsGoal-v0", {"observation": "state+image", "hide_map": True}),
    ("MammobotDuctGoal-v0", {"goal_reward": "dense"}),
    ("MammobotPegsGoal-v0", {"goal_reward": "dense", "hide_map": True, "model_randomisation": 0.5}),
]


@pytest.mark.parametrize(("name", "arguments"), VARIANTS, ids=lambda value: str(value))
def test_checkers_find_nothing(name: str, arguments: dict[str, Any]) -> None:
    """Warnings are errors in this suite, so a warning of either checker fails."""
    # Frames are checked once per id and view; other options do not change them.
    render = not arguments or "view" in arguments
    env = gymnasium.make(name, pool_size=1, render_mode="rgb_array" if render else None, **arguments).unwrapped
    env_checker.check_env(env, skip_render_check=not render)
    sb3_checker.check_env(env)
    env.close()


@pytest.mark.parametrize("name", IDS)
def test_random_actions_keep_the_contract(name: str) -> None:
    """Python types, finite values inside the space, and reward terms that sum to the reward."""
    env = gymnasium.make(name, pool_size=1)
    env.action_space.seed(5)
    observation, info = env.reset(seed=5)
    assert observation in env.observation_space
    for _ in range(60):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert observation in env.observation_space
        assert type(reward) is float
        assert type(terminated) is bool
        assert type(truncated) is bool
        assert reward == sum(value for key, value in info.items() if key.startswith("reward/"))
        assert info["cost"] == info["cost_wall_force"] + info["cost_burst"] + info["cost_buckling"]
        for key, value in info.items():
            assert type(value) in (bool, int, float, str), key
            assert not isinstance(value, float) or np.isfinite(value), key
        if terminated or truncated:
            break


@pytest.mark.parametrize("name", IDS)
def test_spec_survives_json(name: str) -> None:
    """A run folder stores the spec as text and makes the same environment from it."""
    env = gymnasium.make(name, pool_size=1, reward={"success": 7.0}, hide_map=True)
    assert env.spec is not None
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    first, _ = env.reset(seed=3)
    second, _ = again.reset(seed=3)
    assert str(first) == str(second)


def test_worker_processes_need_no_import() -> None:
    """The module-prefixed id works in spawned workers, which have imported nothing."""
    venv = gymnasium.make_vec(
        "evergym:MammobotPegs-v0",
        num_envs=2,
        vectorization_mode="async",
        vector_kwargs={"context": "spawn"},
        pool_size=1,
    )
    observation, _ = venv.reset(seed=0)
    assert observation in venv.observation_space
    observation, *_ = venv.step(np.zeros((2, 4), dtype=np.float32))
    assert observation in venv.observation_space
    venv.close()
