"""``evergym replay``: look at a recorded episode, or at what a trained policy does, in a browser or as a film."""

from __future__ import annotations

import dataclasses
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from evergym.errors import ConfigError, EvergymError, RunError

if TYPE_CHECKING:
    from evergym.agents.play.episode import Episode

__all__ = ["Replay"]


@dataclasses.dataclass(frozen=True)
class Replay:
    """Look at a recorded episode again: search it in a browser, or write a film or a picture of it."""

    source: tyro.conf.Positional[Path]
    """An episode (*.episode.npz), a folder of episodes, or the run folder of a trained policy, which then drives."""
    family: str = "held_out"
    """For a run folder: family of the anatomy."""
    index: int = 0
    """For a run folder: number of the anatomy in its family."""
    seed: int | None = None
    """For a run folder: seed of target and noise (None: the one that `evergym evaluate` uses for this anatomy)."""
    video: Path | None = None
    """Write a film (.mp4) and no page."""
    png: Path | None = None
    """Write a picture (.png) and no page: a sheet of 8 instants, or one with --at."""
    at: float | None = None
    """Instant of the picture [s]."""
    speed: float = 1.0
    """Speed of the film."""
    size: tuple[int, int] = (960, 720)
    """Width and height of film and picture in pixels."""
    save: Path | None = None
    """For a run folder: write the episode to this file (*.episode.npz)."""
    host: str = "127.0.0.1"
    """Address to serve at; the default is seen by this machine only."""
    port: int = 8080
    """Port to serve at (0: any free one)."""
    no_browser: bool = False
    """Open no browser, only print the page's address (without a display none is opened anyway)."""

    def run(self) -> int:
        """Show the episode; returns 0, or 2 if it cannot be shown as asked."""
        try:
            return self._show()
        except EvergymError as error:
            print(f"evergym replay: {error}", file=sys.stderr)
            return 2

    def _show(self) -> int:
        from evergym.compilation import announce_compilation

        page = self.video is None and self.png is None
        self._check(page)
        with announce_compilation():
            return self._show_checked(page)

    def _show_checked(self, page: bool) -> int:
        episode, files = self._load()
        if self.save is not None:
            from evergym.agents.play.episode_file import write_episode

            print(f"Episode: {write_episode(episode, self.save)}")
        if self.png is not None:
            from evergym.agents.play.film import write_picture

            write_picture(episode, self.png, self.at, self.size)
            print(f"Picture: {self.png}")
        if self.video is not None:
            self._write_film(episode, self.video)
        return self._serve(episode, files) if page else 0

    def _check(self, page: bool) -> None:
        """Raise for what is wrong before anything that takes time."""
        for name, target, ending in (("--video", self.video, ".mp4"), ("--png", self.png, ".png")):
            if target is not None and target.suffix.lower() != ending:
                raise ConfigError(f"{name} '{target}' does not end in {ending}, the only format it is written in.")
        for path in (self.video, self.png, self.save):
            if path is not None and path.exists():
                raise RunError(f"'{path}' exists already and is not overwritten. Choose another file.")
        if not 0.01 <= self.speed <= 1000.0:
            raise ConfigError(f"--speed is {self.speed:g}; it must be in 0.01..1000.")
        if min(self.size) < 64 or max(self.size) > 4096 or any(side % 2 for side in self.size):
            raise ConfigError(f"--size is {self.size[0]} {self.size[1]}; both must be even and in 64..4096 pixels.")
        if self.index < 0:
            raise ConfigError(f"--index is {self.index}; it must be 0 or above.")
        if page:
            from evergym.agents.play.server import check_address

            check_address(self.host, self.port)

    def _load(self) -> tuple[Episode, tuple[Path, ...]]:
        """Return the episode and all that lie beside it."""
        from evergym.agents.play.episode_file import find_episodes, read_episode

        if not self.source.is_dir():
            return read_episode(self.source), ()
        files = find_episodes(self.source)
        if files:
            return read_episode(files[0]), files
        if (self.source / "checkpoints").is_dir():
            return self._drive(), ()
        raise RunError(
            f"'{self.source}' holds neither episodes (*.episode.npz) nor a trained policy. Record an episode with "
            "`evergym play`, or name a run folder of `evergym train`."
        )

    def _drive(self) -> Episode:
        """Let the policy of a run drive one episode."""
        from evergym.agents.evaluation import derive_episode_seed
        from evergym.agents.play.session import Session
        from evergym.agents.run_folder import RunFolder
        from evergym.agents.settings import parse_options

        settings = RunFolder.open(self.source).settings
        print(f"The policy of '{self.source}' drives on {self.family} {self.index} ...", flush=True)
        session = Session(settings.env, parse_options(settings.env_options), self.source)
        try:
            seed = derive_episode_seed(1_000_000, self.family, self.index) if self.seed is None else self.seed
            session.reset(seed, {"family": self.family, "index": self.index})
            session.hand_over("policy")
            while not session.ended:
                session.step()
            return session.episode()
        finally:
            session.close()

    def _write_film(self, episode: Episode, path: Path) -> None:
        from evergym.agents.play.film import write_film
        from evergym.agents.progress import ProgressReport

        total = 0
        bar: ProgressReport | None = None

        def report(done: int, count: int) -> None:
            nonlocal total, bar
            if bar is None:
                total = count
                bar = ProgressReport("Film", total, unit="frames").__enter__()
            bar.update(done)

        try:
            write_film(episode, path, self.speed, self.size, report)
        finally:
            if bar is not None:
                bar.__exit__(None, None, None)
        print(f"Film: {path}")

    def _serve(self, episode: Episode, files: tuple[Path, ...]) -> int:
        from evergym.agents.play.loop import run_paced
        from evergym.agents.play.play_command import open_browser
        from evergym.agents.play.reel import Reel
        from evergym.agents.play.replay_page import ReplayPage
        from evergym.agents.play.server import describe_address, start_server, stop_server

        reel = Reel(episode)
        server = start_server(self.host, self.port, "MAMMOBOT replay")
        interval = episode.heading.interval_s
        try:
            page = ReplayPage(server, reel, files)
            page.draw()
            address = describe_address(server, self.host)
            print(f"Look at the episode at {address}  (Ctrl-C ends)", flush=True)
            open_browser(address, not self.no_browser)

            def step() -> None:
                reel.answer()
                if server.get_clients():
                    reel.tick(interval)
                    page.draw()

            run_paced(step, interval, threading.Event())
        except KeyboardInterrupt:
            print("\nStopped.", flush=True)
        finally:
            stop_server(server)
        return 0
