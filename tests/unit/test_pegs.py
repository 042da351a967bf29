"""Peg fields: distances against fcl, ways against a grid search, seeds, and a user's own file."""

from __future__ import annotations

import math
import pickle
from pathlib import Path

import fcl
import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from evergym.duct_models.peg_family import PEG_FAMILIES, find_straight_approach, generate_pegs, random_pegs, trace_arc
from evergym.duct_models.pegs import (
    PAPER_PLAN,
    PAPER_TARGETS,
    PegField,
    compute_peg_distance,
    make_pegs,
    paper_pegs,
    read_pegs,
)
from evergym.errors import GeometryError

MM = 1e-3


def make_field(count: int, seed: int) -> PegField:
    """A field of pegs anywhere (some too close for the robot to pass between them) whose ends are free."""
    rng = np.random.default_rng(seed)
    target = np.array([4.0, 1.0, 50.0]) * MM
    plan: list[np.ndarray] = []
    while len(plan) < count:
        peg = rng.uniform([-12.0, 8.0], [12.0, 44.0]) * MM
        if math.hypot(*peg) > 5 * MM and math.hypot(*(peg - target[[0, 2]])) > 5 * MM:
            plan.append(peg)
    return PegField(make_pegs(plan, rng.uniform(1.0, 3.0, count) * MM), target)


def search_grid(field: PegField, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Lengths to the target from the free points of a grid in plan, over straight steps of up to five cells
    (Dijkstra)."""
    x = np.arange(-24 * MM, 24 * MM, spacing) + field.target[0] % spacing
    z = np.arange(-6 * MM, 56 * MM, spacing) + field.target[2] % spacing
    grid = np.stack(np.meshgrid(x, z, indexing="ij"), axis=-1)
    gap = np.hypot(*(grid[:, :, None] - field.graph.centre).transpose(3, 0, 1, 2)) - field.graph.radius
    free = (gap >= 0.0).all(axis=-1)
    index = np.arange(free.size).reshape(free.shape)
    rows, columns, lengths = [], [], []
    for i in range(-5, 6):
        for j in range(-5, 6):
            if math.gcd(i, j) != 1:
                continue
            here = (slice(max(0, -i), free.shape[0] - max(0, i)), slice(max(0, -j), free.shape[1] - max(0, j)))
            there = (slice(max(0, i), free.shape[0] - max(0, -i)), slice(max(0, j), free.shape[1] - max(0, -j)))
            ok = free[here] & free[there]
            rows.append(index[here][ok])
            columns.append(index[there][ok])
            lengths.append(np.full(ok.sum(), spacing * math.hypot(i, j)))
    graph = csr_matrix(
        (np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))), shape=(free.size,) * 2
    )
    start = int(np.argmin(np.hypot(*(grid - field.target[[0, 2]]).transpose(2, 0, 1))))
    found = dijkstra(graph, indices=start)
    points = grid.reshape(-1, 2)
    keep = free.ravel() & np.isfinite(found)
    return points[keep], found[keep]


def test_peg_distance_agrees_with_fcl() -> None:
    rng = np.random.default_rng(1)
    gradient, hessian = np.empty(3), np.empty((3, 3))
    ball = 1e-6
    for _ in range(200):
        radius = rng.uniform(0.5, 4.0) * MM
        peg = make_pegs(rng.uniform(-10, 10, (1, 2)) * MM, radius)[0]
        # fcl's cylinder stands along its own z: turn that into y
        turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        cylinder = fcl.CollisionObject(fcl.Cylinder(radius, 0.2), fcl.Transform(turn, peg[:3]))
        angle, out = rng.uniform(0, 2 * math.pi), rng.uniform(0.2, 20.0) * MM
        point = peg[:3] + np.array([math.cos(angle), 0.0, math.sin(angle)]) * (radius + out)
        point[1] = rng.uniform(-20, 20) * MM
        found = compute_peg_distance(peg, point, gradient, hessian)
        probe = fcl.CollisionObject(fcl.Sphere(ball), fcl.Transform(point))
        expected = fcl.distance(probe, cylinder, fcl.DistanceRequest(), fcl.DistanceResult()) + ball
        # fcl's iterative distance stops at 1e-6 m by default
        assert found == pytest.approx(expected, abs=1e-6)
        assert found == pytest.approx(out, abs=1e-15)


@pytest.mark.parametrize("axis", [(0.0, 1.0, 0.0), (0.6, 0.0, 0.8), (2 / 3, -1 / 3, 2 / 3)])
def test_peg_derivatives_agree_with_differences(axis: tuple[float, float, float]) -> None:
    peg = np.array([1 * MM, 2 * MM, 3 * MM, *axis, 2.5 * MM])
    point = np.array([4.0, -1.0, 7.0]) * MM
    gradient, hessian, other, unused = np.empty(3), np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    compute_peg_distance(peg, point, gradient, hessian)
    step = 1e-7
    for k in range(3):
        ahead, behind = point + step * np.eye(3)[k], point - step * np.eye(3)[k]
        up = compute_peg_distance(peg, ahead, other, unused)
        slope = other.copy()
        down = compute_peg_distance(peg, behind, other, unused)
        # central differences: error step^2 / r^2 relative, rounding 1e-18 / step
        assert gradient[k] == pytest.approx((up - down) / (2 * step), abs=1e-8)
        assert hessian[k] == pytest.approx((slope - other) / (2 * step), abs=1e-5 / MM * 1e-3)


def test_peg_axis_gives_a_unit_gradient_across() -> None:
    for peg in (make_pegs([[1 * MM, 2 * MM]])[0], np.array([1 * MM, 0, 2 * MM, 0.6, 0.0, 0.8, 2 * MM])):
        gradient, hessian = np.full(3, np.nan), np.full((3, 3), np.nan)
        assert compute_peg_distance(peg, peg[:3].copy(), gradient, hessian) == pytest.approx(-peg[6], abs=1e-15)
        assert np.linalg.norm(gradient) == pytest.approx(1.0)
        assert gradient @ peg[3:6] == pytest.approx(0.0, abs=1e-15)
        assert (hessian == 0.0).all()


@pytest.mark.parametrize(("count", "seed"), [(1, 0), (3, 1), (5, 2), (8, 4), (12, 5)])
def test_distance_to_go_agrees_with_a_grid_search(count: int, seed: int) -> None:
    field = make_field(count, seed)
    spacing = 0.4 * MM
    points, lengths = search_grid(field, spacing)
    pick = np.random.default_rng(seed).choice(len(points), 300, replace=False)
    plan = [math.sqrt(max(field.distance_to_go([x, field.target[1], z]) ** 2, 0.0)) for x, z in points[pick]]
    error = np.array(plan) - lengths[pick]
    # 40 directions make straight ways up to 1.0 % too long; free cells may cut a rim by spacing^2 * 25 / (8 radius) per
    # step
    assert error.max() < 0.6 * spacing
    assert error.min() > -0.012 * lengths.max() - spacing


def test_distance_to_go_of_one_peg_in_the_way_is_exact() -> None:
    field = PegField(make_pegs([[0.0, 20 * MM]]), np.array([0.0, 0.0, 40 * MM]))
    reach, radius = 20 * MM, 2.5 * MM + 1.5 * MM + 0.25 * MM
    expected = 2 * (math.sqrt(reach**2 - radius**2) + radius * math.asin(radius / reach))
    assert field.way_length == pytest.approx(expected, rel=1e-12)
    # from a height the way unrolls
    assert field.distance_to_go([0.0, 3 * MM, 0.0]) == pytest.approx(math.hypot(expected, 3 * MM), rel=1e-12)
    assert field.distance_to_go(field.target) == 0.0


def test_distance_to_go_is_continuous_into_a_peg_and_finite_everywhere() -> None:
    for seed in range(4):
        field = make_field(8, seed)
        rng = np.random.default_rng(seed)
        points = rng.uniform([-25 * MM, -3 * MM, -5 * MM], [25 * MM, 3 * MM, 60 * MM], (500, 3))
        length = np.array([field.distance_to_go(point) for point in points])
        assert np.isfinite(length).all()
        assert (length >= np.linalg.norm(points - field.target, axis=1) - 1e-12).all()
    field = paper_pegs()
    for angle in np.linspace(0.0, 2 * math.pi, 50):
        rim = PAPER_PLAN[0] + field.graph.radius[0] * np.array([math.cos(angle), math.sin(angle)])
        inner = rim - 1e-7 * np.array([math.cos(angle), math.sin(angle)])
        there, here = (field.distance_to_go([p[0], 0.0, p[1]]) for p in (rim, inner))
        assert abs(there - here) <= 1.01e-7


def test_ahead_runs_along_the_way_and_stays_at_the_target() -> None:
    field = paper_pegs()
    distances = np.array([0.0, 5.0, 20.0, 45.0, 500.0]) * MM
    points = field.ahead([0.0, 2 * MM, 0.0], distances)
    assert points[0] == pytest.approx([0.0, 2 * MM, 0.0], abs=1e-15)
    assert points[-1] == pytest.approx(field.target, abs=1e-15)
    whole = field.distance_to_go([0.0, 2 * MM, 0.0])
    for point, distance in zip(points[:-1], distances[:-1], strict=True):
        assert field.distance_to_go(point) == pytest.approx(whole - distance, abs=1e-9)
    points[:] = 0.0
    assert field.ahead([0.0, 2 * MM, 0.0], distances)[-1] == pytest.approx(field.target)
    inside = field.ahead([PAPER_PLAN[0, 0], 0.0, PAPER_PLAN[0, 1]], [1 * MM, 60 * MM])
    assert np.isfinite(inside).all()


def test_way_is_clear_and_as_long_as_said() -> None:
    for field in (*(paper_pegs(k) for k in range(len(PAPER_TARGETS))), make_field(12, 5)):
        room = 0.5 * field.robot_diameter + field.clearance
        assert min(field.distance(point) for point in field.way) >= room - 1e-9
        # a polyline with 0.5 mm steps on arcs of 4 mm radius is shorter by 0.07 %
        assert np.linalg.norm(np.diff(field.way, axis=0), axis=1).sum() == pytest.approx(field.way_length, rel=1e-3)
        assert field.way[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-15)
        assert field.way[-1] == pytest.approx(field.target, abs=1e-15)


def test_paper_pegs_can_be_woven_within_the_robots_bend() -> None:
    field = paper_pegs()
    assert field.pegs.shape == (4, 7)
    assert (field.pegs[:, 6] == 2.5 * MM).all()
    assert 55 * MM < field.way_length < 65 * MM
    # three arcs of 95 mm radius
    x, z, turn, step = 0.0, 0.0, 0.0, 0.05 * MM
    path = []
    for curvature, length in ((-10.5, 26 * MM), (10.5, 20 * MM), (-10.5, 16 * MM)):
        for _ in range(round(length / step)):
            middle = turn + 0.5 * curvature * step
            x, z, turn = x + step * math.sin(middle), z + step * math.cos(middle), turn + curvature * step
            path.append((x, z))
    gap = np.hypot(*(np.array(path)[:, None] - PAPER_PLAN).transpose(2, 0, 1)) - 4.0 * MM
    assert gap.min() > 0.4 * MM
    assert math.hypot(path[-1][0] - field.target[0], path[-1][1] - field.target[2]) < 1 * MM
    for k in range(len(PAPER_TARGETS)):
        assert find_straight_approach(paper_pegs(k)) > 5 * MM
    with pytest.raises(GeometryError, match="no target 3"):
        paper_pegs(3)


@pytest.mark.parametrize("name", sorted(PEG_FAMILIES))
def test_families_need_steering_and_can_be_reached(name: str) -> None:
    family = PEG_FAMILIES[name]
    for index in range(15):
        field = generate_pegs(name, index)
        arc = trace_arc(field.metadata["arc_curvature_1_per_m"], field.metadata["arc_length_mm"] * MM)
        assert abs(field.metadata["arc_curvature_1_per_m"]) < 1 / (90 * MM)
        gap = np.hypot(*(arc[:, None] - field.pegs[:, [0, 2]]).transpose(2, 0, 1)) - 4.0 * MM
        # metadata are rounded to a micrometre and 0.001 1/m, which moves the arc's end by about 1 um
        assert gap.min() > family.arc_clearance - 5e-6
        assert np.hypot(*(arc[-1] - field.target[[0, 2]])) < 5e-6
        assert family.peg_count[0] <= len(field.pegs) <= family.peg_count[1]
        assert 38 * MM <= np.linalg.norm(field.target) <= 52 * MM
        assert field.target[1] == 0.0
        assert field.way_length <= 55 * MM
        assert find_straight_approach(field) > 5 * MM


def test_seeds_give_the_same_field_and_spaces_do_not_overlap() -> None:
    assert (generate_pegs("train", 7).pegs == generate_pegs("train", 7).pegs).all()
    assert len({family.key for family in PEG_FAMILIES.values()} | {0}) == len(PEG_FAMILIES) + 1
    seen = {
        field.pegs.tobytes()
        for k in range(20)
        for field in (generate_pegs("train", k), generate_pegs("held_out", k), random_pegs(k))
    }
    assert len(seen) == 60
    with pytest.raises(GeometryError, match="held_out"):
        generate_pegs("heldout", 0)
    with pytest.raises(GeometryError, match="negative"):
        generate_pegs("train", -1)


def test_fields_pickle_and_are_read_only() -> None:
    field = pickle.loads(pickle.dumps(paper_pegs()))
    assert field.distance_to_go([0.0, 0.0, 0.0]) == paper_pegs().way_length
    for array in (paper_pegs().pegs, paper_pegs().target, paper_pegs().way):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_impossible_fields_are_refused() -> None:
    with pytest.raises(GeometryError, match=r"The target at x = 0\.00, z = 40\.00 mm .* peg 0"):
        PegField(make_pegs([[0.0, 38 * MM]]), np.array([0.0, 0.0, 40 * MM]))
    with pytest.raises(GeometryError, match="The port"):
        PegField(make_pegs([[0.0, 3 * MM]]), np.array([0.0, 0.0, 40 * MM]))
    ring = [[12 * MM * math.cos(a), 40 * MM + 12 * MM * math.sin(a)] for a in np.linspace(0, 2 * math.pi, 12)[:-1]]
    with pytest.raises(GeometryError, match="No clear way"):
        PegField(make_pegs(ring), np.array([0.0, 0.0, 40 * MM]))
    tilted = make_pegs([[0.0, 20 * MM]])
    tilted[0, 3:6] = (0.6, 0.8, 0.0)
    with pytest.raises(GeometryError, match="along y"):
        PegField(tilted, np.array([0.0, 0.0, 40 * MM]))
    with pytest.raises(GeometryError, match="finite"):
        PegField(make_pegs([[0.0, 20 * MM]]), np.array([0.0, np.nan, 40 * MM]))


def test_pegs_are_read_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "pegs.csv"
    file.write_text("z_mm, x_mm,diameter_mm\n20,6,5\n\n34.5,1,4\n", encoding="utf-8")
    field = read_pegs(file, [0.0, 0.0, 0.06])
    assert field.pegs == pytest.approx(np.array([[6, 0, 20, 0, 1000, 0, 2.5], [1, 0, 34.5, 0, 1000, 0, 2]]) * MM)
    assert field.name == "pegs"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("x_mm,z_mm,diameter_mm\n", "no peg"),
        ("x_mm,z_mm\n1,2\n", "row 1: column 'diameter_mm' is missing"),
        ("x_mm,z_mm,diameter_mm,y_mm\n1,2,5,0\n", "row 1: unexpected column 'y_mm'"),
        ("x_mm,z_mm,diameter_mm\n1,20,5\n1,x,5\n", "row 3, column 'z_mm': 'x' is not a finite number"),
        ("x_mm,z_mm,diameter_mm\n1,20,nan\n", "row 2, column 'diameter_mm'"),
        ("x_mm,z_mm,diameter_mm\n1,20,-5\n", "row 2, column 'diameter_mm': -5 mm must be positive"),
        ("x_mm,z_mm,diameter_mm\n1,20\n", "row 2: 2 values"),
    ],
)
def test_errors_in_a_peg_file_name_row_and_column(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "mine.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(GeometryError, match=message) as caught:
        read_pegs(file, [0.0, 0.0, 0.06])
    assert "mine.csv" in str(caught.value)


def test_a_missing_peg_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match=r"none\.csv.*does not exist"):
        read_pegs(tmp_path / "none.csv", [0.0, 0.0, 0.06])
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(GeometryError, match="cannot be read as text"):
        read_pegs(tmp_path / "binary.csv", [0.0, 0.0, 0.06])
