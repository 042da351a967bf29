"""The centreline graph on a small Y: stem of 10 mm along z, two arms of 10 mm that run side by side, 4 mm apart."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from evergym.duct_models.centreline import Centreline, Location
from evergym.duct_models.duct import generate_duct
from evergym.errors import GeometryError
from evergym.units import MM

STEM = 10  # index of the bifurcation, 10 mm from the port
LEFT, RIGHT = 22, 34  # ends of the arms


@pytest.fixture(scope="module")
def line() -> Centreline:
    position = [(0.0, 0.0, z) for z in range(11)]
    parent = [-1, *range(10)]
    branch = [0] * 11
    for number, side in enumerate((-1.0, 1.0)):
        first = len(position)
        # 2 mm outwards, then 10 mm parallel to the other arm
        position += [(side, 0.0, 10.0), (2.0 * side, 0.0, 10.0)] + [(2.0 * side, 0.0, 10.0 + z) for z in range(1, 11)]
        parent += [STEM, *range(first, first + 11)]
        branch += [1 + number] * 12
    points = np.array(position) * MM
    station = np.zeros(len(points))
    for node in range(1, len(points)):
        station[node] = station[parent[node]] + np.linalg.norm(points[node] - points[parent[node]])
    generation = np.minimum(branch, 1)
    radius = np.linspace(4.0, 2.0, len(points)) * MM
    return Centreline(points, radius, np.array(parent), station, generation, np.array(branch))


def test_tree_is_described(line: Centreline) -> None:
    assert line.leaves.tolist() == [LEFT, RIGHT]
    assert line.bifurcations.tolist() == [STEM]
    assert line.path_to(LEFT).tolist() == list(range(23))
    assert line.path_to(RIGHT).tolist() == [*range(11), *range(23, 35)]
    assert line.turn_angle[RIGHT] == pytest.approx(np.pi)  # 90 degrees out, 90 degrees back
    with pytest.raises(ValueError, match="read-only"):
        line.position[0, 0] = 1.0


def test_locate_finds_the_nearest_place(line: Centreline) -> None:
    place = line.locate([0.3 * MM, 0.4 * MM, 4.25 * MM])
    assert place.node == 5
    assert place.fraction == pytest.approx(0.25)
    assert place.station == pytest.approx(4.25 * MM)
    assert place.offset == pytest.approx(0.5 * MM)
    assert place.branch == 0
    np.testing.assert_allclose(line.position_at(place), [0.0, 0.0, 4.25 * MM])
    assert line.radius_at(place) == pytest.approx(line.radius[4] + 0.25 * (line.radius[5] - line.radius[4]))
    np.testing.assert_allclose(line.direction_at(place), [0.0, 0.0, 1.0])
    before_port = line.locate([0.0, 0.0, -5.0 * MM])
    assert (before_port.station, before_port.offset) == (0.0, pytest.approx(5.0 * MM))


def test_a_point_behind_a_wall_stays_on_its_branch(line: Centreline) -> None:
    place = line.at(STEM)
    for z in range(11):
        place = line.locate([-2.0 * MM, 0.0, (10.0 + z) * MM], place)
    assert place.branch == 1
    # pushed across to within 1 mm of the right arm, and far from the left one
    pushed = [1.0 * MM, 0.0, 19.0 * MM]
    assert line.locate(pushed).branch == 2
    near = line.locate(pushed, place)
    assert near.branch == 1
    assert near.offset == pytest.approx(3.0 * MM)


def test_a_robot_that_backs_out_changes_branch_at_the_bifurcation(line: Centreline) -> None:
    place = line.at(LEFT)
    way = [(-2.0, z) for z in range(20, 9, -1)] + [(x, 10.0) for x in (-1.0, 0.0, 1.0, 2.0)]
    way += [(2.0, z) for z in range(11, 21)]
    for x, z in way:
        place = line.locate([x * MM, 0.0, z * MM], place)
    assert place == line.at(RIGHT)._replace(offset=place.offset)


def test_locating_step_by_step_equals_a_global_search_on_real_ways() -> None:
    line = generate_duct("true_scale_train", 0).centreline
    random = np.random.default_rng(0)
    for leaf in line.leaves:
        place: Location | None = None
        for node in line.path_to(int(leaf)):
            point = line.position[node] + random.uniform(-0.2, 0.2, 3) * MM
            place = line.locate(point, place)
            nearest = np.linalg.norm(line.position - point, axis=1).min()
            assert place.offset <= nearest + 1e-12
            assert line.locate(point).offset == pytest.approx(place.offset)


def test_distance_along_follows_the_lumen(line: Centreline) -> None:
    left, right = line.at(LEFT), line.at(RIGHT)
    assert line.distance_along(left, right) == pytest.approx(24.0 * MM)
    assert line.distance_along(right, left) == pytest.approx(24.0 * MM)
    low, high = line.locate([0.0, 0.0, 4.25 * MM]), line.locate([0.0, 0.0, 4.75 * MM])
    assert line.distance_along(low, high) == pytest.approx(0.5 * MM)
    assert line.distance_along(low, right) == pytest.approx(17.75 * MM)
    assert line.distance_along(left, left) == 0.0


def test_ahead_leads_to_the_target(line: Centreline) -> None:
    start = line.locate([0.0, 0.0, 8.5 * MM])
    points, radii = line.ahead(start, RIGHT, np.array([0.0, 1.0, 2.5, 6.5, 100.0]) * MM)
    expected = np.array([(0, 0, 8.5), (0, 0, 9.5), (1, 0, 10), (2, 0, 13), (2, 0, 20)]) * MM
    np.testing.assert_allclose(points, expected, atol=1e-15)
    assert radii[-1] == line.radius[RIGHT]
    assert radii[0] == pytest.approx(line.radius_at(start))


def test_ahead_leads_back_out_of_a_wrong_branch(line: Centreline) -> None:
    start = line.locate([-2.0 * MM, 0.0, 12.0 * MM])
    points, _ = line.ahead(start, line.at(RIGHT), np.array([0.0, 1.5, 3.0, 4.0, 5.0, 7.0]) * MM)
    expected = np.array([(-2, 0, 12), (-2, 0, 10.5), (-1, 0, 10), (0, 0, 10), (1, 0, 10), (2, 0, 11)]) * MM
    np.testing.assert_allclose(points, expected, atol=1e-15)


def test_ahead_leads_back_to_a_target_that_was_passed(line: Centreline) -> None:
    start = line.locate([0.0, 0.0, 8.0 * MM])
    points, _ = line.ahead(start, 5, np.array([0.0, 2.0, 3.0, 9.0]) * MM)
    np.testing.assert_allclose(points[:, 2], np.array([8.0, 6.0, 5.0, 5.0]) * MM, atol=1e-15)


def test_it_survives_pickling(line: Centreline) -> None:
    copy = pickle.loads(pickle.dumps(line))
    np.testing.assert_array_equal(copy.position, line.position)
    assert copy.locate([0.0, 0.0, 3.0 * MM]) == line.locate([0.0, 0.0, 3.0 * MM])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radius": [1e-3, 0.0]}, "node 1 is not usable"),
        ({"position": [[0.0, 0.0, 0.0], [0.0, 0.0, np.nan]]}, "node 1 is not usable"),
        ({"parent": [-1, 1]}, "parents must come before children"),
        ({"parent": [-1, -1]}, "only root"),
        ({"station": [0.0, 0.0]}, "station must grow"),
        ({"branch": [0]}, "its branch has shape"),
        ({"position": [[0.0, 0.0, 0.0]]}, "at least 2 nodes"),
    ],
)
def test_impossible_trees_are_refused(change: dict[str, list[float]], message: str) -> None:
    good = {
        "position": [[0.0, 0.0, 0.0], [0.0, 0.0, 1e-3]],
        "radius": [1e-3, 1e-3],
        "parent": [-1, 0],
        "station": [0.0, 1e-3],
        "generation": [0, 0],
        "branch": [0, 0],
    }
    Centreline(**{key: np.array(value) for key, value in good.items()})
    with pytest.raises(GeometryError, match=message):
        Centreline(**{key: np.array(value) for key, value in (good | change).items()})


def test_unknown_node_is_refused(line: Centreline) -> None:
    with pytest.raises(GeometryError, match="no centreline node 99"):
        line.path_to(99)
