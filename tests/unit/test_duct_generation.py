"""Ducts as they are handed out: walls, checks, the disk cache, determinism across processes, and the commands."""

from __future__ import annotations

import csv
import hashlib
import os
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from evergym.duct_models import storage
from evergym.duct_models.check import check_duct, format_report
from evergym.duct_models.commands import DuctCheck, DuctMake, DuctShow, write_duct
from evergym.duct_models.duct import Duct, generate_duct
from evergym.duct_models.field import evaluate_wall_field
from evergym.duct_models.scene import WallScene
from evergym.errors import ConfigError, GeometryError
from evergym.units import MM

NAME = "true_scale_held_out"


@pytest.fixture(scope="module")
def duct() -> Duct:
    return generate_duct(NAME, 0)


def digest(duct: Duct) -> str:
    total = hashlib.sha256()
    for array in (duct.mesh.vertices, duct.mesh.faces, duct.centreline.position, *duct.field):
        total.update(np.ascontiguousarray(array).tobytes())
    return total.hexdigest()


def test_wall_is_one_closed_surface_with_the_port_inside(duct: Duct) -> None:
    mesh = duct.mesh
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.0
    assert mesh.body_count == 1
    assert mesh.euler_number == 2  # no handles: branches do not meet again
    assert len(mesh.faces) <= 40_000
    depth = WallScene(mesh).distance([[0.0, 0.0, 0.0], [0.0, 0.0, -3.0 * MM]])[0]
    np.testing.assert_allclose(depth, duct.centreline.radius[0], atol=0.1 * MM)


def test_wall_has_the_radius_that_the_centreline_states(duct: Duct) -> None:
    line = duct.centreline
    depth = WallScene(duct.mesh).distance(line.position)[0]
    assert (depth > line.radius - 0.1 * MM).all()  # nowhere narrower
    trunk = (line.generation == 0) & (line.station < 0.6 * line.station[line.generation == 0].max())
    np.testing.assert_allclose(depth[trunk], line.radius[trunk], atol=0.1 * MM)


def test_duct_describes_itself(duct: Duct) -> None:
    data = duct.metadata
    assert (data["family"], data["index"]) == (NAME, 0)
    assert len(data["choices"]) == len(data["turn_angle_deg"]) == len(duct.targets)
    assert len({tuple(way) for way in data["choices"]}) == len(duct.targets)  # every target is another choice
    for target, way in zip(duct.targets, data["choices"], strict=True):
        assert len(way) == target.generation
        np.testing.assert_array_equal(target.position, duct.centreline.position[target.node])
        assert target.station == duct.centreline.station[target.node]


def test_check_proves_room_on_every_way(duct: Duct) -> None:
    report = check_duct(duct, 3.2 * MM)
    assert len(report.ways) == len(duct.targets)
    assert report.field_error < 0.05 * MM
    for way in report.ways:
        assert way.lumen_diameter >= 1.3 * 3.2 * MM
        assert way.bifurcation_distance >= 8.0 * MM
        assert way.separation >= 6.0 * MM
    assert duct.name in format_report(report)
    with pytest.raises(GeometryError, match=rf"Robot does not fit duct '{duct.name}' at station .* scale the mesh"):
        check_duct(duct, 6.0 * MM)
    with pytest.raises(GeometryError, match=r"3 mm is 0\.003"):
        check_duct(duct, 3.2)
    with pytest.raises(GeometryError, match="has no target"):
        check_duct(replace(duct, targets=()), 3.2 * MM)


def test_check_refuses_broken_walls(duct: Duct) -> None:
    vertices, faces = duct.mesh.vertices, duct.mesh.faces
    hole = replace(duct, mesh=trimesh.Trimesh(vertices, faces[1:], process=False))
    with pytest.raises(GeometryError, match="3 of its edges have a triangle on one side only"):
        check_duct(hole, 3.2 * MM)
    inverted = replace(duct, mesh=trimesh.Trimesh(vertices, faces[:, ::-1], process=False))
    with pytest.raises(GeometryError, match="inside out"):
        check_duct(inverted, 3.2 * MM)
    ball = trimesh.creation.icosphere(subdivisions=1, radius=1.0 * MM)
    ball.apply_translation([0.05, 0.0, 0.0])
    with pytest.raises(GeometryError, match="2 separate surfaces"):
        check_duct(replace(duct, mesh=trimesh.util.concatenate([duct.mesh, ball])), 3.2 * MM)


def test_cache_gives_the_same_bits_and_survives_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EVERGYM_CACHE_DIR", str(tmp_path))
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=3.0 * MM)
    fresh = storage.load_or_build_field(mesh)
    (file,) = (tmp_path / "ducts").iterdir()
    content = file.read_bytes()
    for damaged in (b"", b"no archive", content[: len(content) // 2]):
        file.write_bytes(damaged)
        for part, expected in zip(storage.load_or_build_field(mesh), fresh, strict=True):
            np.testing.assert_array_equal(part, expected)
        assert len(file.read_bytes()) == len(content)  # mended
    monkeypatch.setattr(storage, "build_wall_field", lambda mesh: pytest.fail("the field was built again"))
    for part, expected in zip(storage.load_or_build_field(mesh), fresh, strict=True):
        np.testing.assert_array_equal(part, expected)
    assert [path.name for path in (tmp_path / "ducts").iterdir()] == [file.name]  # no half-written files are left


def test_a_cache_that_cannot_be_written_is_skipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("EVERGYM_CACHE_DIR", str(tmp_path / "file"))
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=3.0 * MM)
    field = storage.load_or_build_field(mesh)
    assert evaluate_wall_field(field, [0.0, 0.0, 2.0 * MM])[0][0] == pytest.approx(1.0 * MM, abs=0.1 * MM)


def test_another_process_makes_the_same_bits(duct: Duct, tmp_path: Path) -> None:
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); "
        "from test_duct_generation import digest, generate_duct, NAME; print(digest(generate_duct(NAME, 0)))"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "7", "EVERGYM_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code, str(Path(__file__).parent)],
        env=environment, capture_output=True, text=True, check=True, timeout=600,
    )  # fmt: skip
    assert done.stdout.strip() == digest(duct)


def test_duct_survives_pickling(duct: Duct) -> None:
    assert digest(pickle.loads(pickle.dumps(duct))) == digest(duct)


def test_make_writes_and_does_not_overwrite(duct: Duct, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert DuctMake(family=NAME, out=tmp_path, mesh_format="stl").run() == 0
    home = tmp_path / duct.name
    assert capsys.readouterr().out.strip() == str(home / "duct.toml")
    wall = trimesh.load_mesh(home / "wall.stl")
    assert wall.is_watertight
    np.testing.assert_allclose(wall.bounds, duct.mesh.bounds / MM, atol=1e-3)
    with (home / "centreline.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(duct.centreline.position)
    assert [int(row["node"]) for row in rows if row["target"] == "1"] == [target.node for target in duct.targets]
    before = (home / "wall.stl").read_bytes()
    with pytest.raises(ConfigError, match="is there already"):
        write_duct(duct, tmp_path, "stl")
    assert (home / "wall.stl").read_bytes() == before
    assert DuctMake(family=NAME, out=tmp_path, mesh_format="stl", overwrite=True).run() == 0
    with pytest.raises(ConfigError, match="cannot be written as 'step'"):
        DuctMake(mesh_format="step").run()
    with pytest.raises(ConfigError, match="1 or more: got 0"):
        DuctMake(count=0).run()


def test_check_prints_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert DuctCheck(f"{NAME}:0").run() == 0
    assert "station_mm" in capsys.readouterr().out
    with pytest.raises(GeometryError, match="Robot does not fit"):
        DuctCheck(f"{NAME}:0", robot_diameter_mm=6.0).run()
    with pytest.raises(GeometryError, match="meshes of your own"):
        DuctCheck(f"{NAME}:0", scale=2.0).run()
    with pytest.raises(ConfigError, match="no duct family"):
        DuctCheck("nowhere:0").run()


def test_show_draws_without_a_display(tmp_path: Path) -> None:
    picture = tmp_path / "duct.png"
    assert DuctShow(f"{NAME}:0", out=picture).run() == 0
    assert picture.read_bytes()[:4] == b"\x89PNG"
    with pytest.raises(ConfigError, match="is there already"):
        DuctShow(f"{NAME}:0", out=picture).run()
    with pytest.raises(ConfigError, match=r"must be a \.png file"):
        DuctShow(f"{NAME}:0", out=tmp_path / "duct.jpg").run()
    with pytest.raises(ConfigError, match="There is no folder"):
        DuctShow(f"{NAME}:0", out=tmp_path / "nowhere" / "duct.png").run()
