"""Candidates: every effect of the catalogue that the model has off, and the user's own, with starts for their fits."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evergym.config import ParameterInfo
from evergym.discrepancy.hook import UserEffect
from evergym.discrepancy.parameters import find_info, get_value
from evergym.discrepancy.space import Axis
from evergym.effects.catalogue import EFFECTS
from evergym.model import Model

__all__ = ["Candidate", "find_candidates", "is_off", "make_candidate"]

Array = NDArray[np.float64]

MAGNITUDES = (1.0, 0.25)
"""Strengths at which an effect is tried first, in units of its typical one: dead bands are silent at small ones."""
TURN_DEG = 45.0
"""Scale of a direction in a fit [deg]."""
SHAPE_TOLERANCE = 2.0
"""Prior of a parameter that shapes an effect (a time, a width), in units of half its typical value."""


@dataclass(frozen=True)
class Candidate:
    """An effect that may be missing.

    Attributes:
        name: As in the catalogue, or the user's.
        axes: Its unknowns; z = 0 is off (or the typical value of a parameter that only shapes it).
        fixed: Parameters set beside them.
        starts: z from which its fit may begin, each (m,).
        partners: Effects that look alike.
        amplitudes: Paths of the parameters that switch it off.
    """

    name: str
    axes: tuple[Axis, ...]
    fixed: Mapping[str, object]
    starts: tuple[tuple[float, ...], ...]
    partners: tuple[str, ...]
    amplitudes: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.axes)


def is_off(model: Model, name: str) -> bool:
    """Return whether a model has an effect of the catalogue switched off."""
    off = EFFECTS[name].info.off
    return all(get_value(model, f"effects.{name}.{key}") == value for key, value in off.items())


def find_candidates(model: Model, user_effects: Mapping[str, UserEffect] | None = None) -> list[Candidate]:
    """Return every effect that the model has off, and the user's own."""
    candidates = [make_candidate(name) for name in EFFECTS if is_off(model, name)]
    for name, effect in (user_effects or {}).items():
        infos = {f"user.{name}.{key}": info for key, info in effect.parameters.items()}
        off = {f"user.{name}.{key}": value for key, value in effect.off.items()}
        typical = {f"user.{name}.{key}": value for key, value in effect.typical.items()}
        candidates.append(_build(name, infos, off, typical, {}, ()))
    return candidates


def make_candidate(name: str) -> Candidate:
    """Return an effect of the catalogue as a candidate."""
    kind = EFFECTS[name]
    info = kind.info
    prefix = f"effects.{name}."
    off = {prefix + key: value for key, value in info.off.items()}
    typical = {prefix + key: value for key, value in info.typical.items()}
    fitted = dict.fromkeys(prefix + key for key in info.strength)
    defaults = {prefix + f.name: f.default for f in dataclasses.fields(kind)}
    # What is neither fitted nor typical keeps the default of the catalogue; switches go to "on".
    fixed = {path: typical.get(path, value) for path, value in defaults.items() if path not in fitted}
    for path, value in off.items():
        if isinstance(value, bool):
            fitted.pop(path, None)
            fixed[path] = not value
    infos = {path: find_info(path) for path in fitted}
    return _build(name, infos, off, {**defaults, **typical}, fixed, tuple(info.partners))


def _build(
    name: str,
    infos: Mapping[str, ParameterInfo],
    off: Mapping[str, object],
    typical: Mapping[str, object],
    fixed: Mapping[str, object],
    partners: tuple[str, ...],
) -> Candidate:
    axes = []
    amplitude = []
    for path, info in infos.items():
        axis = _make_axis(path, info, off.get(path), typical.get(path))
        axes.append(axis)
        amplitude.append(path in off)
    starts = _make_starts(axes, amplitude)
    names = tuple(axis.path for axis, is_amplitude in zip(axes, amplitude, strict=True) if is_amplitude)
    return Candidate(name, tuple(axes), dict(fixed), tuple(starts), partners, names)


def _make_axis(path: str, info: ParameterInfo, off: object, typical: object) -> Axis:
    value = float(typical)  # type: ignore[arg-type]
    low = info.low if info.low is not None else -np.inf
    high = info.high if info.high is not None else np.inf
    if off is not None:
        zero = float(off)  # type: ignore[arg-type]
        scale = value - zero if value != zero else _default_scale(low, high, zero)
        return Axis(path, zero, scale, low, high, tolerance=30.0, step=0.1)
    if path.endswith("_deg") and high - low >= 180.0:
        return Axis(path, value, TURN_DEG, low, high, tolerance=np.inf, step=0.2)
    scale = 0.5 * abs(value) or _default_scale(low, high, value)
    return Axis(path, value, scale, low, high, tolerance=SHAPE_TOLERANCE, step=0.2)


def _default_scale(low: float, high: float, origin: float) -> float:
    reach = max(high - origin, origin - low)
    return 0.1 * reach if np.isfinite(reach) else 1.0


def _make_starts(axes: Sequence[Axis], amplitude: Sequence[bool]) -> list[tuple[float, ...]]:
    """Return starts: all amplitudes together, and each alone; both signs where allowed; directions all around."""
    places = [i for i, is_amplitude in enumerate(amplitude) if is_amplitude]
    if not places:
        return [tuple(0.0 for _ in axes)]
    subsets = [[place] for place in places]
    if len(places) > 1:
        subsets.append(places)
    turns: list[tuple[float, ...]] = [
        (0.0, 2.0, 4.0, 6.0) if axis.path.endswith("_deg") and not is_amplitude and np.isinf(axis.tolerance) else (0.0,)
        for axis, is_amplitude in zip(axes, amplitude, strict=True)
    ]
    starts = []
    for magnitude, subset in itertools.product(MAGNITUDES, subsets[::-1]):  # all at once and strongest first
        signed = all(axes[place].z_limits[0] <= -magnitude for place in subset)
        for sign, turn in itertools.product((1.0, -1.0) if signed else (1.0,), itertools.product(*turns)):
            z = list(turn)
            for place in subset:
                z[place] = sign * magnitude
            inside = (
                axis.z_limits[0] <= x <= axis.z_limits[1] or axis.z_limits[0] <= x - 8.0 <= axis.z_limits[1]
                for axis, x in zip(axes, z, strict=True)
            )
            if all(inside):
                wrapped = [x if x <= axis.z_limits[1] else x - 8.0 for axis, x in zip(axes, z, strict=True)]
                starts.append(tuple(wrapped))
    return starts
