"""What a prediction depends on."""

from __future__ import annotations

from dataclasses import dataclass

from evergym.model import Model

__all__ = ["Setting"]


@dataclass(frozen=True)
class Setting:
    """A model together with a user's own effects at given strengths: all that a prediction depends on."""

    model: Model
    user: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = ()
    """(effect, ((parameter, value), ...)) of the user's own effects."""
