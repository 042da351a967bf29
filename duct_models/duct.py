"""A duct: wall mesh, centreline, targets and field of one anatomy; made from a family or from a user's mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from evergym.duct_models import storage
from evergym.duct_models.centreline import Centreline
from evergym.duct_models.family import DuctFamily, find_family
from evergym.duct_models.field import WallField
from evergym.duct_models.tree import DuctTree, TreeGenerator
from evergym.duct_models.wall import build_wall_mesh
from evergym.units import DEG, MM

__all__ = ["Duct", "Target", "generate_duct", "make_targets"]

FloatArray = NDArray[np.float64]

DUCTS_IN_MEMORY = 48  # some 5 MB each


@dataclass(frozen=True, eq=False)
class Target:
    """A place the robot is sent to.

    Attributes:
        node: Its centreline node.
        position: The node's position [m], shape (3,).
        station: Length of the way from the port [m].
        generation: Bifurcations on the way.
    """

    node: int
    position: FloatArray
    station: float
    generation: int


@dataclass(frozen=True, eq=False)
class Duct:
    """One anatomy.

    Attributes:
        name: For messages, such as "train-0012".
        mesh: The lumen's closed wall [m], outward winding, the port at the origin along +z.
        centreline: The lumen's tree.
        targets: Where the robot can be sent.
        metadata: Where the duct comes from; plain values only (family, index, seed, turn_angle_deg, choices, ...).
    """

    name: str
    mesh: trimesh.Trimesh
    centreline: Centreline
    targets: tuple[Target, ...]
    metadata: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def field(self) -> WallField:
        """The wall as compiled steps read it, built once per mesh and then kept on disk."""
        return storage.load_or_build_field(self.mesh)


def make_targets(centreline: Centreline, nodes: NDArray[np.int64]) -> tuple[Target, ...]:
    """Targets at centreline nodes."""
    return tuple(
        Target(
            int(node),
            np.array(centreline.position[node]),
            float(centreline.station[node]),
            int(centreline.generation[node]),
        )
        for node in nodes
    )


@lru_cache(maxsize=DUCTS_IN_MEMORY)
def generate_duct(family_name: str, index: int) -> Duct:
    """The duct of a family and index: the same anatomy, to the bit, in every process.

    Made in about a second, then read from the disk cache in some milliseconds; the last few stay in memory.

    Args:
        family_name: A key of ``FAMILIES``.
        index: Which duct of the family, 0 or more.

    Raises:
        ConfigError: There is no such family.
        GeometryError: The index is negative.
    """
    family = find_family(family_name)
    tree = TreeGenerator(family, index).generate()
    return Duct(
        name=f"{family.name}-{index:04d}",
        mesh=storage.load_or_build_mesh(tree.centreline, build_wall_mesh),
        centreline=tree.centreline,
        targets=make_targets(tree.centreline, tree.targets),
        metadata=_describe(family, index, tree),
    )


def _describe(family: DuctFamily, index: int, tree: DuctTree) -> dict[str, Any]:
    line = tree.centreline
    return {
        "family": family.name,
        "index": index,
        "seed": [int(word) for word in family.make_seed(index).generate_state(2)],
        "robot_diameter_mm": family.robot_diameter / MM,
        "draws": tree.tries,
        "turn_angle_deg": [float(line.turn_angle[node] / DEG) for node in tree.targets],
        "choices": [_list_choices(tree, int(node)) for node in tree.targets],
    }


def _list_choices(tree: DuctTree, node: int) -> list[int]:
    """Which daughter (0 or 1) to take at each bifurcation on the way to a node."""
    choices = []
    branch = int(tree.centreline.branch[node])
    while tree.branch_parent[branch] >= 0:
        siblings = np.flatnonzero(tree.branch_parent == tree.branch_parent[branch])
        choices.append(int(np.flatnonzero(siblings == branch)[0]))
        branch = int(tree.branch_parent[branch])
    return choices[::-1]
