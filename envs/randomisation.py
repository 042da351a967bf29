"""Draw a model from the uncertainty of its parameters."""

from __future__ import annotations

import numpy as np

from evergym.model import Model

__all__ = ["draw_model"]


def draw_model(model: Model, rng: np.random.Generator, scale: float) -> Model:
    """Return a copy of ``model`` with its uncertain parameters drawn anew (placeholder order: field by field)."""
    raise NotImplementedError
