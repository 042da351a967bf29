"""Repair a user's mesh until it is one closed surface with outward winding, and say what was found, done and left."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pymeshfix
import scipy.sparse
import scipy.sparse.csgraph
import scipy.spatial
import trimesh
from numpy.typing import NDArray

from evergym.duct_models.bodies import choose_lumen, measure_volume, split_bodies
from evergym.duct_models.self_intersection import find_self_intersections
from evergym.errors import GeometryError
from evergym.units import MM

__all__ = ["Opening", "RepairReport", "repair_mesh"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

WELD_DISTANCE = 1e-6
"""Vertices nearer than this become one [m]: above the rounding of a text or float32 file, below any feature."""
GAP_DISTANCE = 20e-6
"""The same where seams stay open [m]: files with few digits, or patches exported one by one."""
HOLE_RADIUS = 3.0 * MM
"""Holes up to this radius (perimeter / 2 pi) are closed, whatever their shape [m]. Prior: a robot diameter."""
OPENING_FLATNESS = 0.08
"""A loop is a cut end of the duct if its points are this near to a plane (RMS over radius). Prior."""
CUT_RADIUS = 0.5 * MM
"""Smaller loops are holes even if flat [m]. Prior."""
VOLUME_CHANGE = 0.01
"""Removal of self-intersections may change the volume by this share. Prior."""


@dataclass(frozen=True)
class Opening:
    """A flat end of the lumen: an open loop that was closed, where the port may be.

    All in the mesh's frame, SI.
    """

    centre: Array
    """Centre [m], shape (3,)."""
    inward: Array
    """Unit normal into the lumen, shape (3,)."""
    radius: float
    """Radius of the circle with the same area [m]."""


@dataclass
class RepairReport:
    """What repairing a mesh found, did and could not do, in sentences for people, and the openings it closed."""

    source: str
    """What was repaired, as it is called in messages."""
    found: list[str] = field(default_factory=list)
    """Faults found."""
    done: list[str] = field(default_factory=list)
    """What was done about them."""
    remains: list[str] = field(default_factory=list)
    """What still deserves a look."""
    openings: list[Opening] = field(default_factory=list)
    """Flat open ends that were closed."""

    @property
    def is_clean(self) -> bool:
        """Whether there was nothing to repair."""
        return not self.found

    def __str__(self) -> str:
        """All sentences, a line each."""
        lines = [f"{self.source}: {'nothing to repair' if self.is_clean else 'repaired'}"]
        for title in ("found", "done", "remains"):
            lines += [f"  {title}: {text}" for text in getattr(self, title)]
        return "\n".join(lines)

    def as_dict(self) -> dict[str, list[str]]:
        """The sentences as plain data, for metadata and JSON."""
        return {"found": list(self.found), "done": list(self.done), "remains": list(self.remains)}


def repair_mesh(mesh: trimesh.Trimesh, source: str) -> tuple[trimesh.Trimesh, RepairReport]:
    """Make one closed surface with outward winding of a mesh.

    Merges vertices, drops degenerate and repeated faces, makes the winding of each body consistent, closes holes,
    removes small self-intersections, keeps the lumen of several bodies and turns its normals outwards.

    Args:
        mesh: Any triangles [m].
        source: What to call it in messages.

    Returns:
        The closed mesh [m] and the report.

    Raises:
        GeometryError: If it is still open or intersects itself after the repair; with number and place of the faults.
    """
    report = RepairReport(source)
    clean = _drop_bad_faces(mesh, report, WELD_DISTANCE)
    if not clean.is_watertight:
        trial = RepairReport(source)
        welded = _drop_bad_faces(mesh, trial, GAP_DISTANCE)
        if _count_open_edges(welded) < 0.5 * _count_open_edges(clean):
            clean = welded
            report.found = [*trial.found, f"seams open by up to {GAP_DISTANCE / MM:g} mm"]
            report.done = [*trial.done, "closed the seams"]
    bodies = [_close(body, report) for body in split_bodies(clean)]
    lumen = choose_lumen(bodies, report.found, report.done, source)
    lumen = _remove_intersections(lumen, report)
    _check_closed(lumen, source)
    if measure_volume(lumen) < 0.0:
        report.found.append("the normals point inwards")
        report.done.append("turned the normals outwards")
        lumen.invert()
    return lumen, report


def _weld(vertices: Array, faces: Indices, distance: float) -> tuple[Array, Indices]:
    """Make one vertex of all that a chain of steps up to a distance connects."""
    exact, place = np.unique(vertices, axis=0, return_inverse=True)
    pairs = scipy.spatial.cKDTree(exact).query_pairs(distance, output_type="ndarray")
    links = scipy.sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(exact),) * 2)
    _, label = scipy.sparse.csgraph.connected_components(links, directed=False)
    _, first = np.unique(label, return_index=True)
    return exact[first], label[place.reshape(-1)][faces].astype(np.int64)


def _count_open_edges(mesh: trimesh.Trimesh) -> int:
    _, count = np.unique(np.sort(mesh.edges, axis=1), axis=0, return_counts=True)
    return int((count != 2).sum())


def _drop_bad_faces(mesh: trimesh.Trimesh, report: RepairReport, weld: float) -> trimesh.Trimesh:
    vertices, faces = _weld(np.asarray(mesh.vertices), np.asarray(mesh.faces), weld)
    # a sliver between three different vertices holds the surface together: only faces that lost a vertex go here
    flat = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    if flat.any():
        report.found.append(f"{int(flat.sum())} degenerate faces")
        report.done.append("dropped the degenerate faces")
    faces = faces[~flat]
    _, kept = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    if len(kept) < len(faces):
        report.found.append(f"{len(faces) - len(kept)} duplicate faces")
        report.done.append("dropped the duplicate faces")
    faces = faces[np.sort(kept)]
    if len(faces) < 4:
        raise GeometryError(
            f"{report.source} has {len(faces)} usable triangles of {len(mesh.faces)}; a closed surface needs 4 or "
            f"more. Check that the "
            "file holds the lumen's surface, and its unit."
        )
    used, faces = np.unique(faces, return_inverse=True)
    return trimesh.Trimesh(vertices[used], faces.reshape(-1, 3), process=False)


def _close(body: trimesh.Trimesh, report: RepairReport) -> trimesh.Trimesh:
    """Make one body's winding consistent and close its holes."""
    if not body.is_winding_consistent:
        report.found.append("neighbouring faces with opposite winding")
        trimesh.repair.fix_winding(body)  # type: ignore[no-untyped-call]
        if body.is_winding_consistent:
            report.done.append("made the winding consistent")
    if body.is_watertight:
        return body
    loops = _find_loops(body)
    if loops is None:
        report.found.append("edges shared by more than two faces, or holes that touch each other")
        body = _fix(body, fill=False)
        loops = _find_loops(body)
        report.done.append("cut the surface along those edges and kept its largest part")
        if loops is None:
            return body
    small: list[Indices] = []
    large: list[Indices] = []
    for loop in loops:
        (small if _is_closable(body, loop, report) else large).append(loop)
    body = _cap(body, small)
    if large and not body.is_watertight:
        for loop in large:
            where = body.vertices[loop].mean(axis=0) / MM
            report.remains.append(f"a hole of {_ring_radius(body, loop) * 2 / MM:.1f} mm across at {_text(where)} mm")
    return body


def _find_loops(body: trimesh.Trimesh) -> list[Indices] | None:
    """Boundary loops as vertex indices in the order that closes them outwards; None if they are not simple."""
    edges = body.edges
    _, inverse, count = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    if (count > 2).any():
        return None
    border = edges[count[inverse.reshape(-1)] == 1]
    # a filling face runs along the border edge in the opposite sense
    after = {int(b): int(a) for a, b in border}
    if len(after) != len(border):
        return None
    loops = []
    while after:
        start = next(iter(after))
        loop = [start]
        here = after.pop(start)
        while here != start:
            loop.append(here)
            if here not in after:
                return None
            here = after.pop(here)
        loops.append(np.array(loop, dtype=np.int64))
    return loops


def _ring_radius(body: trimesh.Trimesh, loop: Indices) -> float:
    points = body.vertices[loop]
    return float(np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).sum() / (2.0 * math.pi))


def _is_closable(body: trimesh.Trimesh, loop: Indices, report: RepairReport) -> bool:
    """Tell whether a loop may be closed, and note it as a hole or as an opening."""
    points = body.vertices[loop]
    centre = points.mean(axis=0)
    arm = points - centre
    double_area = np.cross(arm, np.roll(arm, -1, axis=0)).sum(axis=0)
    size = float(np.linalg.norm(double_area))
    radius = math.sqrt(0.5 * size / math.pi)
    ring = _ring_radius(body, loop)
    outward = double_area / size if size > 0.0 else np.zeros(3)
    flatness = float(np.sqrt(np.mean((arm @ outward) ** 2))) / max(radius, 1e-12)
    where = _text(centre / MM)
    if flatness < OPENING_FLATNESS and radius > max(CUT_RADIUS, 0.5 * ring):
        report.found.append(f"an open end of {2 * radius / MM:.1f} mm across at {where} mm")
        report.done.append(f"closed the open end at {where} mm")
        report.openings.append(Opening(centre, -outward, radius))
        return True
    report.found.append(f"a hole of {2 * ring / MM:.2f} mm across with {len(loop)} edges at {where} mm")
    if ring <= HOLE_RADIUS:
        report.done.append(f"closed the hole at {where} mm")
        return True
    return False


def _cap(body: trimesh.Trimesh, loops: list[Indices]) -> trimesh.Trimesh:
    """Close loops: triangles directly, flat ends by a fan, other holes by MeshFix's refined patches."""
    vertices = [np.asarray(body.vertices)]
    faces = [np.asarray(body.faces)]
    count = len(body.vertices)
    for loop in loops:
        if len(loop) == 3:
            faces.append(loop.reshape(1, 3))
            continue
        vertices.append(body.vertices[loop].mean(axis=0)[None])
        faces.append(np.stack([loop, np.roll(loop, -1), np.full(len(loop), count)], axis=1))
        count += 1
    closed = trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=False)
    if len(find_self_intersections(closed)) > len(find_self_intersections(body)):
        # a fan over a strongly bent hole cuts the wall; MeshFix triangulates and relaxes instead
        patched = _fix(body, fill=True)
        return patched if patched.is_watertight else closed
    return closed


def _fix(body: trimesh.Trimesh, *, fill: bool) -> trimesh.Trimesh:
    """Run MeshFix: connectivity always, holes if asked (in millimetres, the scale its tolerances suit)."""
    tool = _load_tool(body)
    tool.fix_connectivity()
    if fill:
        tool.fill_small_boundaries(0, True)
    points, faces = tool.return_arrays()
    return trimesh.Trimesh(np.asarray(points) * MM, np.asarray(faces), process=False)


def _load_tool(body: trimesh.Trimesh) -> pymeshfix.PyTMesh:
    tool = pymeshfix.PyTMesh()
    tool.set_quiet(True)
    tool.load_array(np.ascontiguousarray(body.vertices / MM), np.ascontiguousarray(body.faces, dtype=np.int32))
    return tool


def _remove_intersections(lumen: trimesh.Trimesh, report: RepairReport) -> trimesh.Trimesh:
    cutting = find_self_intersections(lumen)
    if len(cutting) == 0:
        return lumen
    places = lumen.triangles_center[cutting]
    centre = _text(places.mean(axis=0) / MM)
    report.found.append(f"{len(places)} triangles that intersect others, around {centre} mm")
    tool = _load_tool(lumen)
    tool.clean(10, 3)
    points, faces = tool.return_arrays()
    cleaned = trimesh.Trimesh(np.asarray(points) * MM, np.asarray(faces), process=False)
    same_size = np.allclose(cleaned.bounds, lumen.bounds, atol=0.1 * MM)
    same_volume = abs(abs(measure_volume(cleaned)) - abs(measure_volume(lumen))) <= VOLUME_CHANGE * abs(
        measure_volume(lumen)
    )
    if cleaned.is_watertight and same_size and same_volume and len(find_self_intersections(cleaned)) == 0:
        report.done.append("replaced the intersecting triangles")
        return cleaned
    raise GeometryError(
        f"{report.source} intersects itself: {len(places)} triangles around {centre} mm, between "
        f"{_text(places.min(axis=0) / MM)} and "
        f"{_text(places.max(axis=0) / MM)} mm, and removing them would change its shape. Unite the overlapping parts "
        f"in a mesh "
        "editor (boolean union) or export them as separate bodies."
    )


def _check_closed(lumen: trimesh.Trimesh, source: str) -> None:
    if lumen.is_watertight and lumen.is_winding_consistent:
        return
    edges = np.sort(lumen.edges, axis=1)
    single, count = np.unique(edges, axis=0, return_counts=True)
    border = single[count == 1]
    if len(border) == 0:
        raise GeometryError(
            f"{source} is not a surface after the repair: {int((count > 2).sum())} edges are shared by more than two "
            f"faces, or its "
            "winding cannot be made consistent. Repair it in a mesh editor."
        )
    middle = lumen.vertices[border].mean(axis=1) / MM
    raise GeometryError(
        f"{source} is not closed after the repair: {len(border)} open edges around {_text(middle.mean(axis=0))} mm, "
        f"between "
        f"{_text(middle.min(axis=0))} and {_text(middle.max(axis=0))} mm. Holes up to {2 * HOLE_RADIUS / MM:g} mm "
        f"across and flat "
        "open ends are closed automatically; close this one in a mesh editor."
    )


def _text(point: Array) -> str:
    return "(" + ", ".join(f"{value:.1f}" for value in point) + ")"
