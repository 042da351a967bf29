"""Suggestions for mistyped names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = ["suggest"]


def suggest(name: str, known: Iterable[str]) -> str:
    """Return the end of an error sentence: the nearest known name, or the list of them when none is near.

    Starts with ". " or "; " so that it can follow a statement directly.
    """
    names = sorted(known)
    folded = {item.lower(): item for item in names}
    near = difflib.get_close_matches(name.lower(), folded, n=1, cutoff=0.55)
    if near:
        return f". Did you mean '{folded[near[0]]}'?"
    if not names:
        return "; no name is known there."
    return f"; known: {', '.join(names[:12])}{', ...' if len(names) > 12 else '.'}"
