"""Frames: the right kind of array, with place, robot, target and contacts in them, without a display."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from evergym.duct_models.pegs import paper_pegs
from evergym.envs.rendering.outside import OutsideView
from evergym.envs.rendering.pose import read_pose
from evergym.envs.rendering.side import list_corners
from evergym.envs.rendering.view import VIEWS, make_view
from evergym.envs.rendering.writing import find_legend_height
from evergym.errors import ConfigError
from evergym.model import load_model
from evergym.simulator import Simulator
from evergym.units import MM
from evergym.world import World

PUSH = np.array([1.0, 0.0, -0.5, 1.0], dtype=np.float32)


def count(frame: NDArray[np.uint8], channel: int, margin: int = 40) -> int:
    """How many pixels have ``channel`` well above the other two."""
    pixels = frame.astype(int)
    others = [pixels[..., other] for other in range(3) if other != channel]
    return int(
        np.count_nonzero((pixels[..., channel] - others[0] > margin) & (pixels[..., channel] - others[1] > margin))
    )


@pytest.mark.parametrize("name", ["evergym:MammobotDuct-v0", "evergym:MammobotPegsGoal-v0"])
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
    env = gymnasium.make("evergym:MammobotDuct-v0", render_mode="rgb_array", pool_size=1)
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
    env = gymnasium.make("evergym:MammobotDuct-v0", render_mode="rgb_array")
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
    env = gymnasium.make("evergym:MammobotPegs-v0").unwrapped
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None


@pytest.mark.parametrize(
    ("view", "given", "size"),
    [("outside", {"width": 200, "height": 120}, (120, 200)), ("endoscope", {}, (240, 240)), ("map", {}, (360, 480))],
)
@pytest.mark.parametrize("name", ["evergym:MammobotDuct-v0", "evergym:MammobotPegs-v0"])
def test_every_view_shows_place_robot_and_target(
    name: str, view: str, given: dict[str, int], size: tuple[int, int]
) -> None:
    """Of the size that was asked for, or the view's own; the target's green is there, and motion is seen."""
    env = gymnasium.make(name, render_mode="rgb_array", view=view, **given)
    env.reset(seed=0, options={"index": 0})
    first = np.asarray(env.render())
    assert first.shape == (*size, 3)
    assert count(first, 1, margin=25) > 3
    for _ in range(20):
        env.step(PUSH)
    second = np.asarray(env.render())
    assert np.count_nonzero(np.any(first != second, axis=2)) > 50
    env.close()


def test_map_and_outside_agree_on_where_the_robot_is() -> None:
    """Both show the insertion to the right: what moves reaches as much farther right in the one as in the other."""
    growth = []
    for view in ("map", "outside"):
        env = gymnasium.make("evergym:MammobotPegs-v0", render_mode="rgb_array", view=view)
        env.reset(seed=0, options={"index": 0})
        frames = [np.asarray(env.render())[40:300]]
        for _ in range(2):
            for _ in range(15):
                env.step(PUSH)
            frames.append(np.asarray(env.render())[40:300])
        ends = [np.flatnonzero((frames[k] != frames[k + 1]).any(axis=(0, 2))).max() for k in range(2)]
        corners = list_corners(env.unwrapped.peg_field, margin=5 * MM)
        growth.append(int(ends[1] - ends[0]) / frames[0].shape[1] * np.ptp(corners[:, 2]) / MM)
        env.close()
    assert growth[0] > 5.0
    # The outside view is turned by 10 degrees, and both leave a border of some per cent.
    assert abs(growth[0] - growth[1]) < 0.15 * growth[0]


@pytest.mark.parametrize("view", ["outside", "endoscope", "map"])
def test_render_before_reset_is_an_error_that_says_so(view: str) -> None:
    """Gymnasium's own wrapper says it first; without it the environment does."""
    env = gymnasium.make("evergym:MammobotPegs-v0", render_mode="rgb_array", view=view)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.render()
    with pytest.raises(gymnasium.error.ResetNeeded, match="before reset"):
        env.unwrapped.render()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"view": "endscope"}, "Did you mean 'endoscope'"),
        ({"width": 0}, "width is 0"),
        ({"height": 100_000}, "height is 100000 pixels; it must be at most 8192"),
        ({"observation": "image"}, "Did you mean 'state.image'"),
    ],
)
def test_impossible_pictures_are_refused(arguments: dict[str, Any], message: str) -> None:
    """With the value, its limit and the nearest name."""
    with pytest.raises(ConfigError, match=message):
        gymnasium.make("evergym:MammobotDuct-v0", render_mode="rgb_array", **arguments)


def test_views_draw_a_kept_pose_and_free_space() -> None:
    """A replay has poses and no simulator; a robot outside of any duct can be looked at too."""
    simulator = Simulator(load_model("mammobot_2023"))
    simulator.reset(everted_length=40 * MM)
    kept = read_pose(simulator)
    simulator.reset(everted_length=90 * MM)
    for name in VIEWS:
        view = make_view(name, None, (0.0, 0.0, 100 * MM), 160, 120)
        old, new = view.frame(kept, "forty"), view.frame(simulator, "ninety")
        assert old.shape == (120, 160, 3)
        assert (old != new).any()
        np.testing.assert_array_equal(view.frame(kept, "forty"), old)
        view.close()


def test_a_figure_has_its_legend() -> None:
    """The strip at the bottom is the legend's, and the place keeps out of it."""
    field = paper_pegs(0)
    simulator = Simulator(load_model("mammobot_2023"), World.peg_field(field))
    plain, explained = (OutsideView(field, legend=legend).frame(simulator) for legend in (False, True))
    strip = explained[-find_legend_height((480, 360)) :].astype(int)
    assert np.ptp(strip, axis=2).max() > 100  # colours
    assert not np.array_equal(plain, explained)
