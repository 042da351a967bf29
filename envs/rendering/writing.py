"""Words in a picture: a scale bar, a legend, a caption."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from evergym.units import MM

__all__ = ["INK", "draw_scale_bar", "find_font", "write_caption", "write_legend"]

Picture = NDArray[np.uint8]
Font = ImageFont.FreeTypeFont | ImageFont.ImageFont

INK = "#343a40"
"""Colour of letters."""

_BAR = 10 * MM


def find_font(size: tuple[int, int]) -> Font:
    """Return letters that suit a picture of a width and height in pixels."""
    return ImageFont.load_default(size=max(9, round(0.033 * min(size))))


def draw_scale_bar(image: Picture, pixels: float) -> Picture:
    """Draw a bar of ten millimetres into the lower left corner.

    Args:
        image: The picture.
        pixels: Per metre.
    """
    picture, pen, font, unit = _open(image)
    x, y, length = 2 * unit, picture.height - 2 * unit, pixels * _BAR
    pen.line([x, y, x + length, y], fill=INK, width=max(2, unit // 3))
    pen.text((x + 0.5 * length, y - unit // 2), "10 mm", fill=INK, font=font, anchor="mb")
    return np.array(picture)


def write_caption(image: Picture, text: str) -> Picture:
    """Write a line into the upper left corner."""
    picture, pen, font, unit = _open(image)
    pen.text((unit, unit), text, fill=INK, font=font)
    return np.array(picture)


def write_legend(image: Picture, colours: Mapping[str, str]) -> Picture:
    """Explain colours in the lower right corner."""
    picture, pen, font, unit = _open(image)
    line = round(2.3 * unit)
    width = max(pen.textlength(name, font=font) for name in colours)
    x, y = picture.width - 2 * unit - width, picture.height - unit - line * len(colours)
    for number, (name, colour) in enumerate(colours.items()):
        middle = y + (number + 0.5) * line
        pen.rectangle([x - 2.6 * unit, middle - 0.6 * unit, x - 0.8 * unit, middle + 0.6 * unit], fill=colour)
        pen.text((x, middle), name, fill=INK, font=font, anchor="lm")
    return np.array(picture)


def _open(image: Picture) -> tuple[Image.Image, ImageDraw.ImageDraw, Font, int]:
    """Return the picture, a pen, letters and the unit of lengths in pixels: half a letter's height."""
    picture = Image.fromarray(image)
    size = (picture.width, picture.height)
    return picture, ImageDraw.Draw(picture), find_font(size), max(4, round(0.016 * min(size)))
