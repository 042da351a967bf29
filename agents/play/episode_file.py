"""Episodes on disk: one compressed file with the place, the poses and the readings; nothing else is needed to see it.

The format is numpy's ``.npz`` without pickles. ``heading`` is JSON; what has another length in every frame (nodes of
the shape, contacts) is laid end to end, with the lengths beside it. Poses are stored in single precision: 0.01 um.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import json
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from evergym.agents.play.episode import COLUMNS, Episode, Frame, Heading
from evergym.agents.suggest import suggest
from evergym.duct_models.centreline import Centreline
from evergym.duct_models.duct import Duct, make_targets
from evergym.duct_models.pegs import PegField
from evergym.envs.rendering.pose import Pose
from evergym.errors import EvergymError, RunError
from evergym.simulator import Contacts, Shape
from evergym.whole_file import write_whole

__all__ = ["SUFFIX", "check_folder", "find_episodes", "read_episode", "write_episode"]

Arrays = dict[str, NDArray[Any]]

SCHEMA = 1
SUFFIX = ".episode.npz"
"""How the files' names end."""

_LINE = ("position", "radius", "parent", "station", "generation", "branch")


def check_folder(folder: Path) -> None:
    """Check that episodes can be saved in a folder, and leave everything as it was.

    Raises:
        RunError: it is a file, or it cannot be made or written to.
    """
    made: list[Path] = []
    try:
        if folder.exists() and not folder.is_dir():
            raise RunError(f"--folder '{folder}' is a file. Choose a folder.")
        made = [part for part in (folder, *folder.parents) if not part.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise RunError(
            f"No episodes can be saved in --folder '{folder}': {error.strerror}. Choose another folder."
        ) from None
    finally:
        for part in made:
            with contextlib.suppress(OSError):
                part.rmdir()


def write_episode(episode: Episode, path: Path) -> Path:
    """Write an episode; the file appears whole or not at all, and one that is there is not overwritten.

    Raises:
        RunError: there is nothing to write, the file exists, or the folder cannot be written to.
    """
    if not episode.frames:
        raise RunError("The episode has no frames yet, so there is nothing to save.")
    if path.exists():
        raise RunError(f"'{path}' exists already and is not overwritten. Choose another file.")
    heading = {"schema": SCHEMA, **dataclasses.asdict(episode.heading)}
    arrays: Arrays = {"heading": np.array(json.dumps(heading)), "columns": np.array(COLUMNS)}
    arrays["target"], arrays["way"] = np.array(episode.target), episode.way
    arrays.update(_pack_scene(episode.scene))
    arrays.update(_pack_frames(episode.frames))
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, buffer.getvalue())
    except OSError as error:
        raise RunError(f"The episode cannot be written to '{path}': {error.strerror}.") from None
    return path


def read_episode(path: Path) -> Episode:
    """Read an episode.

    Raises:
        RunError: there is no such file, it is no episode, it is damaged, or it is of a later version.
    """
    if not path.is_file():
        near = [item.name for item in path.parent.glob(f"*{SUFFIX}")] if path.parent.is_dir() else []
        hint = suggest(path.name, near) if near else "."
        raise RunError(f"There is no episode '{path}'{hint}")
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays: Arrays = {name: stored[name] for name in stored.files}
        heading = json.loads(str(arrays["heading"]))
        schema = heading.pop("schema")
        if schema != SCHEMA:
            raise RunError(
                f"'{path}' has version {schema} of the episode format; this program reads {SCHEMA}. Update evergym."
            )
        frames = _unpack_frames(arrays)
        return Episode(
            heading=Heading(**heading),
            scene=_unpack_scene(arrays, str(heading["anatomy"])),
            target=tuple(arrays["target"].tolist()),
            way=arrays["way"],
            frames=frames,
        )
    except RunError:
        raise
    except (OSError, ValueError, KeyError, IndexError, TypeError, EOFError, zipfile.BadZipFile, EvergymError) as error:
        raise RunError(
            f"'{path}' is not an episode, or it is damaged. Episodes are written by `evergym play` and "
            "`evergym replay --save`."
        ) from error


def find_episodes(folder: Path) -> tuple[Path, ...]:
    """Return the episodes in a folder or in ``episodes/`` within it, newest first."""
    found = [*folder.glob(f"*{SUFFIX}"), *folder.glob(f"episodes/*{SUFFIX}")]
    return tuple(sorted(found, key=lambda path: (path.stat().st_mtime, path.name), reverse=True))


def _pack_scene(scene: Duct | PegField) -> Arrays:
    if isinstance(scene, Duct):
        line = scene.centreline
        return {
            "mesh_vertices": np.asarray(scene.mesh.vertices, dtype=np.float64),  # exact: the wall field is found by it
            "mesh_faces": np.asarray(scene.mesh.faces, dtype=np.int32),
            "target_nodes": np.array([target.node for target in scene.targets], dtype=np.int64),
            **{f"line_{name}": np.asarray(getattr(line, name)) for name in _LINE},
        }
    return {
        "pegs": np.asarray(scene.pegs),
        "bounds": np.asarray(scene.bounds),
        "room": np.array([scene.robot_diameter, scene.clearance]),
    }


def _unpack_scene(arrays: Arrays, name: str) -> Duct | PegField:
    if "pegs" in arrays:
        diameter, clearance = arrays["room"].tolist()
        return PegField(
            arrays["pegs"],
            arrays["target"],
            name=name,
            bounds=arrays["bounds"],
            robot_diameter=diameter,
            clearance=clearance,
        )
    line = Centreline(*(arrays[f"line_{name}"] for name in _LINE))
    mesh = trimesh.Trimesh(arrays["mesh_vertices"], arrays["mesh_faces"], process=False)
    return Duct(name=name, mesh=mesh, centreline=line, targets=make_targets(line, arrays["target_nodes"]))


def _pack_frames(frames: Any) -> Arrays:
    shapes = [frame.pose.shape for frame in frames]
    contacts = [frame.pose.contacts for frame in frames]
    arrays: Arrays = {
        "table": np.array([[frame.values[name] for name in COLUMNS] for frame in frames]),
        "radii": np.array([frames[0].pose.sheath_radius, frames[0].pose.catheter_radius]),
        "node_count": np.array([len(shape.position) for shape in shapes], dtype=np.int32),
        "contact_number": np.array([len(contact.position) for contact in contacts], dtype=np.int32),
    }
    for name in Shape._fields:
        kind = np.bool_ if name == "in_sheath" else np.float32
        arrays[f"shape_{name}"] = np.concatenate([getattr(shape, name) for shape in shapes]).astype(kind)
    for name in Contacts._fields:
        arrays[f"contact_{name}"] = np.concatenate([getattr(contact, name) for contact in contacts]).astype(np.float32)
    return arrays


def _unpack_frames(arrays: Arrays) -> tuple[Frame, ...]:
    columns = [str(name) for name in arrays["columns"]]
    nodes = np.concatenate(([0], np.cumsum(arrays["node_count"])))
    touches = np.concatenate(([0], np.cumsum(arrays["contact_number"])))
    sheath, catheter = arrays["radii"].tolist()
    kept: Arrays = {
        name: array if array.dtype == np.bool_ else array.astype(np.float64)
        for name, array in arrays.items()
        if name.startswith(("shape_", "contact_")) and name != "contact_number"
    }
    frames = []
    for number, row in enumerate(arrays["table"]):
        some = slice(nodes[number], nodes[number + 1])
        touching = slice(touches[number], touches[number + 1])
        shape = Shape(*(kept[f"shape_{name}"][some] for name in Shape._fields))
        contacts = Contacts(*(kept[f"contact_{name}"][touching] for name in Contacts._fields))
        values = dict.fromkeys(COLUMNS, float("nan")) | dict(zip(columns, row.tolist(), strict=True))
        frames.append(Frame(Pose(shape, contacts, sheath, catheter), values))
    return tuple(frames)
