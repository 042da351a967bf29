"""What a policy sees: the terms with unit and scale, the space made from them, and the array made from a reading."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from evergym.envs.drive import Drive
from evergym.envs.route import WAY_DISTANCES, Route
from evergym.simulator import Reading
from evergym.units import KPA, MM

__all__ = [
    "DUCT_TERMS",
    "PEG_TERMS",
    "Frame",
    "ObservationTerm",
    "compute_observation",
    "compute_tip_frame",
    "inverse_scales",
    "make_observation_space",
    "observation_table",
    "term_slices",
]

Frame = tuple[float, float, float, float, float, float, float, float, float]
"""The tip frame's axes in the world, row by row: tendon side, binormal, tip direction."""

_UNIT_FACTOR = {"mm": MM, "mm/s": MM, "kPa": KPA, "N": 1.0, "-": 1.0}


@dataclass(frozen=True)
class ObservationTerm:
    """One named part of the observation vector.

    Attributes:
        name: Its name.
        size: Number of components.
        unit: Unit of the scale.
        scale: Value, in ``unit``, that the observation shows as 1; larger ones are clipped.
        meaning: What it is.
        is_map: Whether it comes from the surgeon's map (zero with ``hide_map``).
    """

    name: str
    size: int
    unit: str
    scale: float
    meaning: str
    is_map: bool = False


_WAY = ", ".join(f"{distance / MM:g}" for distance in WAY_DISTANCES)

_ROBOT_TERMS = (
    ObservationTerm("insertion_velocity", 1, "mm/s", 2.9, "commanded insertion velocity of the catheter"),
    ObservationTerm("everted_length", 1, "mm", 100.0, "everted length"),
    ObservationTerm("protrusion", 1, "mm", 20.0, "inserted length of the catheter minus everted length"),
    ObservationTerm("slack", 1, "mm", 20.0, "fed tail not yet everted"),
    ObservationTerm("roll", 2, "-", 1.0, "sine and cosine of the catheter's roll at the base"),
    ObservationTerm("tendon_pull", 1, "mm", 4.9, "tendon pull"),
    ObservationTerm("pressure", 1, "kPa", 50.0, "gauge pressure in the sheath"),
    ObservationTerm("growth_rate", 1, "mm/s", 2.9, "rate of the everted length"),
    ObservationTerm("tendon_tension", 1, "N", 20.0, "tension of the tendon at the base"),
    ObservationTerm("tail_tension", 1, "N", 1.0, "tension of the tail at the base"),
    ObservationTerm("buckled", 1, "-", 1.0, "1 if the sheath has buckled"),
    ObservationTerm("tip_position", 3, "mm", 100.0, "tip position, world frame"),
    ObservationTerm("tip_direction", 3, "-", 1.0, "direction of growth at the tip, world frame"),
    ObservationTerm("tendon_side", 3, "-", 1.0, "side to which pulling bends the tip, world frame"),
)
_CONTACT_TERMS = (
    ObservationTerm("tip_force", 3, "N", 0.5, "contact force on the tip, tip frame"),
    ObservationTerm("wall_force_max", 1, "N", 0.5, "largest wall force on one section"),
    ObservationTerm("wall_force_sum", 1, "N", 2.0, "sum of the wall forces"),
    ObservationTerm("contact_count", 1, "-", 20.0, "number of sections in contact"),
    ObservationTerm("time_left", 1, "-", 1.0, "fraction of the time limit that is left"),
)


def _map_terms(width: str, beside: ObservationTerm, warning: ObservationTerm) -> tuple[ObservationTerm, ...]:
    """Return the map's terms: those of both tasks and the two that differ."""
    count = len(WAY_DISTANCES)
    return (
        ObservationTerm("way_ahead", 3 * count, "mm", 25.0, f"points of the way {_WAY} mm ahead, tip frame", True),
        ObservationTerm("width_ahead", count, "mm", 10.0, f"{width} at these points", True),
        beside,
        ObservationTerm("target", 3, "mm", 100.0, "vector from the tip to the target, tip frame", True),
        ObservationTerm("distance_to_go", 1, "mm", 100.0, "way to go to the target", True),
        warning,
    )


DUCT_TERMS = (
    *_ROBOT_TERMS,
    *_map_terms(
        "lumen radius",
        ObservationTerm("centreline_offset", 3, "mm", 10.0, "vector from the tip to the centreline, tip frame", True),
        ObservationTerm("astray", 1, "-", 1.0, "1 if the tip is in a branch off the way to the target", True),
    ),
    *_CONTACT_TERMS,
)
"""The observation of the duct task, in order."""
PEG_TERMS = (
    *_ROBOT_TERMS,
    *_map_terms(
        "distance to the nearest peg's surface",
        ObservationTerm("nearest_peg", 3, "mm", 25.0, "vector from the tip to the nearest peg's axis, tip frame", True),
        ObservationTerm("peg_clearance", 1, "mm", 10.0, "distance from the tip to the nearest peg's surface", True),
    ),
    *_CONTACT_TERMS,
)
"""The observation of the peg task, in order."""


def make_observation_space(terms: Sequence[ObservationTerm]) -> spaces.Box:
    """Return the flat box -1..1 that holds the terms."""
    return spaces.Box(-1.0, 1.0, (sum(term.size for term in terms),), np.float32)


def term_slices(terms: Sequence[ObservationTerm]) -> dict[str, slice]:
    """Return where each term lies in the observation, by name."""
    slices: dict[str, slice] = {}
    start = 0
    for term in terms:
        slices[term.name] = slice(start, start + term.size)
        start += term.size
    return slices


def observation_table(terms: Sequence[ObservationTerm]) -> str:
    """Return the terms as a Markdown table: index, name, unit, scale, meaning."""
    rows = ["| index | name | scale | unit | meaning |", "|---|---|---|---|---|"]
    for term, place in zip(terms, term_slices(terms).values(), strict=True):
        index = str(place.start) if term.size == 1 else f"{place.start}-{place.stop - 1}"
        rows.append(f"| {index} | `{term.name}` | {term.scale:g} | {term.unit} | {term.meaning} |")
    return "\n".join(rows)


def inverse_scales(terms: Sequence[ObservationTerm], *, hide_map: bool) -> NDArray[np.float64]:
    """Return the factor from SI to observation of every component, shape (size,); 0 hides a component."""
    factors = [
        0.0 if hide_map and term.is_map else 1.0 / (term.scale * _UNIT_FACTOR[term.unit])
        for term in terms
        for _ in range(term.size)
    ]
    return np.array(factors)


def compute_tip_frame(direction: Sequence[float], side: Sequence[float]) -> Frame:
    """Return the tip frame from the tip direction and the tendon side (orthogonalised), both in the world."""
    dx, dy, dz = direction
    norm = math.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / norm, dy / norm, dz / norm
    sx, sy, sz = side
    along = sx * dx + sy * dy + sz * dz
    sx, sy, sz = sx - along * dx, sy - along * dy, sz - along * dz
    norm = math.sqrt(sx * sx + sy * sy + sz * sz)
    if norm < 1e-9:  # side and direction are parallel: any perpendicular will do, but always the same one
        sx, sy, sz = (0.0, dz, -dy) if abs(dx) < 0.9 else (-dz, 0.0, dx)
        norm = math.sqrt(sx * sx + sy * sy + sz * sz)
    sx, sy, sz = sx / norm, sy / norm, sz / norm
    return (sx, sy, sz, dy * sz - dz * sy, dz * sx - dx * sz, dx * sy - dy * sx, dx, dy, dz)


def _append_rotated(values: list[float], frame: Frame, x: float, y: float, z: float) -> None:
    """Append the world vector (x, y, z), turned into the tip frame, to ``values``."""
    ax, ay, az, bx, by, bz, cx, cy, cz = frame
    values += (ax * x + ay * y + az * z, bx * x + by * y + bz * z, cx * x + cy * y + cz * z)


def compute_observation(
    reading: Reading,
    drive: Drive,
    position: Sequence[float],
    frame: Frame,
    route: Route,
    time_left: float,
    factors: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Return the observation, a fresh float32 array within -1..1.

    Args:
        reading: The simulator's reading.
        drive: The drive.
        position: Localised tip position [m], as the policy is to see it.
        frame: Localised tip frame.
        route: The map, already updated with ``position``.
        time_left: Fraction of the time limit that is left.
        factors: See ``inverse_scales``.
    """
    px, py, pz = position
    values = [
        drive.insertion_velocity,
        reading.everted_length,
        reading.catheter_length - reading.everted_length,
        reading.slack,
        math.sin(reading.roll),
        math.cos(reading.roll),
        reading.tendon_pull,
        reading.pressure,
        reading.growth_rate,
        reading.tendon_tension,
        reading.tail_tension,
        1.0 if reading.buckled else 0.0,
        px,
        py,
        pz,
        frame[6],
        frame[7],
        frame[8],
        frame[0],
        frame[1],
        frame[2],
    ]
    for x, y, z in route.way_ahead:
        _append_rotated(values, frame, x - px, y - py, z - pz)
    values += route.width_ahead
    x, y, z = route.beside
    _append_rotated(values, frame, x - px, y - py, z - pz)
    x, y, z = route.target
    _append_rotated(values, frame, x - px, y - py, z - pz)
    values += (route.distance_to_go, route.warning)
    x, y, z = reading.tip_force.tolist()
    _append_rotated(values, frame, x, y, z)
    values += (reading.wall_force_max, reading.wall_force_sum, float(reading.contact_count), time_left)
    scaled = np.array(values)
    scaled *= factors
    np.minimum(scaled, 1.0, out=scaled)
    np.maximum(scaled, -1.0, out=scaled)
    return scaled.astype(np.float32)
