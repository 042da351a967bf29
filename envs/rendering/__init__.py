"""Pictures of a robot in its place: from outside, from its tip, and as a flat map.

A view is made once for a place and then asked for frames; all of them take a ``Simulator`` or a ``Pose`` and return a
fresh array of uint8, shape (height, width, 3).
"""

from __future__ import annotations

__all__: list[str] = []
