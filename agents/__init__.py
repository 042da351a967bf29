"""Scripted controllers, training, evaluation, reports and the command line."""

from __future__ import annotations

if __name__ != "evergym.agents":
    raise ImportError(
        "This folder is the package 'evergym.agents'; write 'import evergym.agents', not 'import agents'."
    )

__all__: list[str] = []
