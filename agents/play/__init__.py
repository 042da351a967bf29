"""The robot under one's hands: a page to drive it on, recorded episodes, and the same page to look at them again."""

from __future__ import annotations

__all__: list[str] = []
