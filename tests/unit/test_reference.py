"""The reference arms do not look: the same action whatever they see, for one environment or a batch."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

from evergym.agents.reference import PushOnlyPolicy, RandomPolicy, SlowPushPolicy


class Nothing(gymnasium.Env[Any, Any]):
    """As much of an environment as a policy that does not look needs."""

    action_space = spaces.Box(-1.0, 1.0, (4,), np.float32)


@pytest.mark.parametrize(("policy", "speed"), [(PushOnlyPolicy, 1.0), (SlowPushPolicy, 0.25)])
def test_pushing_is_one_action(policy: type[PushOnlyPolicy], speed: float) -> None:
    pushing = policy(Nothing())
    wanted = [speed, 0.0, -1.0, 1.0]  # no roll, no pull, full pressure
    for observation in (np.zeros(7), np.ones(7), {"observation": np.zeros(7), "desired_goal": np.zeros(3)}):
        action, state = pushing.predict(observation, state="kept")
        assert action.tolist() == wanted
        assert state == "kept"
        action[:] = 9.0  # the caller's own array
    batch, _ = pushing.predict(np.zeros((3, 7)))
    assert batch.tolist() == [wanted] * 3
    batch, _ = pushing.predict({"observation": np.zeros((2, 7))})
    assert batch.tolist() == [wanted] * 2


def test_random_actions_follow_the_seed_of_the_action_space() -> None:
    env = Nothing()
    policy = RandomPolicy(env)
    env.action_space.seed(3)
    first = [policy.predict(np.zeros(7))[0].tolist() for _ in range(5)]
    env.action_space.seed(3)
    assert [policy.predict(np.ones(7))[0].tolist() for _ in range(5)] == first
    assert len({tuple(action) for action in first}) == 5
    batch, _ = policy.predict(np.zeros((6, 7)))
    assert batch.shape == (6, 4)
    assert len({tuple(row) for row in batch.tolist()}) == 6
