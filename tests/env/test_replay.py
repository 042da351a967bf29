"""What is done with recorded episodes: the reel, the robot's surface, pictures and films."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evergym.agents.cli import main
from evergym.agents.play.episode_file import read_episode, write_episode
from evergym.agents.play.film import find_empty_corner
from evergym.agents.play.reel import Reel
from evergym.agents.play.session import Session
from evergym.agents.play.tubes import sample_axis, sweep_rolled_tip, sweep_round_tip, tube_faces
from evergym.units import MM


@pytest.fixture(scope="module")
def episode_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds among pegs."""
    session = Session("MammobotPegs-v0")
    session.reset(0, {"family": "paper", "index": 0})
    session.hand_over("duty cycle")
    for _ in range(48):
        session.step()
    return write_episode(session.episode(), tmp_path_factory.mktemp("play") / "pegs.episode.npz")


def test_a_reel_plays_stops_and_searches(episode_path: Path) -> None:
    reel = Reel(read_episode(episode_path))
    assert reel.duration == pytest.approx(2.0)
    reel.tick(0.5)
    assert reel.frame.values["time_s"] == pytest.approx(0.5)
    reel.seek(1.25)
    reel.tick(0.5)
    assert reel.frame.values["time_s"] == pytest.approx(1.25)  # a hand on the slider stops it
    reel.step(-6)
    assert reel.frame.values["time_s"] == pytest.approx(1.0)
    reel.speed = 4.0
    reel.play()
    reel.tick(10.0)
    assert reel.at_end
    assert not reel.playing
    reel.play()
    assert reel.number == 0
    assert reel.playing
    reel.seek(-5.0)
    assert reel.number == 0


def test_tubes_lie_around_the_robot(episode_path: Path) -> None:
    pose = read_episode(episode_path).frames[-1].pose
    shape, radius, length = pose.shape, 1.5 * MM, 9.0 * MM
    vertices = sweep_rolled_tip(shape, length, radius, 0.5 * MM)
    assert tube_faces().max() == len(vertices) - 1
    line = sample_axis(shape, np.linspace(0.0, length, 2000)).position
    distance = np.min(np.linalg.norm(vertices[:, None] - line[None], axis=2), axis=1)
    assert distance.max() < 1.001 * radius
    assert np.median(distance) == pytest.approx(radius, rel=1e-3)
    rod = sweep_round_tip(shape, float(shape.station[-1]), 0.5 * MM)
    assert np.linalg.norm(rod[-1] - shape.position[-1]) < 0.01 * MM  # its round end is at the tip
    at_nodes = sample_axis(shape, shape.station).position
    np.testing.assert_allclose(at_nodes, shape.position, atol=1e-9)


def test_the_inset_hides_the_least() -> None:
    picture = np.full((90, 120, 3), 255, dtype=np.uint8)
    assert find_empty_corner(picture, 30) == (slice(8, 38), slice(82, 112))
    picture[20, 90] = 200
    assert find_empty_corner(picture, 30) == (slice(52, 82), slice(82, 112))
    picture[60, 90] = picture[60, 20] = 0
    picture[61, 90] = 0
    picture[5:8, 20] = picture[84:88, 20] = 0  # caption and scale bar are not in the way
    assert find_empty_corner(picture, 30) == (slice(9, 39), slice(8, 38))
    picture[15:25, 20] = 0
    assert find_empty_corner(picture, 30) == (slice(8, 38), slice(82, 112))


def test_an_instant_beyond_the_end_is_refused(episode_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for at in ("9999", "-1"):
        assert main(["replay", str(episode_path), "--png", "x.png", "--at", at]) == 2
        assert capsys.readouterr().err == f"evergym replay: --at is {at} s; the episode goes from 0 to 2.0 s.\n"


def test_a_film_and_pictures_without_a_display(episode_path: Path, tmp_path: Path) -> None:
    import imageio_ffmpeg
    from PIL import Image

    sheet, film = tmp_path / "sheet.png", tmp_path / "film.mp4"
    size = ["--size", "160", "120"]
    assert main(["replay", str(episode_path), "--png", str(sheet), "--video", str(film), "--speed", "8", *size]) == 0
    picture = np.asarray(Image.open(sheet))
    assert picture.shape == (240, 640, 3)
    assert np.any(picture[:120, :160] != picture[120:, 480:])  # something has moved
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(film))
    assert frames >= 2.0 / 8 * 24 + 24  # two seconds eight times as fast, and the end is seen for a second
    assert seconds == pytest.approx(frames / 24, rel=0.05)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["film.mp4", "sheet.png"]
    assert main(["replay", str(episode_path), "--png", str(sheet)]) == 2  # not overwritten
