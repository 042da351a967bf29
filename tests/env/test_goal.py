"""Goals: the reward is a pure, vectorised function of them, and their error is the way along the lumen."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from evergym.duct_models.centreline import Location
from evergym.duct_models.duct import generate_duct
from evergym.envs.goal import (
    GOAL_SCALE,
    LUMEN_COORDINATES,
    MammobotDuctGoalEnv,
    MammobotPegsGoalEnv,
    compute_lumen_coordinates,
    measure_tree,
)
from evergym.errors import GeometryError
from evergym.units import MM

PUSH = np.array([1.0, 0.0, -0.2, 1.0], dtype=np.float32)


@pytest.mark.parametrize("env_class", [MammobotDuctGoalEnv, MammobotPegsGoalEnv])
@pytest.mark.parametrize("goal_reward", ["sparse", "dense"])
def test_reward_is_compute_reward(env_class: Any, goal_reward: str) -> None:
    """Step by step and in one batch, bit for bit; a batch of empty infos only loses failure and wall force."""
    env = env_class(goal_reward=goal_reward, pool_size=1)
    env.reset(seed=0)
    achieved, desired, rewards, infos = [], [], [], []
    for _ in range(150):
        observation, reward, terminated, truncated, info = env.step(PUSH)
        achieved.append(observation["achieved_goal"])
        desired.append(observation["desired_goal"])
        rewards.append(reward)
        infos.append(info)
        if terminated or truncated:
            break
    batch = env.compute_reward(np.array(achieved), np.array(desired), infos)
    assert batch.shape == (len(rewards),)
    np.testing.assert_array_equal(batch, rewards)
    for index, reward in enumerate(rewards):
        assert env.compute_reward(achieved[index], desired[index], infos[index]) == reward
    bare = env.compute_reward(np.array(achieved), np.array(desired), [{}] * len(rewards))
    np.testing.assert_array_equal(bare, [info["reward/goal"] for info in infos])
    own = env.compute_reward(np.array(achieved), np.array(achieved), [{}] * len(rewards))
    np.testing.assert_array_equal(own, 0.0)


@pytest.mark.parametrize("env_class", [MammobotDuctGoalEnv, MammobotPegsGoalEnv])
def test_goal_error_is_the_tip_error(env_class: Any) -> None:
    """What the goals say and what info says differ by the rounding to float32 only: 1e-5 mm of 150 mm."""
    env = env_class(pool_size=2)
    for seed in range(3):
        env.reset(seed=seed)
        for _ in range(40):
            observation, _, terminated, _, info = env.step(PUSH)
            error = env.compute_goal_error(
                observation["achieved_goal"].astype(np.float64), observation["desired_goal"].astype(np.float64)
            )
            assert error / MM == pytest.approx(info["tip_error_mm"], abs=1e-3)
            if terminated:
                break


@pytest.mark.parametrize("family", ["train", "deep", "true_scale_train"])
def test_lumen_coordinates_keep_distances(family: str) -> None:
    """The sum of absolute differences is the distance along the lumen for any two places of a duct."""
    rng = np.random.default_rng(0)
    for index in range(2):
        line = generate_duct(family, index).centreline
        tree = measure_tree(line, "test")
        places: list[Location] = []
        for node in rng.integers(1, len(line.station), 30).tolist():
            fraction = float(rng.random())
            start = line.station[line.parent[node]]
            station = float(start + fraction * (line.station[node] - start))
            places.append(Location(node, fraction, station, 0.0, int(line.branch[node])))
        for first in places:
            for second in places:
                if first.node == second.node:
                    continue
                gap = np.array(compute_lumen_coordinates(tree, first)) - compute_lumen_coordinates(tree, second)
                assert np.abs(gap).sum() == pytest.approx(line.distance_along(first, second), abs=1e-12)


def test_more_branches_than_coordinates_is_an_error() -> None:
    """Folding two branches onto one coordinate would report success behind a wall."""
    from evergym.duct_models.centreline import Centreline

    count = LUMEN_COORDINATES + 1
    position = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.01], *([0.001 * k, 0.0, 0.02] for k in range(count))])
    length = [0.0, 0.01, *(float(np.hypot(0.001 * k, 0.01)) + 0.01 for k in range(count))]
    line = Centreline(
        position,
        np.full(count + 2, 0.003),
        np.array([-1, 0, *[1] * count]),
        np.array(length),
        np.array([0, 0, *[1] * count]),
        np.array([0, 0, *range(1, count + 1)]),
    )
    with pytest.raises(GeometryError, match="18 branches"):
        measure_tree(line, "comb")


def test_goal_fits_the_space_as_far_as_the_robot_grows() -> None:
    """140 mm of everted sheath stay inside the scale, so no goal that is reached is clipped."""
    assert GOAL_SCALE > 140.0 * MM


def test_unknown_goal_reward_is_refused() -> None:
    """Sparse or dense, nothing else."""
    from evergym.errors import ConfigError

    with pytest.raises(ConfigError, match="'sparse' or 'dense'"):
        MammobotPegsGoalEnv(goal_reward="shaped")  # type: ignore[arg-type]


def test_hindsight_replay_trains() -> None:
    """SB3's replay buffer relabels the goals of two environments, and SAC takes gradient steps on them."""
    from stable_baselines3 import SAC, HerReplayBuffer
    from stable_baselines3.common.env_util import make_vec_env

    # An episode must end before its goals can be relabelled: 300 s are 120 steps.
    env = make_vec_env(
        MammobotDuctGoalEnv, n_envs=2, env_kwargs={"pool_size": 1, "control_step_s": 2.5, "hide_map": True}
    )
    model = SAC(
        "MultiInputPolicy",
        env,
        replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
        learning_starts=250,
        batch_size=32,
        policy_kwargs={"net_arch": [16]},
        device="cpu",
        seed=0,
    )
    model.learn(256)
    buffer: Any = model.replay_buffer
    rewards = buffer.sample(64).rewards.numpy()
    assert set(np.unique(rewards)) <= {-1.0, 0.0} or rewards.min() < -1.0  # failures cost more than a step
    assert (rewards == 0.0).any()  # relabelled goals are reached
    env.close()
