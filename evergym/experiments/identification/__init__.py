"""Estimate the robot's parameters from the paper's figures: what is free, how it is fitted, what is left out."""

from __future__ import annotations

__all__: list[str] = []
