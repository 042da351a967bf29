"""Measured runs: their files, what is checked in them, the rig they came from, and how others become such files.

Nothing here simulates: the diagnosis stands on this package, not the other way round.
"""

from __future__ import annotations

__all__: list[str] = []
