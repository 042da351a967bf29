"""Read a user's mesh file, in metres, and notice a wrong unit before anything else goes wrong."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from evergym.errors import GeometryError
from evergym.units import MM

__all__ = ["EXTENSIONS", "UNITS", "check_size", "read_mesh"]

EXTENSIONS = (".stl", ".obj", ".ply", ".glb")
"""Mesh files that can be read."""
UNITS = {"m": 1.0, "cm": 0.01, "mm": 1e-3, "um": 1e-6, "inch": 0.0254}
"""Length of one unit of a mesh file [m]."""
LONGEST_SIDE = (8.0 * MM, 600.0 * MM)
"""Least and greatest longest side of a duct's bounding box [m].

Prior: a lobe of the breast is some 60 mm deep and the robot has 140 mm of material; outside this range a mistaken unit
is likelier than such a duct.
"""


def read_mesh(path: Path, scale: float) -> trimesh.Trimesh:
    """Read all triangles of a mesh file as one mesh, unrepaired.

    Args:
        path: STL, OBJ, PLY or GLB file; a scene's bodies are placed as the scene says.
        scale: Metres per unit of the file.

    Returns:
        The mesh [m], vertices unmerged.

    Raises:
        GeometryError: If the file is missing, of another kind, unreadable, or holds no usable triangles.
    """
    if path.suffix.lower() not in EXTENSIONS:
        raise GeometryError(
            f"Mesh file '{path}' has the extension '{path.suffix}', which is not supported. Export the lumen's "
            f"surface as one of: "
            f"{', '.join(EXTENSIONS)}."
        )
    if not path.exists():
        raise GeometryError(f"Mesh file '{path}' does not exist. Check the path; the present folder is '{Path.cwd()}'.")
    if not path.is_file():
        raise GeometryError(f"'{path}' is a folder. Give the mesh file in it.")
    if path.stat().st_size == 0:
        raise GeometryError(f"Mesh file '{path}' is empty (0 bytes). Export the mesh again.")
    try:
        loaded: Any = trimesh.load(path, process=False, skip_materials=True)
    except Exception as error:  # noqa: BLE001 - trimesh's readers raise whatever their parsers raise
        raise GeometryError(
            f"Mesh file '{path}' cannot be read as {path.suffix[1:].upper()}: {type(error).__name__}: {error}. Open "
            f"it in a mesh "
            "viewer to see what it is, and export it again."
        ) from None
    if isinstance(loaded, trimesh.Scene):
        parts = [part for part in loaded.dump() if isinstance(part, trimesh.Trimesh)]
        loaded = trimesh.util.concatenate(parts) if parts else None
    faces = getattr(loaded, "faces", None)
    if faces is None or len(faces) == 0:
        raise GeometryError(
            f"Mesh file '{path}' holds no triangles (points, lines or text only). Export the lumen's surface as a "
            f"triangle mesh."
        )
    vertices = np.asarray(loaded.vertices, dtype=np.float64)
    faces = np.asarray(faces, dtype=np.int64)
    astray = ((faces < 0) | (faces >= len(vertices))).any(axis=1)
    if astray.any():
        raise GeometryError(
            f"Mesh file '{path}' is damaged: {int(astray.sum())} of {len(faces)} triangles name vertices that it does "
            f"not have (the first is number {int(np.argmax(astray))}). Export it again."
        )
    # a vertex that no triangle uses may be anything
    used, place = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], place.reshape(-1, 3)
    bad = ~np.isfinite(vertices).all(axis=1)
    if bad.any():
        raise GeometryError(
            f"Mesh file '{path}' has {int(bad.sum())} of {len(vertices)} vertices that are not finite (the first is "
            f"number "
            f"{int(np.argmax(bad))}). Repair or export it again."
        )
    return trimesh.Trimesh(vertices * scale, faces, process=False)


def check_size(mesh: trimesh.Trimesh, path: Path, unit: str, scale: float) -> None:
    """Refuse a mesh whose size shows that its unit was mistaken.

    Args:
        mesh: The mesh as it was understood [m].
        path: Its file, for the message.
        unit: The unit it was understood in, a key of ``UNITS``.
        scale: The further scale.

    Raises:
        GeometryError: If its longest side is not between 8 and 600 mm; with the unit that would make it so.
    """
    size = np.asarray(mesh.extents)
    longest = float(size.max())
    low, high = LONGEST_SIDE
    if low <= longest <= high:
        return
    shown = " x ".join(f"{side / MM:.4g}" for side in size)
    found = f"Mesh file '{path}' measures {shown} mm if its unit is {unit}" + (
        "" if scale == 1.0 else f" and scale is {scale:g}"
    )
    # the unit that makes it most like the paper's phantom, 64 mm deep
    fitting = {name: longest / UNITS[unit] * size_of for name, size_of in UNITS.items() if name != unit}
    fitting = {name: side for name, side in fitting.items() if low <= side <= high}
    if fitting:
        best = min(fitting, key=lambda name: abs(math.log(fitting[name] / (64.0 * MM))))
        same = scale * UNITS[best] / UNITS[unit]
        advice = f"With unit='{best}' (the same as scale={same:g}) it would be {fitting[best] / MM:.4g} mm long."
    else:
        advice = "Give the unit or scale that makes it the size of a duct."
    raise GeometryError(f"{found}; a duct is {low / MM:g} to {high / MM:g} mm long. {advice}")
