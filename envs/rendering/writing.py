"""Words in a picture: a scale bar, a legend, a caption."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from evergym.units import MM

__all__ = ["INK", "draw_scale_bar", "find_font", "find_legend_height", "write_caption", "write_legend"]

Picture = NDArray[np.uint8]
Font = ImageFont.FreeTypeFont | ImageFont.ImageFont

INK = "#343a40"
"""Colour of letters."""

_BAR = 10 * MM


def find_font(size: tuple[int, int]) -> Font:
    """Return letters that suit a picture of a width and height in pixels."""
    return ImageFont.load_default(size=max(9, round(0.033 * min(size))))


def find_legend_height(size: tuple[int, int]) -> int:
    """Return the height in pixels of the strip that a legend takes from a picture of a width and height."""
    return round(0.09 * min(size))


def draw_scale_bar(image: Picture, pixels: float, above: int = 0) -> Picture:
    """Draw a bar of ten millimetres into the lower left corner.

    Args:
        image: The picture.
        pixels: Per metre.
        above: Pixels to leave free below it.
    """
    picture, pen, font, unit = _open(image)
    x, y, length = 2 * unit, picture.height - 2 * unit - above, pixels * _BAR
    pen.line([x, y, x + length, y], fill=INK, width=max(2, unit // 3))
    middle = x + 0.5 * max(length, pen.textlength("10 mm", font=font))  # a short bar has its letters to the right
    pen.text((middle, y - unit // 2), "10 mm", fill=INK, font=font, anchor="mb")
    return np.array(picture)


def write_caption(image: Picture, text: str) -> Picture:
    """Write a line into the upper left corner."""
    picture, pen, font, unit = _open(image)
    pen.text((unit, unit), text, fill=INK, font=font)
    return np.array(picture)


def write_legend(image: Picture, colours: Mapping[str, str]) -> Picture:
    """Explain colours in a line at the bottom."""
    picture, pen, font, unit = _open(image)
    middle = picture.height - 0.5 * find_legend_height((picture.width, picture.height))
    widths = {name: 3.2 * unit + pen.textlength(name, font=font) for name in colours}
    gap = (picture.width - 4 * unit - sum(widths.values())) / max(len(colours) - 1, 1)
    gap = max(min(gap, 3.0 * unit), unit)
    x = 2.0 * unit
    for name, colour in colours.items():
        pen.rectangle([x, middle - unit, x + 2 * unit, middle + unit], fill=colour)
        pen.text((x + 3.0 * unit, middle), name, fill=INK, font=font, anchor="lm")
        x += widths[name] + gap
    return np.array(picture)


def _open(image: Picture) -> tuple[Image.Image, ImageDraw.ImageDraw, Font, int]:
    """Return the picture, a pen, letters and the unit of lengths in pixels: half a letter's height."""
    picture = Image.fromarray(image)
    size = (picture.width, picture.height)
    return picture, ImageDraw.Draw(picture), find_font(size), max(4, round(0.016 * min(size)))
