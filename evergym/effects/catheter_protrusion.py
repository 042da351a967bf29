"""Catheter protrusion: the catheter may slide out of the sheath's tip, and leads from there."""

from __future__ import annotations

from dataclasses import dataclass

from evergym.config import parameter

__all__ = ["CatheterProtrusion"]


@dataclass(frozen=True)
class CatheterProtrusion:
    """A switch: the catheter may be longer than the everted sheath (on) or stops at its tip (off).

    With it the tip is the further of the sheath's and the catheter's, as in the duty cycle of the real robot.
    """

    enabled: bool = parameter(True, source="the paper: after much growth the catheter protrudes beyond the sheath")
