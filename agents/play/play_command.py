"""``evergym play``: drive the robot by hand in a browser."""

from __future__ import annotations

import dataclasses
import os
import sys
import threading
import time
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evergym.errors import ConfigError, EvergymError

if TYPE_CHECKING:
    from evergym.agents.play.player import Player

__all__ = ["Play", "open_browser"]


@dataclasses.dataclass(frozen=True)
class Play:
    """Drive the robot by hand in a browser: sliders and keys, plots, the view from the tip; hand over and take back."""

    env: str | None = None
    """Environment id (None: that of the policy, else MammobotDuct-v0)."""
    model: str | None = None
    """Name of a shipped model or a model file (None: the environment's)."""
    env_options: tuple[str, ...] | None = None
    """Further arguments of the environment as key=value (None: those of the policy's run)."""
    family: str | None = None
    """Family of the anatomy (None: the environment's)."""
    index: int = 0
    """Number of the anatomy in its family."""
    mesh: Path | None = None
    """A mesh of your own, in mm, or a duct.toml, instead of family and index."""
    seed: int = 0
    """Seed of target and noise."""
    policy: Path | None = None
    """Run folder of a trained policy that can drive as well."""
    speed: int = 1
    """How many times faster than real time it begins with: 1, 2, 4 or 8."""
    host: str = "127.0.0.1"
    """Address to serve at; the default is seen by this machine only."""
    port: int = 8080
    """Port to serve at (0: any free one)."""
    folder: Path = Path("runs/play")
    """Where episodes are saved."""
    no_browser: bool = False
    """Open no browser, only print the page's address (without a display none is opened anyway)."""
    benchmark: float | None = None
    """Drive by the duty cycle for so many seconds without waiting for a page, print the update rate, and end."""

    def run(self) -> int:
        """Serve the page until Ctrl-C; returns 0, or 2 if it cannot be served as asked."""
        try:
            return self._serve()
        except EvergymError as error:
            print(f"evergym play: {error}", file=sys.stderr)
            return 2

    def _serve(self) -> int:
        from evergym.agents.play.server import check_address, describe_address, start_server, stop_server
        from evergym.compilation import announce_compilation

        check_address(self.host, self.port)  # before anything that takes time
        with announce_compilation():
            player = self._make_player()
        from evergym.agents.play.play_page import PlayPage

        server = start_server(self.host, self.port, "MAMMOBOT")
        try:
            with announce_compilation():
                page = PlayPage(server, player)
                page.draw()
            address = describe_address(server, self.host)
            print(f"Drive the robot at {address}  (Ctrl-C ends)", flush=True)
            if self.benchmark is not None:
                return _measure(server, player, page, self.benchmark)
            open_browser(address, not self.no_browser)
            _drive(server, player, page)
        finally:
            stop_server(server)
            player.session.close()
        return 0

    def _make_player(self) -> Player:
        from evergym.agents.play.episode_file import check_folder
        from evergym.agents.play.player import SPEEDS, Player
        from evergym.agents.play.session import Session
        from evergym.agents.run_folder import RunFolder
        from evergym.agents.settings import parse_options

        name, texts = self.env, self.env_options
        if self.policy is not None:
            trained = RunFolder.open(self.policy).settings
            name = name or trained.env
            texts = trained.env_options if texts is None else texts
        if self.speed not in SPEEDS:
            raise ConfigError(f"--speed is {self.speed}; it must be one of {', '.join(map(str, SPEEDS))}.")
        check_folder(self.folder)
        options = parse_options(texts or ())
        if self.model is not None:
            options["model"] = self.model
        print("Preparing the robot and its place ...", flush=True)
        session = Session(name or "MammobotDuct-v0", options, self.policy)
        reset: dict[str, Any] = {"duct": str(self.mesh)} if self.mesh is not None else {"index": self.index}
        if self.family is not None and self.mesh is None:
            reset["family"] = self.family
        player = Player(session, self.folder, seed=self.seed, options=reset)
        player.speed = self.speed
        return player


def open_browser(address: str, wanted: bool) -> None:
    """Open the page where there is a display; a text browser in the terminal would help nobody."""
    display = sys.platform in ("darwin", "win32") or {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()
    if wanted and display:
        webbrowser.open(address)


def _drive(server: Any, player: Player, page: Any) -> None:
    """Let time pass while somebody looks; without a page the robot waits where it is."""
    from evergym.agents.play.loop import Pace, run_paced

    pace, stop = Pace(), threading.Event()

    def step() -> None:
        player.answer()
        if server.get_clients():
            player.tick()
            page.draw(pace)

    try:
        run_paced(step, player.session.interval, stop, pace)
    except KeyboardInterrupt:
        print("\nStopped.", flush=True)


def _measure(server: Any, player: Player, page: Any, seconds: float) -> int:
    """Print how often the page is updated while the robot moves in real time."""
    from evergym.agents.play.loop import Pace, run_paced

    pace, stop = Pace(), threading.Event()
    count, work, begin = 0, 0.0, time.monotonic()
    robot_time = 0.0

    def step() -> None:
        nonlocal count, work, robot_time
        started = time.monotonic()
        if player.mode.value == "ended":
            player.reset()
        if player.driver == "hand":
            player.hand_over("duty cycle")
        player.tick()
        page.draw(pace)
        count, work, robot_time = count + 1, work + time.monotonic() - started, robot_time + player.session.interval
        if time.monotonic() - begin >= seconds:
            stop.set()

    run_paced(step, player.session.interval, stop, pace)
    span = time.monotonic() - begin
    print(
        f"{count / span:.1f} updates a second, {robot_time / span:.2f} s of robot time per second, "
        f"{1e3 * work / count:.1f} ms of work per update, {len(server.get_clients())} pages open"
    )
    return 0
