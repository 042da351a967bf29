"""The unknowns of a fit: nominal parameters with their tolerances, and the strengths of effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.parameters import set_values
from evergym.discrepancy.setting import Setting

__all__ = ["PULL_LIMIT", "Axis", "Space"]

Array = NDArray[np.float64]

PULL_LIMIT = "rig.pull_limit_mm"
"""Path of an unknown that is in no model file: `Setting.pull_limit_mm`."""


@dataclass(frozen=True)
class Axis:
    """One unknown, counted in units of its scale.

    Attributes:
        path: Path in the model file, or "user.<effect>.<parameter>".
        origin: Value at z = 0: the nominal value, or off.
        scale: Value of one unit of z: the tolerance, or the typical strength.
        low: Least value.
        high: Largest value.
        tolerance: One standard deviation of the prior in units of z; infinite: unknown.
        step: Finite-difference step in units of z.
        nominal: A parameter that the model sets, not the strength of a candidate.
        turns: A direction [deg]: it may go round, and is written between -180 and 180.
    """

    path: str
    origin: float
    scale: float
    low: float
    high: float
    tolerance: float = 1.0
    step: float = 0.3
    nominal: bool = False
    turns: bool = False

    def value(self, z: float) -> float:
        """Return the value at z, within the limits."""
        value = self.origin + z * self.scale
        if self.turns:
            return (value + 180.0) % 360.0 - 180.0
        return min(max(value, self.low), self.high)

    @property
    def z_limits(self) -> tuple[float, float]:
        """Least and largest z."""
        ends = ((self.low - self.origin) / self.scale, (self.high - self.origin) / self.scale)
        return min(ends), max(ends)


@dataclass(frozen=True)
class Space:
    """Unknowns of a fit, and what is fixed beside them.

    Attributes:
        base: What the axes change.
        axes: The unknowns.
        fixed: Parameters that are set beside them, such as the shape of an effect.
    """

    base: Setting
    axes: tuple[Axis, ...]
    fixed: Mapping[str, object] = field(default_factory=dict)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.axes)

    @property
    def prior_precision(self) -> Array:
        """Reciprocal variance of z, shape (size,)."""
        return np.array([axis.tolerance**-2 if np.isfinite(axis.tolerance) else 0.0 for axis in self.axes])

    @property
    def limits(self) -> tuple[Array, Array]:
        """Least and largest z, shape (size,)."""
        pairs = np.array([axis.z_limits for axis in self.axes]).reshape(-1, 2)
        return pairs[:, 0], pairs[:, 1]

    def limits_of(self, first: int) -> tuple[Array, Array]:
        """Return the limits of the unknowns from ``first`` on."""
        low, high = self.limits
        return low[first:], high[first:]

    def values(self, z: Sequence[float] | Array) -> dict[str, object]:
        """Return the values by path, in the units of the model file."""
        values = dict(self.fixed)
        values.update({axis.path: axis.value(float(x)) for axis, x in zip(self.axes, z, strict=True)})
        return values

    def setting(self, z: Sequence[float] | Array) -> Setting:
        """Return the setting at z."""
        values = self.values(z)
        limit = float(values.pop(PULL_LIMIT, self.base.pull_limit_mm))  # type: ignore[arg-type]
        in_model = {path: value for path, value in values.items() if not path.startswith("user.")}
        user: dict[str, dict[str, float]] = {name: dict(pairs) for name, pairs in self.base.user}
        for path, value in values.items():
            if path.startswith("user."):
                _, name, parameter = path.split(".", 2)
                user.setdefault(name, {})[parameter] = float(value)  # type: ignore[arg-type]
        frozen = tuple((name, tuple(pairs.items())) for name, pairs in user.items())
        return Setting(set_values(self.base.model, in_model), frozen, limit)

    def extend(self, axes: Sequence[Axis], fixed: Mapping[str, object] | None = None) -> Space:
        """Return the space with more unknowns, after those there are."""
        return replace(self, axes=self.axes + tuple(axes), fixed={**self.fixed, **(fixed or {})})
