"""Pictures and films of recorded episodes, without a display: from outside, the view from the tip in a corner."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from evergym.agents.figures import make_sheet
from evergym.agents.play.episode import DRIVERS, Episode, Frame
from evergym.agents.play.readout import END_TEXT
from evergym.envs.rendering.endoscope import EndoscopeView
from evergym.envs.rendering.outside import OutsideView
from evergym.errors import ConfigError, RunError
from evergym.whole_file import whole_file

__all__ = ["Camera", "find_empty_corner", "write_film", "write_picture"]

FILM_RATE = 24
"""Frames a second of a film."""
_INSET = 0.3
_BORDER = 2
_MARGIN = 8
_STRIP = 10
"""Part of the height that caption and scale bar take."""
_INK = 12
"""Difference from the background, of 255, from which a pixel shows something."""


class Camera:
    """Draws frames of one episode.

    Args:
        episode: The episode.
        size: Width and height in pixels, both even.
    """

    def __init__(self, episode: Episode, size: tuple[int, int]) -> None:
        self._episode = episode
        self._outside = OutsideView(episode.scene, episode.target, size=size)
        side = int(_INSET * min(size))
        self._side = side
        self._endoscope = EndoscopeView(episode.scene, episode.target)
        self._corner: tuple[slice, slice] | None = None

    def draw(self, frame: Frame) -> NDArray[np.uint8]:
        """Return a picture with its caption, shape (height, width, 3)."""
        values, heading = frame.values, self._episode.heading
        who = DRIVERS[int(values["driver"])]
        caption = f"{heading.anatomy}   {values['time_s']:.1f} s   {who}   tip error {values['tip_error_mm']:.1f} mm"
        if frame is self._episode.frames[-1] and heading.end_reason:
            caption += f"   {END_TEXT.get(heading.end_reason, heading.end_reason)}"
        picture = self._outside.frame(frame.pose, caption)
        if self._corner is None:
            # The same in all pictures: the robot stays within the place, where there is ink anyway.
            self._corner = find_empty_corner(picture, self._side + 2 * _BORDER)
        small = Image.fromarray(self._endoscope.frame(frame.pose))
        inset = np.asarray(small.resize((self._side, self._side), Image.Resampling.BICUBIC))
        framed = np.full((self._side + 2 * _BORDER, self._side + 2 * _BORDER, 3), 73, dtype=np.uint8)
        framed[_BORDER:-_BORDER, _BORDER:-_BORDER] = inset
        picture[self._corner] = framed
        return picture

    def close(self) -> None:
        """Free the views."""
        self._outside.close()
        self._endoscope.close()


def find_empty_corner(picture: NDArray[np.uint8], side: int) -> tuple[slice, slice]:
    """Return the rows and columns of the square in a corner that hides least; at a draw, the upper right one.

    On the left it keeps clear of the caption above it and of the scale bar below it.

    Args:
        picture: On a white ground, shape (height, width, 3).
        side: Of the square in pixels.
    """
    low, right = (length - _MARGIN - side for length in picture.shape[:2])
    ink = picture.min(axis=2) < 255 - _INK
    strip = max(_MARGIN, picture.shape[0] // _STRIP)
    corners = [
        (slice(top, top + side), slice(left, left + side))
        for top, left in ((_MARGIN, right), (low, right), (low + _MARGIN - strip, _MARGIN), (strip, _MARGIN))
    ]
    return min(corners, key=lambda corner: int(np.count_nonzero(ink[corner])))


def write_picture(episode: Episode, path: Path, at: float | None, size: tuple[int, int]) -> None:
    """Write a picture of one instant, or a sheet of 8 over the episode.

    Args:
        episode: The episode.
        path: PNG, or another that Pillow knows by its ending.
        at: Robot time [s]; None: a sheet.
        size: Of one picture in pixels.

    Raises:
        ConfigError: the instant is not within the episode.
        RunError: the ending is unknown, or the file cannot be written.
    """
    count = len(episode.frames)
    end = (count - 1) * episode.heading.interval_s
    # Half a frame more: what is read off a page is rounded to 0.1 s.
    if at is not None and not 0.0 <= at <= end + max(0.5 * episode.heading.interval_s, 0.05):
        raise ConfigError(f"--at is {at:g} s; the episode goes from 0 to {end:.1f} s.")
    if at is None:
        numbers = sorted({round(value) for value in np.linspace(0, count - 1, 8)})
    else:
        numbers = [min(max(round(at / episode.heading.interval_s), 0), count - 1)]
    camera = Camera(episode, size)
    try:
        pictures = [camera.draw(episode.frames[number]) for number in numbers]
    finally:
        camera.close()
    image = Image.fromarray(make_sheet(pictures) if at is None else pictures[0])
    _write_whole(path, lambda partial: image.save(partial))


def write_film(
    episode: Episode, path: Path, speed: float, size: tuple[int, int], report: Callable[[int, int], None]
) -> None:
    """Write a film.

    Args:
        episode: The episode.
        path: MP4, or another that ffmpeg knows by its ending.
        speed: Robot time per film time.
        size: In pixels.
        report: Is told how many frames are done, of how many.

    Raises:
        RunError: the ending is unknown, or the file cannot be written.
    """
    import imageio.v2 as imageio

    interval = episode.heading.interval_s
    duration = (len(episode.frames) - 1) * interval
    times = np.arange(0.0, duration + 0.5 * speed / FILM_RATE, speed / FILM_RATE)
    numbers = [min(round(time / interval), len(episode.frames) - 1) for time in times]
    numbers += [len(episode.frames) - 1] * FILM_RATE  # the end is seen for a second
    camera = Camera(episode, size)

    def write(partial: Path) -> None:
        writer: Any = imageio.get_writer(partial, fps=FILM_RATE, quality=8, macro_block_size=2)
        with writer as film:
            picture, last = np.zeros(0, dtype=np.uint8), -1
            for done, number in enumerate(numbers, start=1):
                if number != last:
                    picture, last = camera.draw(episode.frames[number]), number
                film.append_data(picture)
                report(done, len(numbers))

    try:
        _write_whole(path, write)
    finally:
        camera.close()


def _write_whole(path: Path, write: Callable[[Path], None]) -> None:
    """Let ``write`` write a file, whole or not at all."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path, keep_ending=True) as draft:
            write(draft)
    except (OSError, ValueError, KeyError) as error:
        raise RunError(f"'{path}' cannot be written: {error}.") from None
