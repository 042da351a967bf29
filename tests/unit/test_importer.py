"""A user's own mesh: read in every format, placed, its centreline found, and what does not fit refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from evergym.duct_models.centreline import Centreline
from evergym.duct_models.duct import Duct, generate_duct
from evergym.duct_models.importer import load_duct
from evergym.duct_models.port import make_pose
from evergym.duct_models.scene import WallScene
from evergym.errors import GeometryError

MM = 1e-3
BEND = 60 * MM


def make_tube(
    radius: float = 2.5 * MM, length: float = 40 * MM, *, caps: tuple[bool, bool] = (True, True)
) -> trimesh.Trimesh:
    """A tube along a bend of 60 mm radius that starts at the origin along +z; in metres, flat ends or open ones."""
    rings, sides = 81, 48
    angle = np.linspace(0.0, length / BEND, rings)
    turn = np.linspace(0.0, 2 * math.pi, sides, endpoint=False)
    middle = np.stack([BEND * (1 - np.cos(angle)), 0 * angle, BEND * np.sin(angle)], axis=1)
    across = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=1)
    up = np.array([0.0, 1.0, 0.0])
    ring = np.cos(turn)[None, :, None] * across[:, None] + np.sin(turn)[None, :, None] * up
    vertices = (middle[:, None] + radius * ring).reshape(-1, 3)
    k = np.arange(rings * sides).reshape(rings, sides)
    a, b, c, d = k[:-1], np.roll(k, -1, axis=1)[:-1], k[1:], np.roll(k, -1, axis=1)[1:]
    faces = [np.stack([a, b, d], axis=-1).reshape(-1, 3), np.stack([a, d, c], axis=-1).reshape(-1, 3)]
    points = [vertices]
    for cap, row, end in zip(caps, (k[0], k[-1][::-1]), (0, -1), strict=True):
        if cap:
            faces.append(np.stack([np.roll(row, -1), row, np.full(sides, sum(map(len, points)))], axis=1))
            points.append(middle[end][None])
    mesh = trimesh.Trimesh(np.concatenate(points), np.concatenate(faces), process=False)
    if mesh.is_watertight and mesh.volume < 0:
        mesh.invert()
    return mesh


def save(mesh: trimesh.Trimesh, path: Path, unit: float = MM) -> Path:
    scaled = mesh.copy()
    scaled.apply_scale(1.0 / unit)
    scaled.export(path)
    return path


def follow(line: Centreline) -> tuple[np.ndarray, np.ndarray]:
    """Points every 0.1 mm or so along a centreline, and the lumen radius there."""
    share = np.linspace(0.0, 1.0, 11)[:, None, None]
    children = np.arange(1, len(line.parent))
    parents = line.parent[children]
    position = line.position[parents] * (1 - share) + line.position[children] * share
    radius = line.radius[parents] * (1 - share[..., 0]) + line.radius[children] * share[..., 0]
    return position.reshape(-1, 3), radius.reshape(-1)


def put_back(duct: Duct) -> np.ndarray:
    """The centreline's nodes in the frame of the file."""
    pose = np.array(duct.metadata["pose"])
    return (duct.centreline.position - pose[:3, 3]) @ pose[:3, :3]


@pytest.mark.parametrize("index", [1, 2])
def test_a_generated_duct_comes_back(tmp_path: Path, index: int) -> None:
    known = generate_duct("train", index)
    found = load_duct(save(known.mesh, tmp_path / "duct.stl"), port=[0.0, 0.0, 0.0], direction=[0.0, 0.0, 1.0])
    assert len(found.centreline.leaves) == len(known.centreline.leaves)
    assert found.centreline.generation.max() == known.centreline.generation.max()
    points, radius = follow(known.centreline)
    gap, nearest = cKDTree(points).query(put_back(found))
    # where two lumens overlap, the middle of their union is not the axis of either: only there more than 0.5 mm
    assert np.quantile(gap, 0.95) < 0.5 * MM
    assert gap.max() < 0.8 * MM
    # ... and the other way round: nothing of the known tree is missing
    backward = cKDTree(follow(found.centreline)[0]).query(known.centreline.position)[0]
    assert np.quantile(backward, 0.95) < 0.5 * MM
    assert backward.max() < 0.8 * MM
    ratio = found.centreline.radius / radius[nearest]
    assert np.abs(ratio - 1.0).mean() < 0.04
    assert np.quantile(np.abs(ratio - 1.0), 0.9) < 0.1
    known_ends = np.sort(known.centreline.station[known.centreline.leaves])
    assert np.sort(found.centreline.station[found.centreline.leaves]) == pytest.approx(known_ends, abs=1.5 * MM)


def test_the_port_of_a_generated_duct_is_found(tmp_path: Path) -> None:
    known = generate_duct("train", 1)
    found = load_duct(save(known.mesh, tmp_path / "duct.ply"))
    pose = np.array(found.metadata["pose"])
    port = -pose[:3, :3].T @ pose[:3, 3]
    assert found.metadata["port_found"] == "inside the widest round end"
    # along the lumen a port may lie a little elsewhere, across it must be in the middle
    assert np.hypot(port[0], port[1]) < 0.2 * MM
    assert abs(port[2]) < 1.0 * MM
    assert pose[2, :3] @ [0.0, 0.0, 1.0] > math.cos(math.radians(3.0))
    assert len(found.targets) == len(known.targets)


@pytest.mark.parametrize("extension", ["stl", "obj", "ply", "glb"])
def test_every_format_gives_the_same_duct(tmp_path: Path, extension: str) -> None:
    duct = load_duct(save(make_tube(), tmp_path / f"tube.{extension}"), direction=[0.0, 0.0, 1.0], port=[0.0, 0.0, 0.0])
    assert duct.name == "tube"
    assert duct.metadata["repair"] == {"found": [], "done": [], "remains": []}
    line = duct.centreline
    # distance of each node from the known circle in the x-z plane
    off = np.hypot(np.hypot(line.position[:, 0] - BEND, line.position[:, 2]) - BEND, line.position[:, 1])
    assert off.max() < 0.2 * MM
    assert line.radius[:-1] == pytest.approx(2.5 * MM, rel=0.03)
    # the last node may lie a voxel nearer than that to the flat end
    assert 2.0 * MM < line.radius[-1] < 2.51 * MM
    assert (line.position[0] == 0.0).all()
    # the last ball touches the flat end; the voxels of 0.4 mm decide where
    assert line.station[-1] == pytest.approx(37.5 * MM, abs=0.8 * MM)
    assert len(duct.targets) == 1
    assert duct.targets[0].station == pytest.approx(line.station[-1] - 4 * MM, abs=1.1 * MM)


@pytest.mark.parametrize(("unit", "size"), [("m", 1.0), ("cm", 0.01), ("inch", 0.0254)])
def test_units_and_scale(tmp_path: Path, unit: str, size: float) -> None:
    path = save(make_tube(), tmp_path / "tube.ply", unit=size)
    duct = load_duct(path, unit=unit, scale=1.2)
    assert duct.centreline.radius[5] == pytest.approx(3.0 * MM, rel=0.03)
    assert duct.centreline.station[-1] == pytest.approx(45 * MM, abs=1.5 * MM)


def test_a_mesh_is_placed_with_its_port_at_the_origin_along_z(tmp_path: Path) -> None:
    tube = make_tube(caps=(False, True))
    pose = make_pose(np.array([5.0, -3.0, 20.0]) * MM, np.array([0.6, 0.64, -0.48]))
    tube.apply_transform(np.linalg.inv(pose))
    duct = load_duct(save(tube, tmp_path / "tube.stl"))
    assert duct.metadata["port_found"] == "the widest open end, 5.0 mm across"
    assert duct.metadata["extended_below_port"]
    assert duct.mesh.is_watertight
    back = np.array(duct.metadata["pose"]) @ np.linalg.inv(pose)
    assert np.linalg.norm(back[:3, 3]) < 0.05 * MM
    assert np.linalg.norm(put_back(duct)[0] - np.linalg.inv(pose)[:3, 3]) < 0.05 * MM
    # the first 3 mm of the bend turn by 2.9 degrees: their mean direction is half that
    assert back[2, 2] > math.cos(math.radians(3.0))
    # the robot at the port, and 3 mm below it, is well inside
    depth = WallScene(duct.mesh).distance([[0.0, 0.0, 0.0], [0.0, 0.0, -3 * MM], [0.0, 0.0, 1 * MM]])[0]
    assert depth.min() > 2.2 * MM
    assert np.isfinite(duct.field.coefficient).all()


@pytest.mark.parametrize(
    "direction", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.6, 0.64, -0.48), (0.0, 1e-9, -1.0)]
)
def test_a_pose_is_a_rigid_motion(direction: tuple[float, float, float]) -> None:
    unit = np.array(direction) / np.linalg.norm(direction)
    point = np.array([1.0, 2.0, 3.0])
    pose = make_pose(point, unit)
    assert pose[:3, :3] @ pose[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    assert pose[:3, :3] @ unit == pytest.approx([0.0, 0.0, 1.0], abs=2e-9)
    assert pose[:3, :3] @ point + pose[:3, 3] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_a_port_within_the_lumen_leaves_out_what_lies_behind(tmp_path: Path) -> None:
    path = save(make_tube(length=60 * MM), tmp_path / "tube.stl")
    angle = 20 * MM / BEND
    port = [BEND * (1 - math.cos(angle)), 0.0, BEND * math.sin(angle)]
    duct = load_duct(path, port=port)
    assert len(duct.centreline.leaves) == 1
    assert duct.centreline.station[-1] == pytest.approx(37.5 * MM, abs=0.8 * MM)
    assert not duct.metadata["extended_below_port"]
    back = load_duct(path, port=port, direction=[-math.sin(angle), 0.0, -math.cos(angle)])
    assert back.centreline.station[-1] == pytest.approx(17.5 * MM, abs=0.8 * MM)


def test_a_duct_file_names_mesh_scale_and_pose(tmp_path: Path) -> None:
    save(make_tube(), tmp_path / "tube.stl")
    file = tmp_path / "duct.toml"
    file.write_text(
        'mesh = "tube.stl"\nname = "LB-03"\nscale = 1.1\nrobot_outer_diameter_mm = 3.2\n'
        "[pose]\nport_mm = [0, 0, 0.0]\ndirection = [0, 0, 1]\nroll_deg = 90\n"
    )
    duct = load_duct(file)
    assert duct.name == "LB-03"
    assert duct.centreline.radius[5] == pytest.approx(2.75 * MM, rel=0.03)
    # the bend towards +x is turned towards +y
    assert duct.centreline.position[-1, 1] > 10 * MM
    assert abs(duct.centreline.position[-1, 0]) < 0.3 * MM
    assert duct.metadata["robot_diameter_mm"] == pytest.approx(3.2)
    assert load_duct(file, name="other", scale=1.3).centreline.radius[5] == pytest.approx(3.25 * MM, rel=0.03)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('name = "a"', "names no mesh"),
        ('mesh = "tube.stl"\nscal = 1.1', "unknown key 'scal'. Did you mean 'scale'?"),
        ('mesh = "tube.stl"\nscale = "big"', "'scale' must be a number: got 'big'"),
        ('mesh = "tube.stl"\n[pose]\nport = [0, 0, 0]', "unknown key [pose] 'port'. Did you mean 'port_mm'?"),
        ('mesh = "tube.stl"\n[pose]\nport_mm = [0, 0]', "'port_mm' must be three numbers"),
        ("mesh = ", "cannot be read as TOML"),
        ('mesh = "none.stl"', "none.stl' does not exist"),
        ('mesh = "tube.stl"\nunit = "furlong"', "no unit 'furlong'"),
        ('mesh = "tube.stl"\nscale = -1', "scale .* must be a positive number"),
    ],
)
def test_errors_in_a_duct_file(tmp_path: Path, text: str, message: str) -> None:
    save(make_tube(), tmp_path / "tube.stl")
    file = tmp_path / "duct.toml"
    file.write_text(text)
    pattern = message if ".*" in message else message.replace("[", r"\[").replace("]", r"\]").replace("?", r"\?")
    with pytest.raises(GeometryError, match=pattern):
        load_duct(file)


def test_files_that_are_no_mesh_are_refused(tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match=r"none\.stl' does not exist"):
        load_duct(tmp_path / "none.stl")
    with pytest.raises(GeometryError, match=r"none\.toml' does not exist"):
        load_duct(tmp_path / "none.toml")
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(GeometryError, match=r"'\.txt', which is not supported"):
        load_duct(tmp_path / "notes.txt")
    (tmp_path / "empty.stl").touch()
    with pytest.raises(GeometryError, match=r"is empty \(0 bytes\)"):
        load_duct(tmp_path / "empty.stl")
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(GeometryError, match="is a folder"):
        load_duct(tmp_path / "folder.stl")


@pytest.mark.parametrize("extension", ["stl", "obj", "ply", "glb"])
@pytest.mark.parametrize("content", ["Dear reader, this is a letter.\n" * 5, "solid nothing\nendsolid nothing\n"])
def test_a_text_named_like_a_mesh_is_refused(tmp_path: Path, extension: str, content: str) -> None:
    path = tmp_path / f"letter.{extension}"
    path.write_text(content)
    with pytest.raises(GeometryError, match=rf"letter\.{extension}' (cannot be read as|holds no triangles)"):
        load_duct(path)


def test_meshes_without_usable_triangles_are_refused(tmp_path: Path) -> None:
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    with pytest.raises(GeometryError, match="holds no triangles"):
        load_duct(tmp_path / "points.obj")
    (tmp_path / "one.obj").write_text("v 0 0 0\nv 50 0 0\nv 0 50 0\nf 1 2 3\n")
    with pytest.raises(GeometryError, match="1 usable triangles of 1"):
        load_duct(tmp_path / "one.obj")
    tube = make_tube()
    tube.vertices[7] = np.nan
    with pytest.raises(GeometryError, match=r"1 of \d+ vertices that are not finite"):
        load_duct(save(tube, tmp_path / "hole.ply"))


@pytest.mark.parametrize("extension", ["stl", "ply", "glb"])
def test_damaged_files_are_refused(tmp_path: Path, extension: str) -> None:
    whole = save(make_tube(), tmp_path / f"tube.{extension}").read_bytes()
    path = tmp_path / f"damaged.{extension}"
    rng = np.random.default_rng(0)
    for k in range(6):
        data = bytearray(whole)
        if k % 2:
            del data[rng.integers(1, len(data)) :]
        else:
            # the second half holds the triangles
            for place in rng.integers(len(data) // 2, len(data), 20):
                data[place] = rng.integers(256)
        path.write_bytes(bytes(data))
        with pytest.raises(GeometryError, match=r"damaged"):
            load_duct(path, port=[0.0, 0.0, 0.0])


def test_a_mistaken_unit_is_noticed(tmp_path: Path) -> None:
    metres = save(make_tube(), tmp_path / "metres.stl", unit=1.0)
    with pytest.raises(
        GeometryError, match=r"0\.03865 mm if its unit is mm; .* With unit='m' \(the same as scale=1000\)"
    ):
        load_duct(metres)
    millimetres = save(make_tube(), tmp_path / "millimetres.stl")
    with pytest.raises(GeometryError, match=r"3\.8\d+e\+04 mm if its unit is m; .* With unit='mm'"):
        load_duct(millimetres, unit="m")


def test_a_lumen_too_narrow_for_the_robot_is_refused(tmp_path: Path) -> None:
    path = save(make_tube(radius=1.425 * MM), tmp_path / "LB-03.stl")
    # an end narrower than the robot is no port, so its place is given
    with pytest.raises(GeometryError) as caught:
        load_duct(path, port=[0.0, 0.0, 0.0])
    message = str(caught.value)
    assert message.startswith("Robot does not fit duct 'LB-03' at station ")
    assert "outer diameter is 3.00 mm, the lumen is 2.8" in message  # a polygon of 48 sides: 2.84 mm
    assert "scale the mesh (scale=1.1" in message
    scale = float(message.split("(scale=")[1].split(")")[0])
    assert len(load_duct(path, port=[0.0, 0.0, 0.0], scale=scale).targets) == 1
    assert len(load_duct(path, port=[0.0, 0.0, 0.0], robot_outer_diameter=2.4 * MM).targets) == 1


def test_a_target_beyond_the_robots_reach_is_refused(tmp_path: Path) -> None:
    path = save(make_tube(length=60 * MM), tmp_path / "long.stl")
    with pytest.raises(
        GeometryError, match=r"does not reach the end of duct 'long' at station 5\d\.\d mm: it grows 30\.0 mm"
    ):
        load_duct(path, robot_reach=30 * MM)


def test_ports_that_cannot_be_are_refused(tmp_path: Path) -> None:
    path = save(make_tube(), tmp_path / "tube.stl")
    with pytest.raises(GeometryError, match=r"lies 1\d\.\d mm outside the lumen .* nearest point inside"):
        load_duct(path, port=[0.0, 15 * MM, 10 * MM])
    with pytest.raises(GeometryError, match="not all zero"):
        load_duct(path, port=[0.0, 0.0, 0.0], direction=[0.0, 0.0, 0.0])
    with pytest.raises(GeometryError, match="three finite numbers"):
        load_duct(path, port=[0.0, 0.0])
    with pytest.raises(GeometryError, match=r"No way leads into the lumen .* Choose another port"):
        load_duct(path, port=[0.0, 0.0, 0.0], direction=[0.0, 0.0, -1.0])
