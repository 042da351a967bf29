"""The player behind the page's buttons, the reel, the page without a browser, and what the commands say."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from evergym.agents.cli import main
from evergym.agents.play.episode_file import read_episode, write_episode
from evergym.agents.play.hand import DriveName
from evergym.agents.play.loop import Pace, run_paced
from evergym.agents.play.player import Mode, Player
from evergym.agents.play.readout import write_banner, write_readings
from evergym.agents.play.reel import Reel
from evergym.agents.play.session import Session
from evergym.agents.play.tubes import sample_axis, sweep_rolled_tip, sweep_round_tip, tube_faces
from evergym.units import MM


@pytest.fixture
def player(tmp_path: Path) -> Player:
    return Player(Session("MammobotPegs-v0"), tmp_path, options={"family": "paper", "index": 0})


@pytest.fixture(scope="module")
def episode_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds among pegs."""
    session = Session("MammobotPegs-v0")
    session.reset(0, {"family": "paper", "index": 0})
    session.hand_over("duty cycle")
    for _ in range(48):
        session.step()
    return write_episode(session.episode(), tmp_path_factory.mktemp("play") / "pegs.episode.npz")


# -- the player


def test_time_waits_for_the_first_command(player: Player) -> None:
    player.tick()
    assert player.mode is Mode.READY
    assert player.frame.values["time_s"] == 0.0
    player.post(lambda: player.press(DriveName.INSERTION, 1))
    player.tick()
    assert player.mode is Mode.READY  # a request is done by `answer`, in the one thread
    player.answer()
    player.tick()
    assert player.mode is Mode.RUNNING
    assert player.frame.values["time_s"] == pytest.approx(player.session.interval)


def test_pause_speed_and_reset(player: Player) -> None:
    player.press(DriveName.INSERTION, 1)
    player.speed = 4
    player.tick()
    assert len(player.session.frames) == 5
    player.pause()
    player.tick()
    assert len(player.session.frames) == 5
    player.pause()
    player.tick()
    assert len(player.session.frames) == 9
    before = player.place_number
    player.reset(3, {"family": "train", "index": 2})
    assert (player.mode, player.session.seed, len(player.session.frames)) == (Mode.READY, 3, 1)
    assert player.session.anatomy["anatomy_index"] == 2
    assert player.place_number == before + 1


def test_a_pause_stays_until_it_is_ended(player: Player) -> None:
    player.press(DriveName.INSERTION, 1)
    player.pause()
    player.set_drive(DriveName.PULL, 1.0 * MM)
    player.stop()
    assert player.mode is Mode.PAUSED
    assert player.session.hand.value[DriveName.PULL] == pytest.approx(1.0 * MM)
    player.hand_over("duty cycle")
    assert player.mode is Mode.RUNNING


def test_a_policy_without_numbers_is_relieved(player: Player) -> None:
    class Broken:
        def predict(self, observation: object, **_: object) -> tuple[object, object]:
            return np.full(4, np.nan, dtype=np.float32), ()

    player.hand_over("duty cycle")
    player.session._steerer = Broken()  # type: ignore[assignment]
    player.tick()
    assert (player.mode, player.driver) == (Mode.PAUSED, "hand")
    assert "must be a finite number" in player.notices[0][0]
    player.pause()
    player.tick()
    assert player.mode is Mode.RUNNING


def test_hands_relieve_a_controller(player: Player) -> None:
    player.hand_over("duty cycle")
    player.tick()
    assert player.driver == "duty cycle"
    player.set_drive(DriveName.PULL, 1.0 * MM)
    assert player.driver == "hand"
    assert player.session.hand.value[DriveName.PULL] == pytest.approx(1.0 * MM)


def test_what_cannot_be_done_becomes_a_notice(player: Player) -> None:
    for request in (
        lambda: player.hand_over("policy"),
        lambda: player.load_policy("no/such/run"),
        lambda: player.load_policy(" "),
        lambda: player.reset(0, {"family": "paper", "index": 99}),
        player.save,  # nothing has happened yet
    ):
        player.post(request)
    player.answer()
    assert [bad for _, bad in player.notices] == [True] * 5
    assert all("\n" not in text and text for text, _ in player.notices)
    assert player.mode is Mode.READY


def test_saved_episodes_can_be_read(player: Player) -> None:
    player.press(DriveName.INSERTION, 1)
    for _ in range(5):
        player.tick()
    one, other = player.save(), player.save()
    assert one != other  # within the same second
    assert len(read_episode(one).frames) == 6
    assert str(one) in player.notices[0][0]


def test_the_words_follow_the_state(player: Player) -> None:
    assert "Ready" in write_banner(Mode.READY, "hand", "", player.frame)
    assert "The duty cycle drives" in write_banner(Mode.RUNNING, "duty cycle", "", player.frame)
    assert "Target reached" in write_banner(Mode.ENDED, "hand", "reached", player.frame)
    assert "burst" in write_banner(Mode.ENDED, "hand", "burst", player.frame)
    assert f"{player.frame.values['tip_z_mm']:.1f} mm" in write_readings(player.frame)


# -- the reel


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


# -- the clock


def test_the_clock_keeps_pace_and_stops() -> None:
    count, stop, pace = 0, threading.Event(), Pace()

    def step() -> None:
        nonlocal count
        count += 1
        if count == 10:
            stop.set()

    begin = time.monotonic()
    run_paced(step, 0.01, stop, pace)
    assert count == 10
    assert time.monotonic() - begin >= 0.085  # nine waits; a slow machine takes longer, none is shorter


# -- tubes


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


# -- the page without a browser


def test_the_page_follows_the_player(player: Player) -> None:
    from evergym.agents.play.play_page import PlayPage
    from evergym.agents.play.server import start_server, stop_server

    server = start_server("127.0.0.1", 0, "test")
    try:
        page = PlayPage(server, player)
        page.draw()
        player.hand_over("duty cycle")
        for _ in range(12):
            player.tick()
            page.draw()
        assert "The duty cycle drives" in page._banner.content
        assert f"{player.frame.values['tip_z_mm']:.1f} mm" in page._readings.content
        pressure = player.session.commands()[DriveName.PRESSURE]
        assert page._sliders[DriveName.PRESSURE].value == pytest.approx(pressure / 1e3, abs=0.01)
        player.reset(0, {"family": "train", "index": 1})
        page.draw()
        assert page._family.value == "train"
        page.close()
    finally:
        stop_server(server)


# -- the commands


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["play", "--env", "MammobotDukt-v0"], "Did you mean 'MammobotDuct-v0'"),
        (["play", "--env", "CartPole-v1"], "no robot of this package"),
        (["play", "--model", "no_such_model"], "no_such_model"),
        (["play", "--policy", "no/such/run"], "no/such/run"),
        (["play", "--mesh", "no_such.stl"], "no_such.stl"),
        (["play", "--family", "no_such"], "no_such"),
        (["play", "--index", "-1"], "-1"),
        (["play", "--seed", "-1"], "0 or above"),
        (["play", "--port", "70000"], "0..65535"),
        (["play", "--host", "999.1.2.3"], "999.1.2.3"),
        (["play", "--speed", "3"], "1, 2, 4, 8"),
        (["play", "--env-options", "no_such=1"], "no_such"),
        (["replay", "no_such.episode.npz"], "no_such.episode.npz"),
        (["replay", "."], "neither episodes"),
        (["replay", "x.npz", "--size", "100", "33"], "even"),
    ],
    ids=lambda value: " ".join(value[:2]) if isinstance(value, list) else "",
)
def test_what_is_wrong_is_said_in_one_line(
    words: list[str], expected: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if "--port" not in words:
        words = [*words, "--port", "0"]
    assert main(words) == 2
    errors = capsys.readouterr().err.strip()
    assert expected in errors
    assert len(errors.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["play", "replay"])
def test_help_is_light(command: str) -> None:
    heavy = ("numba", "scipy", "torch", "vtk", "viser", "trimesh")
    code = f"""
import sys
from evergym.agents.cli import main
try:
    main([{command!r}, "--help"])
finally:
    print([name for name in {heavy} if name in sys.modules])
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("command", [["play"], ["replay", "pegs.episode.npz"]], ids=["play", "replay"])
def test_a_busy_port_is_named(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main([*command, "--port", str(port)]) == 2
    errors = capsys.readouterr().err.strip()
    assert f"Port {port} of 127.0.0.1 is in use" in errors
    assert len(errors.splitlines()) == 1


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
