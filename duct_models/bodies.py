"""Several bodies in one mesh: which of them is the lumen."""

from __future__ import annotations

import manifold3d  # type: ignore[import-not-found]  # its stub is not found beside the compiled module
import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
import trimesh
from numpy.typing import NDArray

from evergym.errors import GeometryError
from evergym.units import MM

__all__ = ["choose_lumen", "measure_volume", "split_bodies", "unite"]

Array = NDArray[np.float64]

SHELL_SHARE = 0.5
"""A body inside another is the lumen in its block, not debris, if its longest side is this share of the block's.
Prior."""


def measure_volume(body: trimesh.Trimesh) -> float:
    """Compute the signed volume of a closed mesh [m^3]; zero without a warning for a flat one."""
    a, b, c = (body.vertices[body.faces[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


def split_bodies(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """Split a mesh into the bodies that its shared edges hold together, largest surface first."""
    edges = np.sort(mesh.edges, axis=1)
    _, edge = np.unique(edges, axis=0, return_inverse=True)
    face = np.repeat(np.arange(len(mesh.faces)), 3)
    graph = scipy.sparse.coo_matrix((np.ones(len(face)), (edge.reshape(-1), face))).tocsr()
    count, label = scipy.sparse.csgraph.connected_components(graph.T @ graph, directed=False)
    bodies = []
    for k in range(count):
        faces = mesh.faces[label == k]
        used, renumbered = np.unique(faces, return_inverse=True)
        bodies.append(trimesh.Trimesh(mesh.vertices[used], renumbered.reshape(-1, 3), process=False))
    return sorted(bodies, key=lambda body: -body.area)


def choose_lumen(bodies: list[trimesh.Trimesh], found: list[str], done: list[str], source: str) -> trimesh.Trimesh:
    """Choose, or unite, the bodies that make up the lumen.

    A body that holds a long one inside is the block around the lumen and is dropped; overlapping bodies are united; of
    what is then left the largest is kept.

    Args:
        bodies: The bodies, closed where that was possible.
        found: Report of what was found; extended.
        done: Report of what was done; extended.
        source: What to call the mesh in messages.

    Returns:
        The lumen's surface.
    """
    if len(bodies) == 1:
        return bodies[0]
    closed = [_turn_outwards(body) for body in bodies if body.is_watertight]
    found.append(f"{len(bodies)} bodies")
    if not closed:
        # none can be measured: the largest surface, which the caller then finds open
        return bodies[0]
    open_ones = [body for body in bodies if not body.is_watertight]
    # an open body larger than every closed one is the duct itself: let the caller report its holes
    if open_ones and open_ones[0].area > max(body.area for body in closed):
        return open_ones[0]
    done += [f"dropped an open body of {_size(body)}" for body in open_ones]
    shells = [body for body in closed if any(_is_lumen_in(other, body) for other in closed if other is not body)]
    done += [f"dropped a block of {_size(body)} around the lumen" for body in shells]
    closed = [body for body in closed if not any(body is shell for shell in shells)]
    groups = _unite_overlapping(closed, done, source)
    groups.sort(key=measure_volume, reverse=True)
    done += [f"dropped a body of {_size(body)}" for body in groups[1:]]
    return groups[0]


def unite(bodies: list[trimesh.Trimesh], source: str) -> trimesh.Trimesh:
    """Compute the union of closed bodies.

    Args:
        bodies: Closed meshes with outward winding [m].
        source: What to call them in messages.

    Raises:
        GeometryError: If the result is not a closed surface.

    Source: manifold3d, whose booleans give manifold results by construction.
    """
    # in millimetres: the library drops features below its tolerance, which it takes from the size of the numbers
    solids = [_to_solid(body) for body in bodies]
    result = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add)
    mesh = result.to_mesh()
    united = trimesh.Trimesh(
        np.asarray(mesh.vert_properties[:, :3], dtype=np.float64) * MM, np.asarray(mesh.tri_verts), process=False
    )
    if len(united.faces) == 0 or not united.is_watertight:
        raise GeometryError(
            f"The {len(bodies)} bodies of {source} cannot be united: the result is not closed. Unite them in a mesh "
            f"editor."
        )
    return united


def _to_solid(body: trimesh.Trimesh) -> manifold3d.Manifold:
    mesh = manifold3d.Mesh(
        np.ascontiguousarray(body.vertices / MM, dtype=np.float32), np.ascontiguousarray(body.faces, dtype=np.uint32)
    )
    return manifold3d.Manifold(mesh)


def _turn_outwards(body: trimesh.Trimesh) -> trimesh.Trimesh:
    if measure_volume(body) < 0.0:
        body = body.copy()
        body.invert()
    return body


def _is_lumen_in(inner: trimesh.Trimesh, outer: trimesh.Trimesh) -> bool:
    """Tell whether a body lies wholly inside another and is long enough to be its lumen."""
    if (inner.bounds[0] < outer.bounds[0]).any() or (inner.bounds[1] > outer.bounds[1]).any():
        return False
    if inner.extents.max() < SHELL_SHARE * outer.extents.max():
        return False
    solid, other = _to_solid(inner), _to_solid(outer)
    return bool((solid - other).is_empty())


def _unite_overlapping(bodies: list[trimesh.Trimesh], done: list[str], source: str) -> list[trimesh.Trimesh]:
    count = len(bodies)
    touches = np.zeros((count, count), dtype=bool)
    solids = [_to_solid(body) for body in bodies]
    for i in range(count):
        for j in range(i):
            apart = (bodies[i].bounds[0] > bodies[j].bounds[1]) | (bodies[j].bounds[0] > bodies[i].bounds[1])
            if not apart.any():
                touches[i, j] = not (solids[i] ^ solids[j]).is_empty()
    groups, label = scipy.sparse.csgraph.connected_components(scipy.sparse.csr_matrix(touches), directed=False)
    result = []
    for k in range(groups):
        members = [body for body, group in zip(bodies, label, strict=True) if group == k]
        if len(members) > 1:
            done.append(f"united {len(members)} overlapping bodies")
            result.append(unite(members, source))
        else:
            result.append(members[0])
    return result


def _size(body: trimesh.Trimesh) -> str:
    """Describe a body by its box and, if closed, its volume."""
    box = " x ".join(f"{side / MM:.1f}" for side in body.extents)
    volume = f" ({abs(measure_volume(body)) / MM**3:.1f} mm^3)" if body.is_watertight else ""
    centre = ", ".join(f"{value / MM:.1f}" for value in body.bounds.mean(axis=0))
    return f"{box} mm{volume} at ({centre}) mm"
