"""Figures of a paper's quality, one command each: ``evergym plot workspace|growth|force|learning|compare``."""

from __future__ import annotations

__all__: list[str] = []
