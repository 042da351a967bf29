"""The wall field is held to python-fcl, to VTK as an independent judge, and to closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import pyvista
import trimesh

from evergym.duct_models.check import check_duct, find_smooth_points
from evergym.duct_models.duct import Duct, generate_duct
from evergym.duct_models.field import WallField, compute_wall_distance, evaluate_wall_field
from evergym.duct_models.field_build import build_wall_field
from evergym.duct_models.scene import WallScene
from evergym.errors import GeometryError
from evergym.units import MM


@pytest.fixture(scope="module")
def duct() -> Duct:
    return generate_duct("held_out", 1)


@pytest.fixture(scope="module")
def scene(duct: Duct) -> WallScene:
    return WallScene(duct.mesh)


@pytest.fixture(scope="module")
def probes(duct: Duct) -> np.ndarray:
    """Points up to 2 mm from the wall on either side."""
    points, faces = trimesh.sample.sample_surface(duct.mesh, 2500, seed=1)
    depth = np.random.default_rng(1).uniform(-2.0 * MM, 2.0 * MM, len(points))
    return points - depth[:, None] * duct.mesh.face_normals[faces]


def test_fcl_agrees_with_an_independent_judge(duct: Duct, scene: WallScene, probes: np.ndarray) -> None:
    # VTK in millimetres: both answers are exact point-triangle distances, so only rounding may differ
    wall = pyvista.make_tri_mesh(duct.mesh.vertices / MM, duct.mesh.faces)
    judged = pyvista.PolyData(probes / MM).compute_implicit_distance(wall)["implicit_distance"]
    exact, normal = scene.distance(probes)
    np.testing.assert_allclose(exact / MM, -judged, atol=1e-4)  # VTK computes in single precision
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, atol=1e-12)


def test_field_is_held_to_fcl(duct: Duct, scene: WallScene, probes: np.ndarray) -> None:
    smooth = find_smooth_points(scene, probes)
    # The rest lies at medial axes, where the distance itself has a kink: the centre of every lumen narrower than 4 mm
    # and the tissue between neighbours.
    assert smooth.mean() > 0.6
    exact, normal = scene.distance(probes[smooth])
    value, gradient = evaluate_wall_field(duct.field, probes[smooth])
    assert np.abs(value - exact).max() < 0.05 * MM
    clear = np.abs(exact) > 0.05 * MM
    assert (np.sign(value) == np.sign(exact))[clear].all()
    cosine = np.sum(gradient * normal, axis=1) / np.linalg.norm(gradient, axis=1)
    angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    # facets of 0.5 mm on a lumen of 2 mm radius meet at 14 degrees, which the field rounds and fcl does not
    assert np.median(angle) < 3.0
    assert np.percentile(angle, 99.0) < 10.0
    assert angle.max() < 20.0


def test_sign_is_right_everywhere(duct: Duct, scene: WallScene) -> None:
    lower, upper = duct.mesh.bounds
    points = np.random.default_rng(2).uniform(lower - 2.0 * MM, upper + 2.0 * MM, (3000, 3))
    wall = pyvista.make_tri_mesh(duct.mesh.vertices / MM, duct.mesh.faces)
    judged = -pyvista.PolyData(points / MM).compute_implicit_distance(wall)["implicit_distance"] * MM
    value, _ = evaluate_wall_field(duct.field, points)
    clear = np.abs(judged) > 0.25 * MM  # half a grid cell: thinner tissue than that is not resolved at its kink
    assert np.count_nonzero(clear & (judged > 0.0)) > 100
    assert (np.sign(value) == np.sign(judged))[clear].all()
    # Beyond the band the field need not be exact, but must not be misleading: a millimetre, or a tenth of the distance.
    assert (np.abs(value - judged) < np.maximum(0.25 * MM, 0.1 * np.abs(judged))).all()


def test_derivatives_are_those_of_the_value(duct: Duct, probes: np.ndarray) -> None:
    gradient, hessian, other = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    low, high = np.empty(3), np.empty(3)
    step = 1e-3 * MM
    for point in probes[:200]:
        compute_wall_distance(duct.field, point, gradient, hessian)
        for axis in range(3):
            offset = np.zeros(3)
            offset[axis] = step
            value_high = compute_wall_distance(duct.field, point + offset, high, other)
            value_low = compute_wall_distance(duct.field, point - offset, low, other)
            # the third derivative jumps at cell faces: errors of order step / spacing = 0.002 of the curvature there
            assert (value_high - value_low) / (2.0 * step) == pytest.approx(gradient[axis], abs=1e-4)
            same_cell = _cell(duct.field, point + offset) == _cell(duct.field, point - offset)
            if same_cell:
                np.testing.assert_allclose((high - low) / (2.0 * step), hessian[axis], atol=1e-6 / MM)
        np.testing.assert_array_equal(hessian, hessian.T)


def _cell(field: WallField, point: np.ndarray) -> tuple[int, ...]:
    return tuple(int(x) for x in np.floor((point - field.origin) / field.spacing + 0.5))


def test_value_and_gradient_are_continuous_across_cells(duct: Duct, probes: np.ndarray) -> None:
    field = duct.field
    faces = np.floor((probes - field.origin) / field.spacing) + 0.5  # where the stencil changes
    points = probes.copy()
    points[:, 0] = field.origin[0] + faces[:, 0] * field.spacing
    jump = np.array([1e-9 * MM, 0.0, 0.0])
    before, slope_before = evaluate_wall_field(field, points - jump)
    after, slope_after = evaluate_wall_field(field, points + jump)
    assert np.abs(after - before).max() < 1e-8 * MM
    assert np.abs(slope_after - slope_before).max() < 1e-6


def test_outside_the_grid_the_distance_leads_back(duct: Duct) -> None:
    field = duct.field
    size = (np.array(field.coefficient.shape) - 1) * field.spacing
    centre = field.origin + 0.5 * size
    random = np.random.default_rng(3)
    direction = random.normal(size=(200, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    far = centre + 2.0 * size.max() * direction
    farther = centre + 1e3 * direction
    value, gradient = evaluate_wall_field(field, far)
    assert np.isfinite(evaluate_wall_field(field, farther)[0]).all()
    assert (evaluate_wall_field(field, farther)[0] < value).all()
    assert (value < 0.0).all()
    assert (np.sum(gradient * direction, axis=1) < 0.0).all()
    # continuous at the border, which for the spline is one node inside the grid
    edge = field.origin + field.spacing + random.uniform(size=(200, 3)) * (size - 2.0 * field.spacing)
    edge[:, 2] = field.origin[2] + field.spacing
    below, above = (evaluate_wall_field(field, edge + np.array([0.0, 0.0, dz * MM]))[0] for dz in (-1e-6, 1e-6))
    np.testing.assert_allclose(below, above, atol=1e-5 * MM)


def test_a_point_that_is_no_number_gives_no_number(duct: Duct) -> None:
    gradient, hessian = np.empty(3), np.empty((3, 3))
    for axis in range(3):
        point = np.zeros(3)
        point[axis] = np.nan
        assert np.isnan(compute_wall_distance(duct.field, point, gradient, hessian))
    assert compute_wall_distance(duct.field, np.array([0.0, np.inf, 0.0]), gradient, hessian) == -np.inf


def test_sphere_has_its_closed_form() -> None:
    radius = 5.0 * MM
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=radius)  # facets lie up to 3 um inside the sphere
    field = build_wall_field(mesh)
    random = np.random.default_rng(4)
    direction = random.normal(size=(300, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    distance = random.uniform(3.0 * MM, 6.5 * MM, 300)
    value, gradient = evaluate_wall_field(field, distance[:, None] * direction)
    np.testing.assert_allclose(value, radius - distance, atol=0.01 * MM)
    np.testing.assert_allclose(gradient, -direction, atol=0.02)
    bend, other = np.empty((3, 3)), np.empty(3)
    share = []
    for r, unit in zip(distance, direction, strict=True):
        compute_wall_distance(field, r * unit, other, bend)
        share.append(np.trace(bend) / (-2.0 / r))  # principal curvatures -1/r twice, and 0 along the normal
    # A quadratic's second derivative is constant in a cell, and the facets' own bend shows in single cells; the mean
    # over cells is the sphere's.
    assert np.mean(share) == pytest.approx(1.0, abs=0.05)
    assert min(share) > 0.3


def test_dent_that_the_centreline_does_not_know_is_felt(duct: Duct) -> None:
    target = duct.targets[0]
    line = duct.centreline
    node = int(line.path_to(target.node)[-6])
    # push the wall inwards around one of its points by three quarters of the lumen radius
    wall_point = duct.mesh.vertices[np.argmin(np.linalg.norm(duct.mesh.vertices - line.position[node], axis=1))]
    inwards = line.position[node] - wall_point
    inwards /= np.linalg.norm(inwards)
    depth = 1.5 * line.radius[node]
    gap = np.linalg.norm(duct.mesh.vertices - wall_point, axis=1)
    shape = np.exp(-((gap / (1.2 * MM)) ** 2))
    mesh = trimesh.Trimesh(duct.mesh.vertices + depth * shape[:, None] * inwards, duct.mesh.faces.copy(), process=False)
    dented = replace(duct, name="dented", mesh=mesh)
    inside = wall_point + 0.5 * MM * inwards
    assert evaluate_wall_field(duct.field, inside)[0][0] > 0.4 * MM
    assert evaluate_wall_field(dented.field, inside)[0][0] < 0.0
    check_duct(duct, 3.0 * MM)
    with pytest.raises(
        GeometryError, match=r"Robot does not fit duct 'dented' at station .* mm: outer diameter is 3.00"
    ):
        check_duct(dented, 3.0 * MM)


def test_open_mesh_is_refused(duct: Duct) -> None:
    mesh = trimesh.Trimesh(duct.mesh.vertices, duct.mesh.faces[1:], process=False)
    with pytest.raises(GeometryError, match="needs a closed mesh"):
        build_wall_field(mesh)


def test_mesh_in_the_wrong_unit_is_refused() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=5.0)  # 5 m instead of 5 mm
    with pytest.raises(GeometryError, match=r"Check the mesh's unit \(scale=\.\.\.\)"):
        build_wall_field(mesh)
