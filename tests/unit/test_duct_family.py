"""Families and the trees drawn from them: seeds that never meet, and every promise of the family kept."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from evergym.duct_models.duct import generate_duct
from evergym.duct_models.family import FAMILIES, find_family
from evergym.duct_models.tree import DuctTree, TreeGenerator
from evergym.errors import ConfigError, GeometryError
from evergym.units import DEG, MM

EXAMPLES = [(name, index) for name in FAMILIES for index in (0, 1)]


@pytest.fixture(scope="module")
def trees() -> dict[tuple[str, int], DuctTree]:
    return {(name, index): TreeGenerator(FAMILIES[name], index).generate() for name, index in EXAMPLES}


def test_seeds_of_families_cannot_overlap() -> None:
    keys = [family.spawn_key for family in FAMILIES.values()]
    assert len(set(keys)) == len(keys)
    states = {tuple(family.make_seed(index).generate_state(4)) for family in FAMILIES.values() for index in range(500)}
    assert len(states) == 500 * len(FAMILIES)


def test_held_out_differs_from_train_by_its_seeds_only() -> None:
    for train, held_out in (("train", "held_out"), ("true_scale_train", "true_scale_held_out")):
        a, b = vars(FAMILIES[train]), vars(FAMILIES[held_out])
        assert {key for key in a if a[key] != b[key]} == {"name", "spawn_key"}


def test_same_seed_same_bits_and_other_seed_other_tree(trees: dict[tuple[str, int], DuctTree]) -> None:
    again = TreeGenerator(FAMILIES["train"], 0).generate()
    np.testing.assert_array_equal(again.centreline.position, trees["train", 0].centreline.position)
    for a, b in itertools.combinations([("train", 0), ("train", 1), ("held_out", 0), ("held_out", 1)], 2):
        assert not np.array_equal(trees[a].centreline.position[-1], trees[b].centreline.position[-1])


@pytest.mark.parametrize(("name", "index"), EXAMPLES)
def test_tree_keeps_the_promises_of_its_family(trees: dict[tuple[str, int], DuctTree], name: str, index: int) -> None:
    family, tree = FAMILIES[name], trees[name, index]
    line = tree.centreline
    np.testing.assert_array_equal(line.position[0], 0.0)
    assert len(tree.targets) >= 3
    assert line.radius.min() >= 0.5 * 1.3 * family.robot_diameter
    ratio = line.radius[line.leaves].min() / line.radius[0]
    assert ratio < 1.0
    assert (line.turn_angle[tree.targets] <= family.turn_limit).all()
    for node in tree.targets:
        way = line.path_to(int(node))
        last = np.intersect1d(way, line.bifurcations).max()
        assert line.station[node] - line.station[last] >= 8.0 * MM
        assert family.target_station.low <= line.station[node] <= family.target_station.high
        # the leaf goes on far enough for the tip to pass the target
        leaf = [leaf for leaf in line.leaves if node in line.path_to(int(leaf))]
        assert len(leaf) == 1
        assert line.station[leaf[0]] - line.station[node] >= 3.5 * MM
        other = line.branch != line.branch[node]
        other[way] = False
        gap = np.linalg.norm(line.position[other] - line.position[node], axis=1)
        assert gap.min() >= family.target_separation
    targets = line.position[tree.targets]
    for a, b in itertools.combinations(range(len(targets)), 2):
        assert np.linalg.norm(targets[a] - targets[b]) >= 6.0 * MM


@pytest.mark.parametrize(("name", "index"), EXAMPLES)
def test_curves_are_smooth_and_stations_are_arclengths(
    trees: dict[tuple[str, int], DuctTree], name: str, index: int
) -> None:
    family, line = FAMILIES[name], trees[name, index].centreline
    segment = line.position[1:] - line.position[line.parent[1:]]
    chord = np.linalg.norm(segment, axis=1)
    arc = line.station[1:] - line.station[line.parent[1:]]
    assert (chord <= arc + 1e-12).all()
    np.testing.assert_allclose(chord, arc, rtol=1e-3)  # 1 mm on a bend of 15 mm: 2e-4
    # C1, bifurcations included: from one segment to the next the direction turns by no more than curvature x length.
    direction = np.vstack([[0.0, 0.0, 1.0], segment / chord[:, None]])
    inner = np.arange(1, len(line.position))
    turn = np.arccos(np.clip(np.sum(direction[inner] * direction[line.parent[inner]], axis=1), -1.0, 1.0))
    curvature = 1.0 / family.bend_radius.low + family.tortuosity.high
    assert (turn <= 1.2 * curvature * NODE_LENGTH).all()


NODE_LENGTH = 1.05 * MM


def test_daughters_part_symmetrically_and_deviate_as_drawn() -> None:
    # A push-only robot must find its branch by chance: over many trees neither daughter is the straighter one.
    family = FAMILIES["train"]
    deviations = []
    for index in range(12):
        line = TreeGenerator(family, index).generate().centreline
        first = line.bifurcations[0]
        before = line.position[first] - line.position[line.parent[first]]
        for branch in (1, 2):
            nodes = np.flatnonzero(line.branch == branch)
            after = line.position[nodes[-1]] - line.position[nodes[-2]]
            cosine = before @ after / np.linalg.norm(before) / np.linalg.norm(after)
            deviations.append(np.arccos(cosine) / DEG)
    a, b = np.array(deviations).reshape(-1, 2).T
    assert abs(np.mean(a - b)) < 2.0  # degrees; drawn within +-10 % of 16 degrees, and waves on top
    assert 10.0 < min(deviations) < max(deviations) < 22.0


def test_unknown_family_suggests_the_nearest() -> None:
    with pytest.raises(ConfigError, match="Did you mean 'held_out'"):
        find_family("heldout")
    with pytest.raises(ConfigError, match="Families: train"):
        generate_duct("x", 0)


def test_negative_index_is_refused() -> None:
    with pytest.raises(GeometryError, match="must be 0 or more: got -1"):
        generate_duct("train", -1)
