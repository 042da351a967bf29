"""The endoscope's picture as an observation: beside the same state, seen by a policy that learns."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

from evergym.agents.arms import find_controller_arm, make_policy
from evergym.agents.env_factory import make_env
from evergym.agents.episodes import run_episode

PUSH = np.array([1.0, 0.2, 0.0, 1.0], dtype=np.float32)


def test_the_state_is_that_of_the_plain_environment() -> None:
    """Bit for bit, with the noise of a localisation too: looking changes nothing."""
    plain, seeing = (
        gymnasium.make("evergym:MammobotDuct-v0", pool_size=1, localisation_noise_mm=0.5, observation=kind)
        for kind in ("state", "state+image")
    )
    first, second = plain.reset(seed=2)[0], seeing.reset(seed=2)[0]
    pictures = []
    for _ in range(12):
        np.testing.assert_array_equal(first, second["state"])
        pictures.append(second["endoscope"])
        one, two = plain.step(PUSH), seeing.step(PUSH)
        assert one[1:] == two[1:]
        first, second = one[0], two[0]
    assert pictures[0].shape == (64, 64, 3)
    assert pictures[0].dtype == np.uint8
    assert np.abs(pictures[0].astype(int) - pictures[-1]).mean() > 1.0  # the robot moved, and so did what it sees


def test_a_hidden_map_hides_the_target() -> None:
    """Green is the target's alone, and it is gone where the map is hidden."""
    green = []
    for hide in (False, True):
        env = gymnasium.make("evergym:MammobotPegs-v0", observation="state+image", hide_map=hide)
        image = env.reset(seed=0, options={"family": "paper", "index": 1})[0]["endoscope"].astype(int)
        green.append(np.count_nonzero(image[..., 1] - image[..., 0] > 60))
    assert green[0] > 0
    assert green[1] == 0


@pytest.mark.parametrize("name", ["MammobotPegs-v0", "MammobotPegsGoal-v0"])
def test_the_duty_cycle_drives_beside_the_picture(name: str) -> None:
    """A scripted controller reads the state's part."""
    env = make_env(name, {"observation": "state+image", "family": "paper", "reward": {"success": 6.0}})
    policy = make_policy(find_controller_arm("duty_cycle"), env)
    record = run_episode(env, policy, arm="duty_cycle", split="paper", index=1, seed=0)
    assert record.success


def test_ppo_learns_from_it() -> None:
    """SB3's MultiInputPolicy takes the dictionary as it is, and its convolutions get a gradient."""
    from stable_baselines3 import PPO

    env = gymnasium.make("evergym:MammobotPegs-v0", pool_size=1, observation="state+image")
    model = PPO("MultiInputPolicy", env, n_steps=32, batch_size=32, n_epochs=1, seed=0, device="cpu")
    kernels = [value for key, value in model.policy.named_parameters() if ".cnn." in key and value.ndim == 4]
    before = [value.detach().clone() for value in kernels]
    model.learn(64)
    assert kernels
    assert all(bool((old != new).any()) for old, new in zip(before, kernels, strict=True))
