"""Walls and fields kept on disk, under a name that holds a hash of everything they were made from.

A file that cannot be read, whatever the reason, is built again: the cache is never a source of errors. Where nothing
can be written the cache is skipped.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import platformdirs
import trimesh
from numpy.typing import NDArray

from evergym.cache import compute_source_digest
from evergym.duct_models.centreline import Centreline
from evergym.duct_models.field import WallField
from evergym.duct_models.field_build import build_wall_field
from evergym.whole_file import whole_file

__all__ = ["find_duct_cache", "load_or_build_field", "load_or_build_mesh"]

CACHE_VARIABLE = "EVERGYM_CACHE_DIR"

Arrays = dict[str, NDArray[np.generic]]


def find_duct_cache() -> Path:
    """The folder of cached walls and fields: ``$EVERGYM_CACHE_DIR/ducts``, else in the user's cache folder."""
    chosen = os.environ.get(CACHE_VARIABLE)
    return (Path(chosen) if chosen else platformdirs.user_cache_path("evergym")) / "ducts"


def load_or_build_field(mesh: trimesh.Trimesh) -> WallField:
    """The field of a mesh, from disk if it was built before.

    Args:
        mesh: Watertight mesh with outward winding [m].
    """

    def build() -> Arrays:
        field = build_wall_field(mesh)
        return {
            "coefficient": field.coefficient.astype(np.float32),  # exact: the coefficients are rounded to it
            "origin": field.origin,
            "spacing": field.spacing,
        }

    key = _hash("field_build.py", np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64))
    data = _load_or_build(f"field-{key}", ("coefficient", "origin", "spacing"), build)
    return WallField(
        np.ascontiguousarray(data["coefficient"], dtype=np.float64),
        np.ascontiguousarray(data["origin"], dtype=np.float64),
        np.ascontiguousarray(data["spacing"], dtype=np.float64),
    )


def load_or_build_mesh(centreline: Centreline, build: Callable[[Centreline], trimesh.Trimesh]) -> trimesh.Trimesh:
    """The wall mesh around a centreline, from disk if it was built before.

    Args:
        centreline: The tree.
        build: Makes the mesh.
    """

    def build_arrays() -> Arrays:
        mesh = build(centreline)
        return {
            "vertices": np.asarray(mesh.vertices, dtype=np.float64),
            "faces": np.asarray(mesh.faces, dtype=np.int32),
        }

    key = _hash("wall.py", centreline.position, centreline.radius, centreline.parent, centreline.branch)
    data = _load_or_build(f"wall-{key}", ("vertices", "faces"), build_arrays)
    return trimesh.Trimesh(data["vertices"], data["faces"].astype(np.int64), process=False)


def _load_or_build(name: str, keys: tuple[str, ...], build: Callable[[], Arrays]) -> Arrays:
    path = find_duct_cache() / f"{name}.npz"
    data = _read(path, keys)
    if data is None:
        data = build()
        _write(path, data)
    return data


def _read(path: Path, keys: tuple[str, ...]) -> Arrays | None:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return {key: stored[key] for key in keys}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _write(path: Path, data: Arrays) -> None:
    """Write a file whole, so that no process ever reads half of it; where it cannot be written, there is none."""
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as draft, draft.open("wb") as file:
            np.savez(file, **data)  # type: ignore[arg-type]  # the stub takes the names for options


def _hash(source: str, *arrays: NDArray[np.generic]) -> str:
    digest = hashlib.sha256(_source_digest(source).encode())
    for array in arrays:
        digest.update(str((array.dtype.str, array.shape)).encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


@cache
def _source_digest(source: str) -> str:
    """Version of the code that makes a kind of file: a hash of its module and of all that this imports from evergym."""
    return compute_source_digest(Path(__file__).with_name(source))
