"""Broken meshes: each fault is found, mended where that is safe, and otherwise named with its place."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh

from evergym.duct_models.importer import load_duct
from evergym.duct_models.lumen_voxels import voxelise
from evergym.duct_models.repair import repair_mesh
from evergym.duct_models.self_intersection import find_self_intersections
from evergym.errors import GeometryError

MM = 1e-3


def make_tube(radius: float = 2.5 * MM, length: float = 40 * MM, sections: int = 32) -> trimesh.Trimesh:
    """A straight closed tube along z, its lower end at the origin, of small triangles."""
    line = np.stack([np.r_[0.0, np.full(41, radius), 0.0], np.r_[0.0, np.linspace(0.0, length, 41), length]], axis=1)
    return trimesh.creation.revolve(line, sections=sections)


def without(mesh: trimesh.Trimesh, faces: np.ndarray) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, np.delete(mesh.faces, faces, axis=0), process=False)


def near(mesh: trimesh.Trimesh, point: list[float], reach: float) -> np.ndarray:
    return np.flatnonzero(np.linalg.norm(mesh.triangles_center - point, axis=1) < reach)


def test_a_good_mesh_is_left_alone() -> None:
    tube = make_tube()
    mended, report = repair_mesh(tube, "tube")
    assert report.is_clean
    assert str(report) == "tube: nothing to repair"
    assert mended.volume == pytest.approx(tube.volume, rel=1e-12)
    assert len(mended.faces) == len(tube.faces)


def test_unmerged_vertices_are_no_fault() -> None:
    tube = make_tube()
    soup = trimesh.Trimesh(tube.triangles.reshape(-1, 3), np.arange(3 * len(tube.faces)).reshape(-1, 3), process=False)
    mended, report = repair_mesh(soup, "soup")
    assert report.is_clean
    assert mended.is_watertight


def test_open_seams_are_closed() -> None:
    tube = make_tube()
    # every triangle's corners apart and rounded differently, as patches written with few digits are
    noise = np.random.default_rng(0).uniform(-1e-6, 1e-6, (3 * len(tube.faces), 3))
    soup = trimesh.Trimesh(
        tube.triangles.reshape(-1, 3) + 2e-6 + noise, np.arange(3 * len(tube.faces)).reshape(-1, 3), process=False
    )
    mended, report = repair_mesh(soup, "soup")
    assert "closed the seams" in report.done
    assert mended.is_watertight
    assert mended.volume == pytest.approx(tube.volume, rel=1e-3)


def test_inverted_normals_are_turned() -> None:
    tube = make_tube()
    tube.invert()
    mended, report = repair_mesh(tube, "tube")
    assert mended.volume > 0.0
    assert report.done == ["turned the normals outwards"]


def test_mixed_winding_is_made_consistent() -> None:
    tube = make_tube()
    faces = np.array(tube.faces)
    faces[::3] = faces[::3, ::-1]
    mended, report = repair_mesh(trimesh.Trimesh(tube.vertices, faces, process=False), "tube")
    assert mended.is_watertight
    assert mended.volume == pytest.approx(tube.volume, rel=1e-9)
    assert "neighbouring faces with opposite winding" in report.found


def test_duplicate_and_degenerate_faces_are_dropped() -> None:
    tube = make_tube()
    extra = np.vstack([tube.faces, tube.faces[10:15], tube.faces[20:22, ::-1], [[3, 3, 5], [7, 9, 9]]])
    mended, report = repair_mesh(trimesh.Trimesh(tube.vertices, extra, process=False), "tube")
    assert report.found == ["2 degenerate faces", "7 duplicate faces"]
    assert len(mended.faces) == len(tube.faces)
    assert mended.volume == pytest.approx(tube.volume, rel=1e-12)


def test_a_hole_in_the_wall_is_closed() -> None:
    tube = make_tube()
    holed = without(tube, near(tube, [2.5 * MM, 0.0, 20 * MM], 1.2 * MM))
    assert not holed.is_watertight
    mended, report = repair_mesh(holed, "tube")
    assert mended.is_watertight
    assert mended.volume == pytest.approx(tube.volume, rel=0.01)
    assert not report.openings
    assert len(report.found) == 1
    assert "a hole of" in report.found[0]
    assert "20.0) mm" in report.found[0]
    assert len(find_self_intersections(mended)) == 0


def test_cut_ends_are_closed_flat_and_offered_as_ports() -> None:
    tube = make_tube()
    open_tube = without(tube, np.flatnonzero(np.abs(tube.face_normals[:, 2]) > 0.99))
    mended, report = repair_mesh(open_tube, "tube")
    assert mended.is_watertight
    assert mended.volume == pytest.approx(tube.volume, rel=1e-9)
    assert len(report.openings) == 2
    low = min(report.openings, key=lambda opening: opening.centre[2])
    assert low.centre == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert low.inward == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    # a polygon of 32 sides has 0.6 % less area than its circle
    assert low.radius == pytest.approx(2.5 * MM, rel=0.004)


def test_a_large_ragged_hole_is_refused_with_its_place() -> None:
    tube = make_tube(radius=5 * MM)
    ragged = without(
        tube, np.flatnonzero((tube.triangles_center[:, 0] > 0.0) & (tube.triangles_center[:, 2] > 15 * MM))
    )
    with pytest.raises(GeometryError, match=r"is not closed after the repair: \d+ open edges around \(.*\) mm"):
        repair_mesh(ragged, "tube")


def test_debris_is_dropped_and_named() -> None:
    tube = make_tube()
    crumb = trimesh.creation.icosphere(radius=0.6 * MM)
    crumb.apply_translation([12 * MM, 0.0, 30 * MM])
    mended, report = repair_mesh(trimesh.util.concatenate([crumb, tube]), "tube")
    assert mended.volume == pytest.approx(tube.volume, rel=1e-12)
    assert report.found == ["2 bodies"]
    assert len(report.done) == 1
    assert report.done[0].startswith("dropped a body of 1.2 x 1.2 x 1.2 mm")
    assert "at (12.0, 0.0, 30.0) mm" in report.done[0]


def test_overlapping_bodies_are_united() -> None:
    one, two = make_tube(), make_tube()
    two.apply_transform(trimesh.transformations.rotation_matrix(0.4, [1.0, 0.0, 0.0]))
    two.apply_translation([0.0, 0.0, 20 * MM])
    mended, report = repair_mesh(trimesh.util.concatenate([one, two]), "tubes")
    assert report.done == ["united 2 overlapping bodies"]
    assert mended.is_watertight
    assert mended.body_count == 1
    # more than one, less than both together
    assert 1.3 * one.volume < mended.volume < 1.98 * one.volume


@pytest.mark.parametrize("inverted", [True, False])
def test_the_lumen_is_taken_out_of_its_block(inverted: bool) -> None:
    lumen = make_tube()
    block = trimesh.creation.box(bounds=[[-8 * MM, -8 * MM, -5 * MM], [8 * MM, 8 * MM, 45 * MM]])
    inner = lumen.copy()
    if inverted:
        inner.invert()
    mended, report = repair_mesh(trimesh.util.concatenate([block, inner]), "block")
    assert mended.volume == pytest.approx(lumen.volume, rel=1e-12)
    assert report.done[0].startswith("dropped a block of 16.0 x 16.0 x 50.0 mm")


def make_crossing() -> trimesh.Trimesh:
    """One body that runs through itself: a tube along a loop whose ends cross."""
    turn = np.linspace(0.0, 2 * math.pi + 0.6, 140)
    middle = 20 * MM * np.stack([np.cos(turn), np.sin(turn), 0.02 * turn], axis=1)
    tangent = np.gradient(middle, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, tangent)
    angle = np.linspace(0.0, 2 * math.pi, 24, endpoint=False)
    ring = np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * up[:, None]
    k = np.arange(140 * 24).reshape(140, 24)
    a, b, c, d = k[:-1], np.roll(k, -1, axis=1)[:-1], k[1:], np.roll(k, -1, axis=1)[1:]
    faces = [np.stack([a, b, d], axis=-1).reshape(-1, 3), np.stack([a, d, c], axis=-1).reshape(-1, 3)]
    for row, centre in ((k[0][::-1], 140 * 24), (k[-1], 140 * 24 + 1)):
        faces.append(np.stack([row, np.roll(row, -1), np.full(24, centre)], axis=1))
    points = np.vstack([(middle[:, None] + 2.5 * MM * ring).reshape(-1, 3), middle[[0, -1]]])
    return trimesh.Trimesh(points, np.concatenate(faces), process=False)


def test_a_mesh_that_runs_through_itself_is_refused_with_the_place(tmp_path: Path) -> None:
    crossing = make_crossing()
    assert crossing.is_watertight
    crossing.apply_scale(1000.0)
    crossing.export(tmp_path / "loop.stl")
    with pytest.raises(
        GeometryError, match=r"Mesh 'loop.stl' intersects itself: \d+ triangles around \(1\d\.\d"
    ) as caught:
        load_duct(tmp_path / "loop.stl")
    assert "boolean union" in str(caught.value)


def test_a_small_fold_is_mended() -> None:
    tube = make_tube(radius=4 * MM)
    vertices = np.array(tube.vertices)
    patch = np.linalg.norm(vertices - [4 * MM, 0.0, 20 * MM], axis=1) < 1.5 * MM
    vertices[patch] += np.random.default_rng(3).uniform(-2.0, 2.0, (patch.sum(), 3)) * MM
    folded = trimesh.Trimesh(vertices, tube.faces, process=False)
    assert len(find_self_intersections(folded)) > 0
    mended, report = repair_mesh(folded, "tube")
    assert mended.is_watertight
    assert len(find_self_intersections(mended)) == 0
    assert mended.volume == pytest.approx(tube.volume, rel=0.01)
    assert "replaced the intersecting triangles" in report.done


def test_everything_at_once_still_gives_a_duct(tmp_path: Path) -> None:
    tube = make_tube()
    tube = without(tube, near(tube, [0.0, 2.5 * MM, 30 * MM], 1.0 * MM))
    tube = without(tube, np.flatnonzero(tube.face_normals[:, 2] < -0.99))
    crumb = trimesh.creation.icosphere(radius=0.5 * MM)
    crumb.apply_translation([9 * MM, 0.0, 0.0])
    mess = trimesh.util.concatenate([crumb, tube])
    mess = trimesh.Trimesh(mess.vertices, np.vstack([mess.faces, mess.faces[:9]])[:, ::-1], process=False)
    mess.apply_scale(1000.0)
    mess.export(tmp_path / "mess.obj")
    duct = load_duct(tmp_path / "mess.obj")
    assert duct.metadata["port_found"].startswith("the widest open end, 5.0 mm")
    # the last node may lie a little nearer than that to the end
    assert duct.centreline.radius[:-1] == pytest.approx(2.5 * MM, rel=0.1)
    assert np.abs(duct.centreline.position[:, :2]).max() < 0.2 * MM
    assert len(duct.metadata["repair"]["found"]) >= 4
    assert len(duct.targets) == 1


def test_voxels_fill_the_lumen() -> None:
    tube = make_tube(radius=3 * MM, length=30 * MM, sections=96)
    voxels = voxelise(tube)
    # 75 layers along the tube, of which one may be counted too much or too little
    assert len(voxels.depth) * voxels.spacing**3 == pytest.approx(tube.volume, rel=0.02)
    radius = np.hypot(voxels.centre[:, 0], voxels.centre[:, 1])
    expected = np.minimum(3 * MM - radius, np.minimum(voxels.centre[:, 2], 30 * MM - voxels.centre[:, 2]))
    # depth counts from voxel centres
    assert np.abs(voxels.depth - expected).max() < 0.6 * voxels.spacing
    assert radius.max() < 3 * MM
