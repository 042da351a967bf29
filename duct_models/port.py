"""Find the port of a user's lumen and place the mesh in the robot's frame: port at the origin, insertion along +z."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from evergym.duct_models.bodies import unite
from evergym.duct_models.lumen_voxels import LumenVoxels
from evergym.duct_models.repair import Opening
from evergym.duct_models.scene import WallScene
from evergym.duct_models.skeleton import Skeleton, find_skeleton
from evergym.duct_models.wall import PORT_EXTENSION
from evergym.errors import GeometryError
from evergym.units import MM

__all__ = ["Port", "extend_below_port", "find_port", "make_pose"]

Array = NDArray[np.float64]

CAP_ROUNDNESS = 0.4
"""A flat part of the wall is a cut end if it fills this share of the circle around it. Prior."""
JOINING = 0.5 * MM
"""How far the straight lumen below the port reaches into the duct, so that the two are one [m]."""


@dataclass(frozen=True)
class Port:
    """Where the robot enters.

    Attributes:
        point: In the mesh's frame [m], shape (3,).
        direction: Of insertion, shape (3,); None to follow the centreline.
        origin: How it was found, for the report.
    """

    point: Array
    direction: Array | None
    origin: str


def find_port(
    lumen: trimesh.Trimesh,
    openings: list[Opening],
    voxels: LumenVoxels,
    robot_diameter: float,
    point: Array | None,
    direction: Array | None,
    source: str,
) -> Port:
    """Choose the port: the user's point, else the widest open end, else the widest flat end, else the widest round one.

    Args:
        lumen: Closed mesh [m].
        openings: Flat ends that were open before the repair.
        voxels: The lumen's voxels.
        robot_diameter: An end narrower than this is no port [m].
        point: The user's [m], shape (3,), or None.
        direction: The user's direction of insertion, shape (3,), or None.
        source: What to call the mesh in messages.

    Raises:
        GeometryError: If the user's point is not in the lumen.
    """
    unit = None if direction is None else _make_unit(direction, source)
    if point is not None:
        return Port(_check_point(point, voxels, source), unit, "given")
    area = 0.25 * math.pi * robot_diameter**2
    ends = [(opening.radius, opening.centre, "the widest open end") for opening in openings]
    # bodies that were dropped had openings too
    ends = [end for end in ends if _gap(voxels, end[1]) < 3.0 * voxels.spacing]
    if not any(radius >= 0.5 * robot_diameter for radius, _, _ in ends):
        ends = [(radius, centre, "the widest flat end") for radius, centre in _find_caps(lumen, area)]
    ends = [end for end in ends if end[0] >= 0.5 * robot_diameter]
    if ends:
        radius, centre, origin = max(ends, key=lambda end: end[0])
        return Port(centre, unit, f"{origin}, {2 * radius / MM:.1f} mm across")
    return Port(_find_round_end(voxels), unit, "inside the widest round end")


def _make_unit(direction: Array, source: str) -> Array:
    vector = np.asarray(direction, dtype=np.float64).reshape(-1)
    size = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not np.isfinite(vector).all() or size == 0.0:
        raise GeometryError(
            f"The insertion direction for {source} must be three numbers, not all zero: got {direction}."
        )
    return vector / size


def _gap(voxels: LumenVoxels, point: Array) -> float:
    return float(np.linalg.norm(voxels.centre[voxels.find_nearest(point)] - point))


def _check_point(point: Array, voxels: LumenVoxels, source: str) -> Array:
    where = np.asarray(point, dtype=np.float64).reshape(-1)
    if where.shape != (3,) or not np.isfinite(where).all():
        raise GeometryError(f"The port of {source} must be three finite numbers in metres: got {point}.")
    nearest = voxels.centre[voxels.find_nearest(where)]
    gap = float(np.linalg.norm(nearest - where))
    if gap > 2.0 * voxels.spacing:
        raise GeometryError(
            f"The port at {_text(where)} mm lies {gap / MM:.1f} mm outside the lumen of {source}. The nearest point "
            f"inside is "
            f"{_text(nearest)} mm; the port is given in metres, after scaling."
        )
    return where


def _find_caps(lumen: trimesh.Trimesh, area_min: float) -> list[tuple[float, Array]]:
    """Flat round parts of the wall: radius of the circle with their area [m] and centre [m]."""
    # plain arrays: every access through the mesh hashes all of it
    vertices, faces, area_of = (np.array(part) for part in (lumen.vertices, lumen.faces, lumen.area_faces))
    caps = []
    for part, area in zip(lumen.facets, lumen.facets_area, strict=True):
        if area < area_min:
            continue
        corner = vertices[faces[part]]
        centre = (corner.mean(axis=1) * area_of[part][:, None]).sum(axis=0) / area
        reach = float(np.linalg.norm(corner.reshape(-1, 3) - centre, axis=1).max())
        if area >= CAP_ROUNDNESS * math.pi * reach**2:
            caps.append((math.sqrt(area / math.pi), centre))
    return caps


def _find_round_end(voxels: LumenVoxels) -> Array:
    """Find the port in the end with the widest lumen: as deep inside as generated ducts have it."""
    everywhere = np.ones(len(voxels.depth), dtype=bool)
    # the farthest voxel from anywhere lies at an end
    start = int(np.argmax(voxels.measure_ways(0, everywhere)))
    forth = find_skeleton(voxels, voxels.centre[start], everywhere)
    ways = [(forth, forth.path_to(int(leaf))) for leaf in forth.leaves]
    # a way ends at the centre of the last ball but begins at the wall, so the first end is looked at from the other
    # side
    far = max(ways, key=lambda way: len(way[1]))[1][-1]
    back = find_skeleton(voxels, forth.position[far], everywhere)
    gap = np.linalg.norm(back.position[back.leaves] - voxels.centre[start], axis=1)
    ways.append((back, back.path_to(int(back.leaves[int(np.argmin(gap))]))))
    best, widest = forth.position[0], -1.0
    for skeleton, path in ways:
        way = path[::-1]
        station = _measure(skeleton, way)
        width = float(np.median(skeleton.depth[way][station <= 6.0 * MM]))
        if width > widest:
            inside = int(np.searchsorted(station, min(PORT_EXTENSION, station[-1])))
            best, widest = skeleton.position[way[inside]], width
    return np.array(best)


def _measure(skeleton: Skeleton, way: NDArray[np.int64]) -> Array:
    steps = np.linalg.norm(np.diff(skeleton.position[way], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def make_pose(point: Array, direction: Array, roll: float = 0.0) -> Array:
    """Make the rigid motion that brings a port to the origin and its direction to +z by the smallest turn.

    Args:
        point: The port [m], shape (3,).
        direction: Unit direction of insertion, shape (3,).
        roll: Further turn about +z [rad].

    Returns:
        Homogeneous matrix, shape (4, 4).
    """
    pose = np.diag([1.0, -1.0, -1.0, 1.0])  # straight back: half a turn about x
    if direction[2] > -1.0 + 1e-9:
        # Rodrigues' formula
        across = np.cross(direction, [0.0, 0.0, 1.0])
        skew = np.array([[0, -across[2], across[1]], [across[2], 0, -across[0]], [-across[1], across[0], 0]])
        pose[:3, :3] = np.eye(3) + skew + skew @ skew / (1.0 + direction[2])
    cosine, sine = math.cos(roll), math.sin(roll)
    pose[:3, :3] = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]) @ pose[:3, :3]
    pose[:3, 3] = -pose[:3, :3] @ point
    return pose


def extend_below_port(lumen: trimesh.Trimesh, source: str) -> tuple[trimesh.Trimesh, bool]:
    """Give the lumen a straight piece below the port, so that a robot at the port is not pushed out by the end's wall.

    Args:
        lumen: Closed mesh in the robot's frame [m].
        source: What to call it in messages.

    Returns:
        The mesh, and whether it was extended; where the lumen already reaches 3 mm below the port it is unchanged.
    """
    scene = WallScene(lumen)
    radius = _measure_section(lumen)
    behind = np.array([[0.0, 0.0, -0.5 * PORT_EXTENSION], [0.0, 0.0, -PORT_EXTENSION]])
    if (scene.distance(behind)[0] >= 0.7 * radius).all():
        return lumen, False
    length = PORT_EXTENSION + radius + JOINING
    # a polygon around the circle, so that the piece is nowhere narrower than the port
    tube = trimesh.creation.cylinder(radius / math.cos(math.pi / 64), length, sections=64)
    tube.apply_translation([0.0, 0.0, JOINING - 0.5 * length])
    return unite([lumen, tube], source), True


def _measure_section(lumen: trimesh.Trimesh) -> float:
    """Largest radius [m] around the axis just inside the port."""
    section = lumen.section(plane_origin=[0.0, 0.0, JOINING], plane_normal=[0.0, 0.0, 1.0])
    if section is None:
        raise GeometryError(
            "The lumen does not lie ahead of the port. Give the direction of insertion the other way round."
        )
    rings = [ring for ring in section.discrete if _winds_around_axis(ring)]
    if not rings:
        raise GeometryError("The port lies beside the lumen. Give a port in its middle.")
    return float(min(_measure_ring(ring) for ring in rings))


def _winds_around_axis(ring: Array) -> bool:
    angle = np.unwrap(np.arctan2(ring[:, 1], ring[:, 0]))
    return bool(abs(angle[-1] - angle[0]) > math.pi)


def _measure_ring(ring: Array) -> float:
    """Distance from the axis to a closed polygon."""
    a, b = ring[:-1, :2], ring[1:, :2]
    edge = b - a
    share = np.clip(-(a * edge).sum(axis=1) / np.maximum((edge**2).sum(axis=1), 1e-30), 0.0, 1.0)
    return float(np.linalg.norm(a + share[:, None] * edge, axis=1).min())


def _text(point: Array) -> str:
    return "(" + ", ".join(f"{value / MM:.2f}" for value in point) + ")"
