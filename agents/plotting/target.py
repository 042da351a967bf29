"""Where a figure may be written to; checked before the work for it begins."""

from __future__ import annotations

from pathlib import Path

from evergym.errors import ConfigError, RunError

__all__ = ["FORMATS", "check_target"]

FORMATS = ("png", "pdf", "svg")
"""Endings of a figure's file."""


def check_target(path: Path) -> None:
    """Raise ``ConfigError`` for an ending that is no format, ``RunError`` for a file that is there already."""
    if path.suffix[1:].lower() not in FORMATS:
        raise ConfigError(f"'{path}' has no ending that names a format: use {', '.join('.' + f for f in FORMATS)}.")
    if path.exists():
        raise RunError(f"'{path}' exists already and is not overwritten. Choose another file with --out.")
