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

__all__ = [
    "ROUNDING_ERROR",
    "ROUNDING_FINE",
    "Candidate",
    "find_candidates",
    "is_off",
    "make_candidate",
    "with_frequencies",
]

Array = NDArray[np.float64]

MAGNITUDES = (4.0, 1.0, 0.25)
"""Strengths at which an effect is tried first, in units of its typical one: dead bands are silent at small ones, and
what the drive limits anyway feels a resistance only at large ones."""
TURN_DEG = 45.0
"""Scale of a direction in a fit [deg]."""
SCALE_HZ = 0.1
"""Scale of a frequency in a fit [Hz]."""
ROUNDING_EFFECT = "angle_quantisation"
FREQUENCY_END = "_hz"
"""How the path of a parameter ends that is a frequency."""
ROUNDING = tuple(0.2 * 1.0125**k for k in range(204))
"""Steps of a rounded reading that are tried, in units of the typical one: only the true one has the true levels, and
the tenth level of a step that is one part in a hundred off is a tenth of a step off."""
ROUNDING_FINE = tuple(1.0 + 0.001 * k for k in range(-10, 11))
"""Multiples of the best of them that are tried next."""
ROUNDING_ERROR = 0.005
"""Least standard deviation of a step found so, as a share of it: in development cases they were half a percent off,
since the nominal parameters decide which level a reading falls on, and no gradient says how."""
SHAPES = (0.0, -1.2, 2.0)
"""Starts of a parameter that shapes an effect: typical, 0.4 and 2 times as much."""
TYPICAL_SCALES = {
    "effects.tendon_backlash.lost_motion_mm": 1.0,
    "effects.tail_coulomb_friction.pressure_gradient_per_mm": 0.01,
    "effects.tail_coulomb_friction.yield_growth_per_mm": 0.02,
    "effects.wall_pretension.moment_n_m": 2e-4,
    "effects.wall_pretension.step_moment_n_m": 2e-4,
}
"""Visible values of amplitudes for which the catalogue gives no typical one."""
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
        signed: Whether all amplitudes may be negative.
        strong: Number of starts, the first ones, at full strength.
        rounds: Whether it rounds what is read: strengths are then tried on a fine grid, since no gradient leads there.
    """

    name: str
    axes: tuple[Axis, ...]
    fixed: Mapping[str, object]
    starts: tuple[tuple[float, ...], ...]
    partners: tuple[str, ...]
    amplitudes: tuple[str, ...]
    signed: bool
    strong: int
    rounds: bool = False

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.axes)


def is_off(model: Model, name: str) -> bool:
    """Return whether a model has an effect of the catalogue switched off."""
    off = EFFECTS[name].info.off
    return all(get_value(model, f"effects.{name}.{key}") == value for key, value in off.items())


def find_candidates(
    model: Model, user_effects: Mapping[str, UserEffect] | None = None, faint: Sequence[str] = ()
) -> list[Candidate]:
    """Return every effect that the model has off, and the user's own.

    Args:
        model: The model.
        user_effects: The user's own, by name.
        faint: Effects that are on so weakly that they are candidates, too, from the strength that they have.
    """
    candidates = [make_candidate(name, model) for name in EFFECTS if is_off(model, name) or name in faint]
    for name, effect in (user_effects or {}).items():
        infos = {f"user.{name}.{key}": info for key, info in effect.parameters.items()}
        off = {f"user.{name}.{key}": value for key, value in effect.off.items()}
        typical = {f"user.{name}.{key}": value for key, value in effect.typical.items()}
        candidates.append(_build(name, infos, off, typical, {}, ()))
    return candidates


def make_candidate(name: str, model: Model | None = None) -> Candidate:
    """Return an effect of the catalogue as a candidate.

    Its unknowns are those of the catalogue, further amplitudes (an effect may act in several ways) and its direction;
    the rest keeps what is typical.

    Args:
        name: Of the effect.
        model: The model that lacks it, whose strengths are those at z = 0; None: off.
    """
    kind = EFFECTS[name]
    info = kind.info
    prefix = f"effects.{name}."
    off = {prefix + key: value for key, value in info.off.items()}
    if model is not None:
        off = {path: value if isinstance(value, bool) else get_value(model, path) for path, value in off.items()}
    defaults = {prefix + field.name: field.default for field in dataclasses.fields(kind)}
    typical = {**defaults, **off, **{prefix + key: value for key, value in info.typical.items()}}
    further = [path for path, value in off.items() if not isinstance(value, bool)]
    further += [path for path in defaults if path.endswith("direction_deg")]
    fitted = dict.fromkeys([prefix + key for key in info.strength] + further)
    switches = {path: not value for path, value in off.items() if isinstance(value, bool)}
    fitted = {path: None for path in fitted if path not in switches}
    fixed = {path: value for path, value in typical.items() if path not in fitted} | switches
    candidate = _build(name, {path: find_info(path) for path in fitted}, off, typical, fixed, tuple(info.partners))
    if name != ROUNDING_EFFECT:
        return candidate
    starts = tuple((z,) for z in reversed(ROUNDING))
    return dataclasses.replace(candidate, starts=starts, strong=len(starts), rounds=True)


def with_frequencies(candidate: Candidate, frequencies: Sequence[float]) -> Candidate:
    """Return the candidate with starts at these frequencies [Hz] besides its own; itself if it has no frequency."""
    place = next((i for i, axis in enumerate(candidate.axes) if axis.path.endswith(FREQUENCY_END)), None)
    if place is None:
        return candidate
    axis = candidate.axes[place]
    moved = []
    for frequency in frequencies:
        z = list(candidate.starts[0])
        z[place] = (frequency - axis.origin) / axis.scale
        moved.append(tuple(z))
    starts = (*candidate.starts, *moved)
    return dataclasses.replace(candidate, starts=starts, strong=len(starts))


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
    together = [path in off and typical[path] != off[path] for path in infos]
    starts = _make_starts(axes, amplitude, together)
    names = tuple(axis.path for axis, is_amplitude in zip(axes, amplitude, strict=True) if is_amplitude)
    signed = bool(names) and all(axis.z_limits[0] <= -1.0 for axis in axes if axis.path in names)
    strong = sum(1 for start in starts if max(_amplitudes(start, amplitude), default=1.0) >= 1.0)
    return Candidate(name, tuple(axes), dict(fixed), tuple(starts), partners, names, signed, strong)


def _amplitudes(start: Sequence[float], amplitude: Sequence[bool]) -> list[float]:
    return [x for x, is_amplitude in zip(start, amplitude, strict=True) if is_amplitude]


def _make_axis(path: str, info: ParameterInfo, off: object, typical: object) -> Axis:
    value = float(typical)  # type: ignore[arg-type]
    low = info.low if info.low is not None else -np.inf
    high = info.high if info.high is not None else np.inf
    if off is not None:
        zero = float(off)  # type: ignore[arg-type]
        scale = value - zero if value != zero else TYPICAL_SCALES.get(path, _default_scale(low, high, zero))
        return Axis(path, zero, scale, low, high, tolerance=30.0, step=0.1)
    if path.endswith(FREQUENCY_END):
        return Axis(path, value, SCALE_HZ, low, high, tolerance=np.inf, step=0.05)
    if path.endswith("direction_deg"):
        return Axis(path, value, TURN_DEG, low - 360.0, high + 360.0, tolerance=np.inf, step=0.2, turns=True)
    scale = 0.5 * abs(value) or _default_scale(low, high, value)
    return Axis(path, value, scale, low, high, tolerance=SHAPE_TOLERANCE, step=0.2)


def _default_scale(low: float, high: float, origin: float) -> float:
    reach = max(high - origin, origin - low)
    return 0.1 * reach if np.isfinite(reach) else 1.0


def _make_starts(axes: Sequence[Axis], amplitude: Sequence[bool], together: Sequence[bool]) -> list[tuple[float, ...]]:
    """Return starts, the strongest first: amplitudes alone and together, and a few values of what shapes the effect.

    Args:
        axes: The unknowns.
        amplitude: Which of them switch the effect off.
        together: Amplitudes that are typical together: a yield has a static and a kinetic part.
    """
    places = [i for i, is_amplitude in enumerate(amplitude) if is_amplitude]
    signed = any(axes[place].z_limits[0] <= -1.0 for place in places)
    shapes = [
        (0.0,) if is_amplitude else _shape_starts(axis, signed)
        for axis, is_amplitude in zip(axes, amplitude, strict=True)
    ]
    # What has a sign has no dead band: the typical strength shows it, and at four times that, robots snap over.
    once = signed or any(axis.path.endswith(FREQUENCY_END) for axis in axes)
    subsets = [[place] for place in places] or [[]]
    if sum(together) > 1:
        subsets.insert(0, [i for i, is_typical in enumerate(together) if is_typical])
    starts: list[tuple[float, ...]] = []
    for magnitude, subset, shape in itertools.product(
        (1.0,) if once else MAGNITUDES, subsets, itertools.product(*shapes)
    ):
        z = list(shape)
        for place in subset:
            z[place] = magnitude
        inside = all(axis.z_limits[0] <= x <= axis.z_limits[1] for axis, x in zip(axes, z, strict=True))
        if inside and tuple(z) not in starts:
            starts.append(tuple(z))
    return starts


def _shape_starts(axis: Axis, signed: bool) -> tuple[float, ...]:
    if axis.path.endswith(FREQUENCY_END):
        return (0.0,)
    if axis.path.endswith("direction_deg"):
        return (0.0, 2.0) if signed else (0.0, 2.0, 4.0, -2.0)
    return SHAPES
