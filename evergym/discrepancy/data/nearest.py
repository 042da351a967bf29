"""The end of a message about an unknown name: the nearest known one."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = ["suggest_nearest"]


def suggest_nearest(name: str, known: Iterable[str]) -> str:
    """Return " Did you mean 'x'?", or " Known: x, y, z." where none is near; starts with a space."""
    names = list(known)
    near = difflib.get_close_matches(name.lower(), names, n=1, cutoff=0.5)
    return f" Did you mean '{near[0]}'?" if near else f" Known: {', '.join(names)}."
