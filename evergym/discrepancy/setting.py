"""What a prediction depends on."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from evergym.effects.angle_quantisation import AngleQuantisation
from evergym.model import Model

__all__ = ["Setting", "without_rounding"]


@dataclass(frozen=True)
class Setting:
    """A model together with a user's own effects at given strengths: all that a prediction depends on."""

    model: Model
    user: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = ()
    """(effect, ((parameter, value), ...)) of the user's own effects."""
    pull_limit_mm: float = math.inf
    """Pull beyond which the tendon's drive does not go, whatever it is told: the commands may not be carried out."""


def without_rounding(setting: Setting) -> Setting:
    """Return the setting with exact angles: rounding them is done to a simulation that does not know of it."""
    model = setting.model
    if model.effects.angle_quantisation == _EXACT:
        return setting
    return replace(setting, model=replace(model, effects=replace(model.effects, angle_quantisation=_EXACT)))


_EXACT = AngleQuantisation()
