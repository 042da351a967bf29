"""The same seed gives the same bits: in another process, with another hash seed, after other episodes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import evergym

ROLLOUT = """
import hashlib, json, sys
import gymnasium, numpy as np
digest = hashlib.sha256()
for name in sys.argv[1:]:
    env = gymnasium.make("evergym:" + name, pool_size=2, localisation_noise_mm=0.3, model_randomisation=0.5)
    env.action_space.seed(11)
    for episode in range(2):
        observation, info = env.reset(seed=11 if episode == 0 else None)
        for step in range(30):
            parts = observation.values() if isinstance(observation, dict) else [observation]
            for part in parts:
                digest.update(part.tobytes())
            digest.update(json.dumps(info).encode())
            observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
            digest.update(np.float64(reward).tobytes())
            if terminated or truncated:
                break
print(digest.hexdigest())
"""


def roll_out(hash_seed: str) -> str:
    found = subprocess.run(
        [sys.executable, "-W", "error", "-c", ROLLOUT, *sorted(evergym.ENTRY_POINTS)],
        env={**os.environ, "PYTHONHASHSEED": hash_seed},
        cwd=Path(evergym.__file__).parents[1],
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.returncode == 0, found.stderr
    return found.stdout.strip()


def test_same_bits_in_every_process() -> None:
    """Two processes with different hash seeds agree on every observation, reward and info of all ids."""
    assert roll_out("1") == roll_out("2")


@pytest.mark.parametrize("name", ["MammobotDuct-v0", "MammobotPegs-v0"])
def test_earlier_episodes_leave_no_trace(name: str) -> None:
    """A seeded episode is the same in a fresh environment and in one that has run others."""
    used, fresh = (gymnasium.make(name, pool_size=2).unwrapped for _ in range(2))
    used.reset(seed=4)
    for _ in range(25):
        used.step(np.array([0.8, 0.5, 0.5, 1.0]))
    action = np.array([1.0, -0.4, 0.3, 0.9])
    first, _ = used.reset(seed=9)
    second, _ = fresh.reset(seed=9)
    for _ in range(25):
        np.testing.assert_array_equal(first, second)
        first, *_ = used.step(action)
        second, *_ = fresh.step(action)


def test_different_seeds_differ() -> None:
    """Seed 0 is a seed like any other."""
    env = gymnasium.make("MammobotDuct-v0", pool_size=64).unwrapped
    anatomies = {env.reset(seed=seed)[1]["anatomy_index"] for seed in (0, 1, 2, 3)}
    assert len(anatomies) > 1
    assert env.reset(seed=0)[1] == env.reset(seed=0)[1]
