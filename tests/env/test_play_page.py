"""The player behind the page's buttons, the page without a browser, and what the commands say."""

from __future__ import annotations

import asyncio
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from evergym.agents.cli import main
from evergym.agents.play.episode_file import check_folder, read_episode
from evergym.agents.play.hand import DriveName
from evergym.agents.play.loop import Pace, run_paced
from evergym.agents.play.player import Mode, Player
from evergym.agents.play.readout import write_banner, write_number, write_readings
from evergym.agents.play.session import Session
from evergym.agents.play.stage import PIN_CLEARANCE, find_pin_head
from evergym.compilation import COMPILING, announce_compilation
from evergym.duct_models.duct import generate_duct
from evergym.errors import EvergymError, RunError
from evergym.units import MM


@pytest.fixture
def player(tmp_path: Path) -> Player:
    return Player(Session("MammobotPegs-v0"), tmp_path, options={"family": "paper", "index": 0})


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
    assert [write_number(value, 1) for value in (-0.04, 0.0, -0.05001, 2.0)] == ["0.0", "0.0", "-0.1", "2.0"]


def test_the_banner_says_that_the_catheter_is_held(player: Player) -> None:
    """Without pressure nothing grows: the catheter goes 10 mm ahead of the sheath, and no further."""
    player.set_drive(DriveName.INSERTION, 2.9 * MM)
    said = [True]
    while len(said) < 120:
        player.tick()
        said.append("Catheter held: 10 mm ahead" in write_banner(player.mode, "hand", "", player.frame))
    values = player.frame.values
    assert values["catheter_length_mm"] - values["everted_length_mm"] == pytest.approx(10.0, abs=0.1)
    assert not said[1]
    assert said[-1]
    player.stop()
    player.tick()
    assert "You drive" in write_banner(player.mode, "hand", "", player.frame)
    assert "Catheter held" not in write_banner(player.mode, "hand", "", player.frame)


def test_compiling_is_announced_and_finding_is_not() -> None:
    from numba.core import event

    told: list[str] = []
    heard = threading.Event()

    def tell(text: str) -> None:
        told.append(text)
        heard.set()

    with announce_compilation(tell, patience=0.01):
        pass
    with announce_compilation(tell, patience=30.0), event.trigger_event("numba:compile"):
        pass
    assert told == []
    with announce_compilation(tell, patience=0.01), event.trigger_event("numba:compile"):
        assert heard.wait(10.0)
        with event.trigger_event("numba:compile"):
            time.sleep(0.05)
    assert told == [COMPILING]


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
        page._index.value = -1
        page._family.value = "paper"
        with pytest.raises(EvergymError, match="Number is -1; it"):
            page._go()
        assert (page._family.value, page._index.value) == ("train", 1)  # where the robot still is
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
        (["play", "--env-options", "no_such"], "control_step_s=0.5"),
        (["play", "--env", "Nope-v0"], "MammobotPegs-v0"),
        (["play", "--folder", "/proc/no/such"], "No episodes can be saved in --folder '/proc/no/such'"),
        (["replay", "x.npz", "--video", "x.avi"], "does not end in .mp4"),
        (["replay", "x.npz", "--png", "x.gif"], "does not end in .png"),
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


def test_a_folder_is_only_tried(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "there").mkdir()
    check_folder(tmp_path / "new" / "folder")
    check_folder(tmp_path / "there")
    with pytest.raises(RunError, match="is a file"):
        check_folder(tmp_path / "file")
    with pytest.raises(RunError, match="No episodes can be saved"):
        check_folder(tmp_path / "file" / "folder")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "there"]
    assert list((tmp_path / "there").iterdir()) == []


def test_the_pin_of_the_target_leaves_the_duct() -> None:
    duct = generate_duct("held_out", 0)
    target = np.array(duct.targets[0].position)
    head = find_pin_head(duct, target)
    np.testing.assert_array_equal(head[[0, 2]], target[[0, 2]])
    assert head[1] > target[1]
    line = duct.centreline
    assert np.min(np.linalg.norm(line.position - head, axis=1) - line.radius) >= PIN_CLEARANCE
    below = np.min(np.linalg.norm(line.position - (head - (0.0, 1.0 * MM, 0.0)), axis=1) - line.radius)
    assert below < PIN_CLEARANCE  # and no further than it has to


def test_a_moved_slider_is_taken_though_the_page_is_drawn_before_it_is_answered(player: Player) -> None:
    from viser._messages import GuiUpdateMessage

    from evergym.agents.play.play_page import PlayPage
    from evergym.agents.play.server import start_server, stop_server

    server = start_server("127.0.0.1", 0, "test")
    try:
        page = PlayPage(server, player)
        slider = page._sliders[DriveName.INSERTION]
        server._connected_clients[0] = cast(Any, object())
        free, threads = threading.Event(), ThreadPoolExecutor(1)
        threads.submit(free.wait)  # as on a busy machine, where callbacks wait for a thread
        server.gui._thread_executor = threads
        asyncio.run(server.gui._handle_gui_updates(0, GuiUpdateMessage(slider._impl.uuid, {"value": slider.max})))
        del server._connected_clients[0]
        page.draw()
        free.set()
        threads.shutdown(wait=True)
        player.answer()
        assert player.mode is Mode.RUNNING
        assert player.session.hand.value[DriveName.INSERTION] == player.session.hand.range(DriveName.INSERTION)[1]
        page.draw()
        assert slider.value == slider.max
        page.close()
    finally:
        stop_server(server)
