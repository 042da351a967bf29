"""A recorded episode that is played, stopped and searched; no page, no clock."""

from __future__ import annotations

import math
from pathlib import Path

from evergym.agents.play.episode import DRIVERS, Episode, Frame
from evergym.agents.play.episode_file import read_episode
from evergym.agents.play.requests import Desk
from evergym.errors import RunError

__all__ = ["Reel"]


class Reel(Desk):
    """An episode and the place in it; requests of other threads come in by ``post``.

    Args:
        episode: The episode.

    Raises:
        RunError: the episode is empty.
    """

    def __init__(self, episode: Episode) -> None:
        super().__init__()
        self.speed = 1.0
        self.place_number = -1
        """Counts the episodes, so that a page knows when to build another place."""
        self.load(episode)

    def load(self, episode: Episode) -> None:
        """Show another episode from its start."""
        if not episode.frames:
            raise RunError("The episode has no frames.")
        self.episode = episode
        self.playing = True
        self._time = 0.0
        self.place_number += 1

    def open(self, path: Path) -> None:
        """Show the episode in a file."""
        self.load(read_episode(path))

    @property
    def duration(self) -> float:
        """Robot time of the last frame [s]."""
        return (len(self.episode.frames) - 1) * self.episode.heading.interval_s

    @property
    def number(self) -> int:
        """Index of the frame that is shown."""
        return min(math.floor(self._time / self.episode.heading.interval_s + 1e-6), len(self.episode.frames) - 1)

    @property
    def frame(self) -> Frame:
        """The frame that is shown."""
        return self.episode.frames[self.number]

    @property
    def at_end(self) -> bool:
        """Whether the last frame is shown."""
        return self.number == len(self.episode.frames) - 1

    @property
    def driver(self) -> str:
        """Who drives in the frame that is shown."""
        return DRIVERS[int(self.frame.values["driver"])]

    def tick(self, duration: float) -> None:
        """Let time pass [s]; at the end it stops."""
        if self.playing:
            self._time = min(self._time + self.speed * duration, self.duration)
            self.playing = not self.at_end

    def seek(self, time: float) -> None:
        """Stop at a time [s of robot time]."""
        self._time = min(max(time, 0.0), self.duration)
        self.playing = False

    def step(self, frames: int) -> None:
        """Stop some frames later, or earlier."""
        self.seek((self.number + frames) * self.episode.heading.interval_s)

    def play(self) -> None:
        """Go on, or stop; from the end, start again."""
        if not self.playing and self.at_end:
            self._time = 0.0
            self.playing = True
        else:
            self.playing = not self.playing
