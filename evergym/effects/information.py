"""What is known about an effect beside its law: where it acts, what it moves, and what it can be mistaken for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["EffectInfo"]


@dataclass(frozen=True)
class EffectInfo:
    """One row of the catalogue of effects.

    Attributes:
        row: Number in the catalogue.
        acts_on: "state" (a term of the step), "lattice" (the springs themselves) or "sensor" (what is read off).
        moves: Measured channels that it moves.
        depends_on: What its size depends on, of "pressure", "rate", "orientation", "history" and "length".
        partners: Effects that it can be mistaken for.
        off: The parameters' values that switch it off.
        strength: Parameters that are fitted where the effect is a candidate for what a model lacks.
        typical: Values at which it is clearly visible on the 2023 robot.
    """

    row: int
    acts_on: str
    moves: tuple[str, ...]
    depends_on: tuple[str, ...]
    partners: tuple[str, ...]
    off: Mapping[str, float | bool]
    strength: tuple[str, ...]
    typical: Mapping[str, float | bool]
