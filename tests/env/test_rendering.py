"""Frames: the right kind of array, with place, robot, target and contacts in them, without a display."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

PUSH = np.array([1.0, 0.0, -0.5, 1.0], dtype=np.float32)


def count(frame: NDArray[np.uint8], channel: int, margin: int = 40) -> int:
    """How many pixels have ``channel`` well above the other two."""
    pixels = frame.astype(int)
    others = [pixels[..., other] for other in range(3) if other != channel]
    return int(
        np.count_nonzero((pixels[..., channel] - others[0] > margin) & (pixels[..., channel] - others[1] > margin))
    )


@pytest.mark.parametrize("name", ["MammobotDuct-v0", "MammobotPegsGoal-v0"])
def test_frames_show_robot_and_target(name: str) -> None:
    """Fresh uint8 arrays of the default size; the target is green; what moves moves."""
    env = gymnasium.make(name, render_mode="rgb_array", pool_size=1)
    env.reset(seed=0)
    first = env.render()
    assert isinstance(first, np.ndarray)
    assert first.shape == (360, 480, 3)
    assert first.dtype == np.uint8
    assert count(first, 1) > 50
    kept = first.copy()
    for _ in range(20):
        env.step(PUSH)
    second = env.render()
    np.testing.assert_array_equal(first, kept)
    moved = np.any(second != first, axis=2)
    assert 50 < np.count_nonzero(moved) < 0.3 * moved.size  # the robot, not the whole picture
    np.testing.assert_array_equal(env.render(), second)
    env.close()
    env.close()


def test_contacts_are_drawn() -> None:
    """Once the tip presses on a wall, the picture has the contact's orange, which nothing else has."""
    env = gymnasium.make("MammobotDuct-v0", render_mode="rgb_array", pool_size=1)
    env.reset(seed=0)

    def count_contact() -> int:
        red, _, blue = np.moveaxis(np.asarray(env.render()).astype(int), -1, 0)
        return int(np.count_nonzero(red - blue > 150))

    assert count_contact() == 0
    force = 0.0
    for _ in range(200):
        _, _, terminated, truncated, info = env.step(PUSH)
        force = info["wall_force_max_n"]
        if force > 0.05 or terminated or truncated:
            break
    assert force > 0.05
    assert count_contact() > 0
    env.close()


def test_a_new_episode_gets_a_new_picture() -> None:
    """Another duct, another target: the place is built anew."""
    env = gymnasium.make("MammobotDuct-v0", render_mode="rgb_array")
    frames = []
    for index in range(2):
        env.reset(seed=0, options={"index": index, "target": 0})
        frames.append(np.asarray(env.render()))
    assert np.count_nonzero(np.any(frames[0] != frames[1], axis=2)) > 2000
    env.reset(seed=0, options={"index": 0, "target": 0})
    np.testing.assert_array_equal(env.render(), frames[0])
    env.close()


def test_without_render_mode_there_is_no_renderer() -> None:
    """Training processes pay nothing: a warning and no frame."""
    env = gymnasium.make("MammobotPegs-v0").unwrapped
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None
