"""Seeded random peg fields, with proof that the robot's bend reaches the target and that pushing straight does not."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evergym.duct_models.pegs import CLEARANCE, PAPER_PEG_RADIUS, ROBOT_DIAMETER, PegField, make_pegs
from evergym.errors import GeometryError
from evergym.units import MM

__all__ = ["PEG_FAMILIES", "PegFamily", "find_straight_approach", "generate_pegs", "random_pegs", "trace_arc"]

Array = NDArray[np.float64]

_ENTROPY = 20230105
"""Root of all peg seeds; the date of the paper, so that nobody tunes it."""
_ATTEMPTS = 500
PRE_CURVATURE = 2.2
"""Curvature of the unsteered robot [1/m], in the plane of its tendon. Source: Wu 2023."""


@dataclass(frozen=True)
class PegFamily:
    """Distribution of peg fields; every (name, index) gives one field, the same in every process.

    A field is built around a *reference arc* of constant curvature that starts at the port along +z and ends at the
    target. It proves that the target can be reached; the way is still the shortest one, close to the arc. Ranges are
    uniform. All numbers are priors,
    chosen for the 2023 robot: its least bend radius is about 90 mm (61 degrees over 95 mm), it grows some 60 to 70 mm.
    """

    name: str
    """Name of the family."""
    key: int
    """First part of the seed; unique to the family, so that the seeds of two families cannot overlap."""
    peg_count: tuple[int, int] = (4, 6)
    """Fewest and most pegs."""
    curvature: tuple[float, float] = (5.5, 10.0)
    """Curvature of the reference arc [1/m]; the robot's limit is about 11."""
    arc_length: tuple[float, float] = (39.0 * MM, 53.5 * MM)
    """Length of the reference arc [m]."""
    target_distance: tuple[float, float] = (38.0 * MM, 52.0 * MM)
    """Distance of the target from the port [m]."""
    target_offset: tuple[float, float] = (6.5 * MM, 14.0 * MM)
    """Distance of the target from the axis of the port [m]."""
    peg_radius: float = PAPER_PEG_RADIUS
    """Radius of every peg [m]."""
    peg_spacing: float = 9.0 * MM
    """Least distance between the axes of two pegs [m]."""
    arc_clearance: float = 0.4 * MM
    """Least room between robot and peg along the reference arc [m]."""
    approach_min: float = 5.5 * MM
    """Least distance that an unsteered robot keeps from the target until it meets a peg [m]; success is at 5 mm."""
    guide_offset: float = 0.7 * MM
    """A peg in the way of an unsteered robot stands at least so far [m] on the target's side of that way, so that it
    deflects the robot away from the target instead of guiding it there."""
    way_deviation: float = 3.5 * MM
    """Largest distance of the shortest way from the reference arc [m]: both pass every peg that matters on the same
    side."""
    way_length_max: float = 55.0 * MM
    """Longest way [m]."""


PEG_FAMILIES = {
    family.name: family
    for family in (
        PegFamily("train", key=1),
        PegFamily("held_out", key=2),
        PegFamily("dense", key=3, peg_count=(8, 11), peg_spacing=8.6 * MM, arc_clearance=0.3 * MM),
    )
}
"""Families by name. ``train`` and ``held_out`` differ in seeds only; ``dense`` has twice the pegs, closer together."""


def generate_pegs(family_name: str, index: int) -> PegField:
    """Make field number ``index`` of a family.

    Args:
        family_name: A key of ``PEG_FAMILIES``.
        index: Which one, 0 or more.

    Raises:
        GeometryError: If there is no such family or the index is negative.
    """
    if family_name not in PEG_FAMILIES:
        raise GeometryError(f"There is no peg family '{family_name}'. Choose one of: {', '.join(PEG_FAMILIES)}.")
    return _generate(PEG_FAMILIES[family_name], index)


def random_pegs(seed: int, family: PegFamily | None = None) -> PegField:
    """Make a random field from a seed of its own space, disjoint from that of every family.

    Args:
        seed: 0 or more.
        family: Distribution to draw from; that of ``train`` by default.
    """
    return _generate(replace(family or PEG_FAMILIES["train"], name="random", key=0), seed)


def trace_arc(curvature: float, length: float, spacing: float = 0.25 * MM) -> Array:
    """Compute points of an arc that leaves the port along +z and bends towards +x (-x if curvature is negative).

    Args:
        curvature: Curvature [1/m], signed.
        length: Length of the arc [m].
        spacing: Largest distance between points along the arc [m].

    Returns:
        Points (x, z) [m], shape (n, 2).
    """
    s = np.linspace(0.0, length, max(2, math.ceil(length / spacing) + 1))
    # sinc forms stay exact through zero curvature
    half = 0.5 * curvature * s
    chord = s * np.sinc(half / math.pi)
    return np.stack([chord * np.sin(half), chord * np.cos(half)], axis=1)


def find_straight_approach(field: PegField, curvature_max: float = PRE_CURVATURE, length: float = 70.0 * MM) -> float:
    """Compute how near an unsteered robot comes to the target before it meets a peg.

    Args:
        field: The field.
        curvature_max: Bend that the robot has unsteered [1/m], to either side (it depends on the roll).
        length: How far it is pushed [m].

    Returns:
        Least distance of its tip to the target [m].
    """
    nearest = math.inf
    for curvature in np.linspace(-curvature_max, curvature_max, 5):
        path = trace_arc(float(curvature), length)
        gap = _measure_gap(path, field.pegs[:, [0, 2]]) - field.pegs[:, 6] - 0.5 * field.robot_diameter
        met = np.flatnonzero((gap < 0.0).any(axis=1))
        path = path[: met[0] + 1] if len(met) else path
        nearest = min(nearest, float(np.hypot(*(path - field.target[[0, 2]]).T).min()))
    return nearest


def _measure_gap(path: Array, plan: Array) -> Array:
    return np.asarray(np.hypot(path[:, None, 0] - plan[None, :, 0], path[:, None, 1] - plan[None, :, 1]))


def _generate(family: PegFamily, index: int) -> PegField:
    if index < 0:
        raise GeometryError(f"Index {index} of peg family '{family.name}' must not be negative.")
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(_ENTROPY, spawn_key=(family.key, index))))
    for _ in range(_ATTEMPTS):
        field = _try(family, index, rng)
        if field is not None:
            return field
    raise GeometryError(
        f"No field of peg family '{family.name}' met its conditions in {_ATTEMPTS} attempts (index {index}). "
        "Ask for fewer pegs or less spacing."
    )


def _try(family: PegFamily, index: int, rng: np.random.Generator) -> PegField | None:
    side = 1.0 if rng.random() < 0.5 else -1.0
    curvature = side * rng.uniform(*family.curvature)
    length = rng.uniform(*family.arc_length)
    arc = trace_arc(curvature, length)
    end = arc[-1]
    if not family.target_distance[0] <= math.hypot(*end) <= family.target_distance[1]:
        return None
    if not family.target_offset[0] <= abs(end[0]) <= family.target_offset[1]:
        return None
    plan = _place_pegs(family, arc, side, rng)
    if plan is None:
        return None
    gap = float(_measure_gap(arc, plan).min()) - family.peg_radius - 0.5 * ROBOT_DIAMETER
    target = np.array([end[0], 0.0, end[1]])
    metadata = {
        "family": family.name,
        "index": index,
        "arc_curvature_1_per_m": round(curvature, 3),
        "arc_length_mm": round(length / MM, 3),
        "arc_clearance_mm": round(gap / MM, 3),
    }
    # the way never asks for more room than the arc has, else it could be sent around a peg that the arc passes
    clearance = min(CLEARANCE, family.arc_clearance)
    field = PegField(
        make_pegs(plan, family.peg_radius),
        target,
        name=f"{family.name}-{index}",
        clearance=clearance,
        metadata=metadata,
    )
    deviation = _measure_gap(field.way[:, [0, 2]], arc).min(axis=1).max()
    if field.way_length > family.way_length_max or deviation > family.way_deviation:
        return None
    return field if find_straight_approach(field) >= family.approach_min else None


def _compute_sag(z: float) -> float:
    """Compute how far an unsteered robot may be off the axis at a height z."""
    return 0.5 * PRE_CURVATURE * z**2


def _place_pegs(family: PegFamily, arc: Array, side: float, rng: np.random.Generator) -> Array | None:
    """Place pegs beside the arc, in the straight way and at random; None where they do not fit."""
    room = family.peg_radius + 0.5 * ROBOT_DIAMETER + family.arc_clearance
    tangent = np.gradient(arc, axis=0)
    tangent /= np.hypot(*tangent.T)[:, None]
    inward = side * np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    count = int(rng.integers(family.peg_count[0], family.peg_count[1] + 1))
    plan: list[Array] = []
    for k in range(60 * count):
        if len(plan) == count:
            break
        if len(plan) == 0:
            # inside the bend: stands in the straight line from the port to the target or near it
            at = int(rng.uniform(0.4, 0.8) * (len(arc) - 1))
            peg = arc[at] + inward[at] * (room + rng.uniform(0.0, 1.5 * MM))
        elif len(plan) == 1 and k < 30 * count:
            # ahead of a robot that is pushed straight
            z = rng.uniform(26.0 * MM, 48.0 * MM)
            peg = np.array([side * (_compute_sag(z) + rng.uniform(family.guide_offset, 3.0 * MM)), z])
        else:
            peg = np.array([rng.uniform(-18.0, 18.0), rng.uniform(14.0, 60.0)]) * MM
        if peg[1] < 14.0 * MM and abs(peg[0]) < room + 1.0 * MM:
            continue
        sag = _compute_sag(peg[1])
        if -sag - room - 1.0 * MM < side * peg[0] < sag + family.guide_offset and peg[1] < arc[-1, 1] + room:
            continue
        if plan and np.hypot(*(np.array(plan) - peg).T).min() < family.peg_spacing:
            continue
        if np.hypot(*(arc - peg).T).min() >= room - 1e-9:
            plan.append(peg)
    return np.array(plan) if len(plan) == count else None
