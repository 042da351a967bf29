"""Prove that a duct is usable: closed wall, field true to fcl, room for the robot on the way to every target."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from evergym.duct_models.duct import Duct, Target
from evergym.duct_models.field import evaluate_wall_field
from evergym.duct_models.scene import WallScene
from evergym.errors import GeometryError
from evergym.units import DEG, MM

__all__ = ["DuctReport", "WayReport", "check_duct", "find_smooth_points", "format_report", "measure_room"]

FloatArray = NDArray[np.float64]

FIELD_TOLERANCE = 0.05 * MM  # the field is held to fcl this closely where the robot touches
PROBES = 400  # points at which it is compared, spread over the wall
FEELER = 1.0 * MM  # the probes lie up to this far inside the wall
SPLINE_REACH = 0.75 * MM  # half the width of a quadratic spline's support on 0.5 mm
SAME_DIRECTION = 0.8  # cosine
SIDE_STEPS = 12  # directions in which room beside the centreline is looked for


@dataclass(frozen=True)
class WayReport:
    """The way to one target.

    Attributes:
        target: The target.
        turn_angle: Summed change of direction on the way [rad].
        lumen_diameter: The narrowest passage [m], from the mesh.
        lumen_station: Where that is [m].
        separation: Distance to the nearest point of a branch that is neither on the way nor beyond the target [m].
        bifurcation_distance: Way from the last bifurcation [m]; NaN if there is none.
    """

    target: Target
    turn_angle: float
    lumen_diameter: float
    lumen_station: float
    separation: float
    bifurcation_distance: float


@dataclass(frozen=True)
class DuctReport:
    """What `check_duct` has found; all of it is in order.

    Attributes:
        name: The duct.
        triangle_count: Of the wall.
        volume: Enclosed by the wall [m^3].
        field_error: Largest difference between field and fcl at the probes away from medial axes [m].
        ways: One per target.
    """

    name: str
    triangle_count: int
    volume: float
    field_error: float
    ways: tuple[WayReport, ...]


def check_duct(duct: Duct, robot_outer_diameter: float) -> DuctReport:
    """Check a duct for a robot.

    Args:
        duct: The duct.
        robot_outer_diameter: Of the robot's widest part [m].

    Returns:
        What was measured.

    Raises:
        GeometryError: The wall is not one closed surface, the field is not true to fcl, there are no targets, or the
            robot does not fit on the way to one.
    """
    if not (math.isfinite(robot_outer_diameter) and 0.0 < robot_outer_diameter < 0.1):
        raise GeometryError(
            f"The robot's outer diameter must be a positive number of metres: got {robot_outer_diameter:g}. "
            "3 mm is 0.003."
        )
    _check_mesh(duct)
    if not duct.targets:
        raise GeometryError(f"Duct '{duct.name}' has no target. Give one leaf end at least 10 mm from the port.")
    scene = WallScene(duct.mesh)
    room = measure_room(duct, scene)
    for target in duct.targets:
        _check_room(duct, target, room, robot_outer_diameter)
    return DuctReport(
        duct.name,
        len(duct.mesh.faces),
        float(duct.mesh.volume),
        _check_field(duct, scene),
        tuple(_describe_way(duct, target, room) for target in duct.targets),
    )


def _check_mesh(duct: Duct) -> None:
    mesh = duct.mesh
    if not mesh.is_watertight:
        _, uses = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
        edges = int(np.count_nonzero(uses == 1))
        raise GeometryError(
            f"The wall of duct '{duct.name}' is not closed: {edges} of its edges have a triangle on one side only. "
            "Repair the mesh (load_duct does so)."
        )
    if not mesh.is_winding_consistent or mesh.volume <= 0.0:
        raise GeometryError(
            f"The wall of duct '{duct.name}' is inside out or wound inconsistently (volume "
            f"{mesh.volume / MM**3:.1f} mm^3). Repair the mesh (load_duct does so)."
        )
    if mesh.body_count != 1:
        raise GeometryError(
            f"The wall of duct '{duct.name}' consists of {mesh.body_count} separate surfaces, it must be one. Keep the "
            "one that the robot enters."
        )


def measure_room(duct: Duct, scene: WallScene) -> FloatArray:
    """Radius of the largest sphere that passes each centreline node [m], shape (n,).

    A centreline need not know of a dent, so the sphere may move sideways, up to half the lumen radius.

    Args:
        duct: The duct.
        scene: Its wall.
    """
    line = duct.centreline
    segment = line.position[1:] - line.position[line.parent[1:]]
    tangent = np.vstack([[0.0, 0.0, 1.0], segment / np.linalg.norm(segment, axis=1, keepdims=True)])
    across = np.cross(tangent, np.where(np.abs(tangent[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(tangent, across)
    best = line.position.copy()
    room = scene.distance(best)[0]
    step = 0.25 * line.radius
    for _ in range(4):
        for angle in np.linspace(0.0, 2.0 * math.pi, SIDE_STEPS, endpoint=False):
            tried = best + step[:, None] * (math.cos(angle) * across + math.sin(angle) * other)
            found = scene.distance(tried)[0]
            near = np.linalg.norm(tried - line.position, axis=1) <= 0.5 * line.radius
            better = near & (found > room)
            best[better], room[better] = tried[better], found[better]
        step = 0.5 * step
    return np.asarray(room)


def _check_room(duct: Duct, target: Target, room: FloatArray, diameter: float) -> None:
    line = duct.centreline
    way = line.path_to(target.node)
    narrow = way[2.0 * room[way] < diameter]
    if len(narrow):
        node = int(narrow[0])
        least = 2.0 * max(float(room[way].min()), 1e-9)
        raise GeometryError(
            f"Robot does not fit duct '{duct.name}' at station {line.station[node] / MM:.1f} mm: outer diameter is "
            f"{diameter / MM:.2f} mm, the lumen is {2.0 * room[node] / MM:.2f} mm. Choose a smaller sheath or scale "
            f"the mesh (scale={math.ceil(100.0 * diameter / least) / 100.0:g})."
        )


def find_smooth_points(scene: WallScene, points: FloatArray) -> NDArray[np.bool_]:
    """Which points lie away from medial axes and creases of the wall, where the distance has a kink.

    No smooth field follows a kink, so only elsewhere can one be compared with fcl. By fcl's answers alone: a point is
    smooth if the direction to the wall is nearly the same at six points around it, as far away as the spline reaches.

    Args:
        scene: The wall.
        points: Positions [m], shape (k, 3).
    """
    normal = scene.distance(points)[1]
    smooth = np.ones(len(points), dtype=bool)
    for offset in np.vstack([np.eye(3), -np.eye(3)]) * SPLINE_REACH:
        smooth &= np.sum(scene.distance(points + offset)[1] * normal, axis=1) > SAME_DIRECTION
    return smooth


def _check_field(duct: Duct, scene: WallScene) -> float:
    """Largest difference between field and fcl at points inside the wall, where the two can be compared."""
    points, faces = trimesh.sample.sample_surface(duct.mesh, PROBES, seed=0)
    depth = FEELER * (np.arange(PROBES) % 10 + 0.5) / 10.0
    probes = points - depth[:, None] * duct.mesh.face_normals[faces]
    probes = probes[find_smooth_points(scene, probes)]
    if not len(probes):
        raise GeometryError(
            f"The lumen of duct '{duct.name}' is too narrow everywhere to be resolved by a field of "
            f"{duct.field.spacing[0] / MM:.2f} mm. Check the mesh's unit (scale=...)."
        )
    error = np.abs(evaluate_wall_field(duct.field, probes)[0] - scene.distance(probes)[0])
    worst = int(np.argmax(error))
    if error[worst] > FIELD_TOLERANCE:
        where = ", ".join(f"{x / MM:.1f}" for x in probes[worst])
        raise GeometryError(
            f"The wall field of duct '{duct.name}' is {error[worst] / MM:.3f} mm off fcl's distance at ({where}) mm, "
            f"the limit is {FIELD_TOLERANCE / MM:.2f} mm. Smooth the mesh there: it has features finer than the field."
        )
    return float(error[worst])


def _describe_way(duct: Duct, target: Target, room: FloatArray) -> WayReport:
    line = duct.centreline
    way = line.path_to(target.node)
    narrowest = int(way[np.argmin(room[way])])
    beyond = np.array([target.node in line.path_to(int(leaf)) for leaf in line.leaves])
    related = np.zeros(len(line.position), dtype=bool)
    for leaf in line.leaves[beyond]:
        related[line.path_to(int(leaf))] = True
    gaps = np.linalg.norm(line.position[~related] - target.position, axis=1)
    passed = np.intersect1d(way, line.bifurcations)
    return WayReport(
        target,
        float(line.turn_angle[target.node]),
        float(2.0 * room[narrowest]),
        float(line.station[narrowest]),
        float(gaps.min()) if len(gaps) else math.inf,
        float(target.station - line.station[passed].max()) if len(passed) else math.nan,
    )


def format_report(report: DuctReport) -> str:
    """The report as a table for people."""
    wall = f"closed wall of {report.triangle_count} triangles, {report.volume / MM**3:.0f} mm^3"
    lines = [
        f"duct {report.name}: {wall}, field within {report.field_error / MM:.3f} mm of fcl",
        "target  station_mm  generation  turn_deg  lumen_mm  at_mm  beyond_bifurcation_mm  next_branch_mm",
    ]
    lines += [
        f"{number:>6}  {way.target.station / MM:>10.1f}  {way.target.generation:>10}  {way.turn_angle / DEG:>8.1f}  "
        f"{way.lumen_diameter / MM:>8.2f}  {way.lumen_station / MM:>5.1f}  {way.bifurcation_distance / MM:>21.1f}  "
        f"{way.separation / MM:>14.1f}"
        for number, way in enumerate(report.ways)
    ]
    return "\n".join(lines)
