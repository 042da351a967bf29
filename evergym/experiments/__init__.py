"""The paper's experiments: what was measured, the bench protocols that repeat it, and the comparison."""

from __future__ import annotations

__all__: list[str] = []
