"""A duct from a user's own mesh: read, repair, place, find the centreline and prove that the robot reaches its ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from evergym.duct_models.centreline import Centreline
from evergym.duct_models.duct import Duct, make_targets
from evergym.duct_models.duct_file import read_duct_file
from evergym.duct_models.lumen_voxels import voxelise
from evergym.duct_models.mesh_file import UNITS, check_size, read_mesh
from evergym.duct_models.port import extend_below_port, find_port, make_pose
from evergym.duct_models.repair import RepairReport, repair_mesh
from evergym.duct_models.scene import WallScene
from evergym.duct_models.skeleton import Skeleton, find_forward, find_skeleton, make_centreline
from evergym.errors import GeometryError
from evergym.units import DEG, MM

__all__ = ["ROBOT_REACH", "load_duct"]

Array = NDArray[np.float64]

ROBOT_REACH = 140.0 * MM
"""Longest way that the sheath's material allows [m]: 280 mm of it, half for the tail. Source: Wu 2023."""
FIT_MARGIN = 0.1 * MM
"""The lumen must be this much wider than the robot [m]. Prior: no room at all is no fit."""
END_MARGIN = 4.0 * MM
"""Targets lie this far before the end of a branch, so that the tip can pass them [m]. Prior, as in generated ducts."""
SHORTEST_WAY = 10.0 * MM
"""A target nearer than this is reached at the start [m]: the robot begins with some 10 mm everted."""


def load_duct(
    path: str | Path,
    *,
    scale: float | None = None,
    unit: str | None = None,
    port: ArrayLike | None = None,
    direction: ArrayLike | None = None,
    roll: float | None = None,
    robot_outer_diameter: float | None = None,
    robot_reach: float = ROBOT_REACH,
    name: str | None = None,
) -> Duct:
    """Make a duct of a mesh of its lumen.

    The mesh is the surface of the space that the robot moves in. It is repaired where needed (``metadata["repair"]``
    says how), moved so that the port is at the origin with insertion along +z, and given a straight piece below the
    port. Targets are the ends of all branches that the robot's diameter and length allow to be reached;
    ``metadata["unreachable"]`` says why others are not.

    Args:
        path: STL, OBJ, PLY or GLB file, or a ``duct.toml`` that names one (see ``read_duct_file``).
        scale: Factor on the file's coordinates, 1 by default.
        unit: Unit of the file's coordinates: "m", "cm", "mm" (default), "um" or "inch".
        port: Where the robot enters [m], in the file's frame after unit and scale, shape (3,). By default the widest
            open end, else the widest flat end, else the widest round end.
        direction: Of insertion, in the same frame, shape (3,). By default along the centreline.
        roll: Turn of the placed mesh about +z [rad], which decides how gravity (-y) acts on it; 0 by default, when the
            mesh is placed by the smallest turn that brings the direction to +z.
        robot_outer_diameter: Outer diameter that must fit [m], 3.0 mm by default (Wu 2023, Table I).
        robot_reach: Longest way that the robot can grow [m].
        name: Name of the duct, the file's name by default.

    Raises:
        GeometryError: If the mesh cannot be used; with what is wrong, where, and what to do.
    """
    file = Path(path)
    given = {"scale": scale, "unit": unit, "port": port, "direction": direction, "name": name, "roll": roll}
    given["robot_outer_diameter"] = robot_outer_diameter
    if file.suffix.lower() == ".toml":
        stored = read_duct_file(file)
        file = stored.pop("mesh")
        given = {key: stored.get(key) if value is None else value for key, value in given.items()}
    order = _make_order(file, given, robot_reach)
    mesh = read_mesh(file, UNITS[order.unit] * order.scale)
    check_size(mesh, file, order.unit, order.scale)
    source = f"Mesh '{file.name}'"
    lumen, report = repair_mesh(mesh, source)
    skeleton, found = _find_way(lumen, report, order, source)
    pose = make_pose(skeleton.position[0], found["direction"], order.roll)
    placed = lumen.copy()
    placed.apply_transform(pose)
    position = skeleton.position @ pose[:3, :3].T + pose[:3, 3]
    position[0] = 0.0
    placed, extended = extend_below_port(placed, source)
    scene = WallScene(placed)
    moved = Skeleton(position, skeleton.parent, skeleton.depth)
    centreline = make_centreline(moved, lambda points: _measure_radius(scene, points, source))
    nodes, unreachable = _find_targets(centreline, order)
    metadata = {
        "family": "imported",
        "file": str(file),
        "unit": order.unit,
        "scale": order.scale,
        "pose": pose.tolist(),
        "port_found": found["port"],
        "extended_below_port": extended,
        "robot_diameter_mm": order.robot_diameter / MM,
        "turn_angle_deg": [float(centreline.turn_angle[node] / DEG) for node in nodes],
        "unreachable": unreachable,
        "repair": report.as_dict(),
    }
    return Duct(order.name, placed, centreline, make_targets(centreline, nodes), metadata)


@dataclass(frozen=True)
class _Order:
    """What the user asked for, complete and checked."""

    name: str
    unit: str
    scale: float
    port: Array | None
    direction: Array | None
    roll: float
    robot_diameter: float
    reach: float


def _make_order(file: Path, given: dict[str, Any], reach: float) -> _Order:
    scale = 1.0 if given["scale"] is None else float(given["scale"])
    unit = given["unit"] or "mm"
    diameter = 3.0 * MM if given["robot_outer_diameter"] is None else float(given["robot_outer_diameter"])
    if unit not in UNITS:
        raise GeometryError(f"There is no unit '{unit}' for mesh '{file.name}'. Choose one of: {', '.join(UNITS)}.")
    for value, what in (
        (scale, "scale"),
        (diameter, "robot's outer diameter in metres"),
        (reach, "robot's reach in metres"),
    ):
        if not (math.isfinite(value) and value > 0.0):
            raise GeometryError(f"The {what} for mesh '{file.name}' must be a positive number: got {value:g}.")
    roll = 0.0 if given["roll"] is None else float(given["roll"])
    if not math.isfinite(roll):
        raise GeometryError(f"The roll for mesh '{file.name}' must be a finite angle: got {roll:g}.")
    if diameter > 0.1:
        raise GeometryError(
            f"The robot's outer diameter is given in metres: {diameter:g} m is no catheter. 3 mm is 0.003."
        )
    port = None if given["port"] is None else np.asarray(given["port"], dtype=np.float64)
    direction = None if given["direction"] is None else np.asarray(given["direction"], dtype=np.float64)
    return _Order(given["name"] or file.stem, unit, scale, port, direction, roll, diameter, reach)


def _find_way(
    lumen: trimesh.Trimesh, report: RepairReport, order: _Order, source: str
) -> tuple[Skeleton, dict[str, Any]]:
    voxels = voxelise(lumen)
    port = find_port(lumen, report.openings, voxels, order.robot_diameter, order.port, order.direction, source)
    keep = find_forward(voxels, port.point, port.direction)
    skeleton = find_skeleton(voxels, port.point, keep)
    direction = skeleton.find_direction() if port.direction is None else port.direction
    return skeleton, {"direction": direction, "port": port.origin}


def _measure_radius(scene: WallScene, points: Array, source: str) -> Array:
    radius = scene.distance(points)[0]
    if (radius <= 0.0).any():
        worst = int(np.argmin(radius))
        where = ", ".join(f"{value / MM:.1f}" for value in points[worst])
        raise GeometryError(
            f"The centreline found for {source} leaves the lumen by {-radius[worst] / MM:.2f} mm at ({where}) mm from "
            f"the port: the lumen "
            "is narrower there than can be resolved. Widen the mesh there or cut it off before."
        )
    return np.asarray(radius)


def _find_targets(centreline: Centreline, order: _Order) -> tuple[NDArray[np.int64], list[str]]:
    """Find a target before the end of every branch that can be reached; say why the others cannot."""
    nodes, reasons, first = [], [], []
    needed = order.robot_diameter + FIT_MARGIN
    for leaf in centreline.leaves:
        way = centreline.path_to(int(leaf))
        end = max(centreline.station[leaf] - END_MARGIN, 0.5 * centreline.station[leaf])
        way = way[centreline.station[way] <= end]
        narrow = way[2.0 * centreline.radius[way] < needed]
        where = centreline.station[way[-1]]
        if len(narrow):
            width = 2.0 * float(centreline.radius[narrow].min())
            # the message shows the first place that does not fit; the advice heeds the narrowest, and that the scaled
            # mesh's centreline will be another one, by a fraction of a voxel
            scale = math.ceil(100.0 * order.scale * 1.01 * needed / width) / 100.0
            node = int(narrow[0])
            first.append(float(centreline.station[node]))
            reasons.append(
                f"Robot does not fit duct '{order.name}' at station {centreline.station[node] / MM:.1f} mm: outer "
                f"diameter is "
                f"{order.robot_diameter / MM:.2f} mm, the lumen is {2 * centreline.radius[node] / MM:.2f} mm (with "
                f"{FIT_MARGIN / MM:.2f} mm "
                f"of room to spare it needs {needed / MM:.2f} mm). Choose a smaller sheath or scale the mesh "
                f"(scale={scale:g})."
            )
        elif where > order.reach:
            first.append(float(order.reach))
            reasons.append(
                f"Robot does not reach the end of duct '{order.name}' at station {where / MM:.1f} mm: it grows "
                f"{order.reach / MM:.1f} mm at "
                "most. Cut the mesh shorter, give a port nearer to the end, or scale the mesh down."
            )
        elif where < SHORTEST_WAY:
            first.append(float(where))
            reasons.append(
                f"The end of duct '{order.name}' at station {where / MM:.1f} mm is no target: a way must be "
                f"{SHORTEST_WAY / MM:.0f} mm or "
                "longer. Check the port and the unit."
            )
        else:
            nodes.append(int(way[-1]))
    if not nodes:
        # of several obstacles, the one that the robot gets farthest to
        raise GeometryError(reasons[int(np.argmax(first))])
    return np.unique(np.array(nodes, dtype=np.int64)), reasons
