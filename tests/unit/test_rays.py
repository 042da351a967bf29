"""Rays from the tip: depths against an exact ray cast and closed forms, and the light of the lamp."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from evergym.duct_models.duct import generate_duct
from evergym.duct_models.pegs import PegField, make_pegs
from evergym.envs.rendering.endoscope import TARGET_RADIUS, EndoscopeView, compute_camera
from evergym.envs.rendering.pose import Pose
from evergym.envs.rendering.ray_kernel import NOTHING, PEG, TARGET, WALL
from evergym.simulator import Contacts, Shape
from evergym.units import MM

Array = NDArray[np.float64]
SIZE = (41, 41)  # odd: there is a pixel in the middle


def make_pose(tip: Array, forward: Array, side: Array) -> Pose:
    """A straight robot of two nodes that ends at ``tip``."""
    position = np.stack([tip - 5 * MM * forward, tip])
    both = np.ones((2, 1))
    shape = Shape(position, both * forward, np.array([0.0, 5 * MM]), np.ones(2, dtype=bool), both * side)
    return Pose(shape, Contacts(np.zeros((0, 3)), np.zeros((0, 3))), 1.5 * MM, 1.0 * MM)


def make_field(z: float) -> PegField:
    """One peg across the way ahead, and the target to its side."""
    return PegField(make_pegs([(0.0, z)], radius=2.5 * MM), np.array([15.0, 0.0, 60.0]) * MM)


def read_light(view: EndoscopeView, pose: Pose) -> Array:
    """The brightness in the middle of the picture before the film curve, by channel."""
    value = view.frame(pose)[SIZE[1] // 2, SIZE[0] // 2].astype(float) / 255.0
    return -np.log(1.0 - value**2)


Z, Y, X = np.eye(3)[::-1]


@pytest.mark.parametrize(("family", "index"), [("held_out", 0), ("narrow", 1)])
def test_depths_are_those_of_an_exact_ray_cast(family: str, index: int) -> None:
    """The spline rounds the mesh's facets by some micrometres across the wall; a grazing ray makes more of it."""
    duct = generate_duct(family, index)
    view = EndoscopeView(duct)
    rng = np.random.default_rng(7)
    nodes = rng.choice(np.arange(8, len(duct.centreline.position) - 3), 4, replace=False)
    along, across = [], []
    for origin in duct.centreline.position[nodes]:
        rays = rng.normal(size=(60, 3))
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        place, ray, triangle = duct.mesh.ray.intersects_location(
            np.tile(origin, (len(rays), 1)), rays, multiple_hits=False
        )
        assert len(ray) == len(rays)
        depth, kind = view.trace(origin, rays)
        assert (kind == WALL).all()
        error = np.abs(depth[ray] - np.linalg.norm(place - origin, axis=1))
        along.append(error)
        across.append(error * np.abs(np.sum(duct.mesh.face_normals[triangle] * rays[ray], axis=1)))
    error, normal_error = np.concatenate(along) / MM, np.concatenate(across) / MM
    print(
        f"{family} {index}: depth error median {np.median(error):.4f} mm, 99 % {np.quantile(error, 0.99):.4f} mm, "
        f"largest {error.max():.3f} mm; across the wall 99 % {np.quantile(normal_error, 0.99):.4f} mm"
    )
    # As the field is held to fcl: hundredths of a millimetre across the wall, a tenth of its spacing at the median.
    assert np.median(error) < 0.01
    assert np.quantile(normal_error, 0.99) < 0.03
    assert error.max() < 0.5


def test_depth_of_peg_and_target() -> None:
    """Straight ahead the peg's surface; past it, the target's ball, unless the peg hides it."""
    field = make_field(20 * MM)
    view = EndoscopeView(field, (0.0, 0.0, 40 * MM))
    aside = np.array([4.0, 0.0, 0.0]) * MM
    to_target = np.array([0.0, 0.0, 40 * MM]) - aside
    distance = float(np.linalg.norm(to_target))
    depth, kind = view.trace(np.zeros(3), np.stack([Z, -Z, X]))
    np.testing.assert_allclose(depth[0], 17.5 * MM, rtol=1e-12)
    np.testing.assert_array_equal(kind, [PEG, NOTHING, NOTHING])
    depth, kind = view.trace(8.0 * X * MM, (to_target - 4.0 * X * MM)[None] / np.linalg.norm(to_target - 4.0 * X * MM))
    assert kind[0] == TARGET
    # The ray passes the axis x = 0 at z = 20 mm by 4 mm: not hidden by a peg of 2.5 mm.
    np.testing.assert_allclose(depth[0], math.hypot(8.0, 40.0) * MM - TARGET_RADIUS, rtol=1e-12)
    depth, kind = view.trace(aside, to_target[None] / distance)
    assert kind[0] == PEG


def test_light_falls_with_the_square_of_the_distance() -> None:
    """A peg faced at twice the distance is a quarter as bright: to the rounding of eight bits."""
    lights = []
    for distance in (20.0, 40.0):
        view = EndoscopeView(make_field((distance + 2.5) * MM), size=SIZE)
        lights.append(read_light(view, make_pose(np.zeros(3), Z, X)))
    np.testing.assert_allclose(lights[0] / lights[1], 4.0, rtol=0.05)


def test_the_tendon_is_up_and_roll_turns_the_picture() -> None:
    """A target on the tendon's side is above the middle; half a turn of the catheter puts it below."""
    view = EndoscopeView(None, (6 * MM, 0.0, 20 * MM), size=SIZE)
    upright, turned = (view.frame(make_pose(np.zeros(3), Z, sign * X)) for sign in (1.0, -1.0))
    row, column = np.argwhere(upright[..., 1] > 100).mean(axis=0)
    assert row < 15
    np.testing.assert_allclose(column, 20.0, atol=0.01)
    np.testing.assert_array_equal(turned, upright[::-1, ::-1])


def test_the_camera_turns_its_right_hand_to_the_right() -> None:
    """Right, up and back are a right-handed frame: the picture is no mirror image."""
    camera = compute_camera(make_pose(np.zeros(3), Z, Y))
    np.testing.assert_allclose(np.cross(camera[1], camera[2]), -camera[3], atol=1e-15)


def test_a_bifurcation_is_seen() -> None:
    """Before a bifurcation two lumens lie ahead, dark, with the divider between them, brighter."""
    duct = generate_duct("train", 3)
    line = duct.centreline
    fork = int(line.bifurcations[0])
    daughters = np.flatnonzero(line.parent == fork)
    apart = np.subtract(*line.position[daughters])
    back = line.path_to(fork)[np.searchsorted(line.station[line.path_to(fork)], line.station[fork] - 4 * MM)]
    forward = line.position[fork] - line.position[back]
    forward /= np.linalg.norm(forward)
    side = apart - (apart @ forward) * forward
    view = EndoscopeView(duct, size=(65, 65))
    pose = make_pose(line.position[back], forward, side / np.linalg.norm(side))
    column = view.frame(pose)[:, 32].astype(int).sum(axis=1)
    depth = view.trace(line.position[back], [forward])[0][0]
    below, above = column[32:].min(), column[:33].min()
    between = column[np.argmin(column[:33]) : 33 + np.argmin(column[32:])].max()
    print(f"brightness {above} above, {between} between, {below} below; the divider is {depth / MM:.1f} mm ahead")
    assert between > 1.3 * max(above, below)


def test_a_camera_outside_the_lumen_sees_the_wall() -> None:
    """Pressed through a soft wall the picture is all wall: no endless loop, no NaN."""
    duct = generate_duct("held_out", 0)
    image = EndoscopeView(duct, size=(9, 9)).frame(make_pose(np.array([0.0, 1.0, 0.02]), Z, X))
    assert image.min() > 60
    assert (image[..., 0] > image[..., 2]).all()
