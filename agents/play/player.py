"""What a page's buttons do to a session: wait, go, pause, hand over, reset, save. One thread calls all of it."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any

from evergym.agents.play.episode import DRIVERS, Frame
from evergym.agents.play.episode_file import SUFFIX, write_episode
from evergym.agents.play.hand import DriveName
from evergym.agents.play.requests import Desk
from evergym.agents.play.session import Session
from evergym.errors import RunError

__all__ = ["SPEEDS", "Mode", "Player"]

SPEEDS = (1, 2, 4, 8)
"""How many times faster than the robot's own time it can go."""


class Mode(Enum):
    """Whether the robot's time goes on."""

    READY = "ready"
    """It waits for the first command, so that nobody's time runs out while they read the page."""
    RUNNING = "running"
    PAUSED = "paused"
    ENDED = "ended"


class Player(Desk):
    """A session with the state of its page; requests of other threads come in by ``post``.

    Args:
        session: The session; it is reset here.
        folder: Where episodes are saved.
        seed: Of the first episode.
        options: Of the first reset.
    """

    def __init__(
        self, session: Session, folder: Path, *, seed: int = 0, options: Mapping[str, Any] | None = None
    ) -> None:
        super().__init__()
        self.session = session
        self.folder = folder
        self.mode = Mode.READY
        self.speed = 1
        self.save_all = False
        """Whether every episode is saved when it ends."""
        self.place_number = 0
        """Counts the resets, so that a page knows when to build another place."""
        session.reset(seed, options or {})

    @property
    def frame(self) -> Frame:
        """The latest frame."""
        return self.session.frames[-1]

    @property
    def driver(self) -> str:
        """Who drives, of ``DRIVERS``."""
        return DRIVERS[self.session.driver]

    def tick(self) -> None:
        """Advance by one frame at the chosen speed, if time goes on."""
        for _ in range(self.speed):
            if self.mode is not Mode.RUNNING:
                return
            try:
                self.session.step()
            except ValueError as error:  # an action that is no number, of a policy that has diverged
                self.notices.append((f"The {self.driver} cannot drive: {error}", True))
                self.session.hand_over(DRIVERS[0])
                self.mode = Mode.PAUSED
                return
            if self.session.ended:
                self.mode = Mode.ENDED
                if self.save_all:
                    self.save()

    # What people ask for

    def set_drive(self, drive: DriveName, value: float) -> None:
        """Set a drive [SI], by hand; whoever else drives is relieved."""
        self._take()
        self.session.hand.set(drive, value)

    def press(self, drive: DriveName, direction: int, at: float | None = None) -> None:
        """Take one press or repeat of a drive's key, by hand; ``at``: when, by ``time.monotonic`` (None: now)."""
        self._take()
        self.session.hand.press(drive, direction, at)

    def stop(self) -> None:
        """Stop what moves, by hand."""
        if self.mode is Mode.RUNNING:
            self._take()
        self.session.hand.stop()

    def hand_over(self, driver: str) -> None:
        """Let one of ``DRIVERS`` drive, and start if it has not begun."""
        if self.mode is Mode.ENDED:
            raise RunError("The episode is over. Start again first (R).")
        self.session.hand_over(driver)
        if driver != DRIVERS[0] or self.mode is Mode.PAUSED:
            self.mode = Mode.RUNNING

    def pause(self) -> None:
        """Stop the robot's time, or let it go on."""
        if self.mode is Mode.RUNNING:
            self.mode = Mode.PAUSED
        elif self.mode is Mode.PAUSED:
            self.mode = Mode.RUNNING

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Start again: the same place and seed, or others."""
        self.session.reset(seed, options)
        self.mode = Mode.READY
        self.place_number += 1

    def load_policy(self, folder: str) -> None:
        """Take the policy of a run folder, from now on."""
        if not folder.strip():
            raise RunError("Give the run folder of a trained policy, such as runs/mine.")
        self.session.load_policy(Path(folder.strip()).expanduser())
        self.notices.append((f"Policy of {folder.strip()} is loaded.", False))

    def save(self) -> Path:
        """Save the episode so far; ``evergym replay`` opens it."""
        episode = self.session.episode()
        if len(episode.frames) < 2:
            raise RunError("Nothing has happened yet, so there is nothing to save.")
        name = re.sub(r"[^A-Za-z0-9_.-]+", "-", episode.heading.anatomy).strip("-.") or "place"
        stamp = time.strftime("%Y%m%d-%H%M%S")
        path, number = self.folder / f"{stamp}-{name}{SUFFIX}", 1
        while path.exists():
            number += 1
            path = self.folder / f"{stamp}-{name}-{number}{SUFFIX}"
        write_episode(episode, path)
        self.notices.append((f"Saved. See it again: evergym replay {path}", False))
        return path

    def _take(self) -> None:
        """Take over by hand, and start if it has not begun; a pause stays one."""
        if self.mode is Mode.ENDED:
            return
        self.session.hand_over(DRIVERS[0])
        if self.mode is Mode.READY:
            self.mode = Mode.RUNNING
