"""Families of procedural ducts: the distributions their geometry is drawn from, each number with its source.

Sources are those of "Duct anatomy" in the project's notes on effects. A *prior* is a number that no source gives. The
families for the default robot are enlarged, as the phantom of Wu et al. 2023 is: its mesh was scaled until the lumen
near the first branches was two and a half to three robot diameters, since the robot turns but some 30 degrees in 50 mm.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass, replace

import numpy as np

from evergym.errors import ConfigError
from evergym.units import DEG, MM

__all__ = ["FAMILIES", "DuctFamily", "Range", "find_family"]

ROOT_SEED = 2023_3234823  # of all families; the digits of the paper's doi

SHEATH_DIAMETER = 3.0 * MM  # Wu et al. 2023, Table I
SHEATH_DIAMETER_2021 = 3.2 * MM  # first-generation robot, Berthet-Rayne et al. 2021
FIT = 1.3  # smallest lumen in robot diameters (prior)
MESH_ALLOWANCE = 0.08 * MM  # facets and smoothing narrow a lumen by up to 0.05 mm of radius


@dataclass(frozen=True)
class Range:
    """A uniform distribution between two values, both in the unit of the field that holds it."""

    low: float
    high: float

    def draw(self, generator: np.random.Generator) -> float:
        """One value."""
        return float(generator.uniform(self.low, self.high))


@dataclass(frozen=True)
class DuctFamily:
    """Distributions of a kind of duct tree. Lengths in m, angles in rad, curvatures in 1/m.

    Attributes:
        name: How the family is called.
        spawn_key: Keeps its seeds apart from those of every other family.
        robot_diameter: Outer diameter of the robot it is made for.
        trunk_length: Port to the first bifurcation.
        branch_length: Between two bifurcations.
        leaf_length: Last bifurcation to target.
        end_margin: Target to leaf end.
        trunk_radius: Lumen radius before the first bifurcation.
        child_ratio: Mean of the two daughters' radii over the parent's, per bifurcation.
        least_radius: No lumen is narrower.
        deviation: Direction of a daughter against its parent's, per bifurcation.
        asymmetry: Relative difference of the two daughters' deviations and radii, either sign.
        bend_radius: Radius of the bend into a daughter.
        tortuosity: Amplitude of the gentle waves on top.
        wave_length: Length of those waves.
        twist: Angle between the planes of successive bifurcations.
        early_leaf: Probability that one of the first two daughters ends without a second bifurcation.
        target_station: Where targets may lie.
        turn_limit: Largest turn angle from port to target.
        target_separation: Least distance of a target from every other branch's centreline.
        wall_gap: Least thickness of tissue between lumens that have parted.
    """

    name: str
    spawn_key: int
    robot_diameter: float
    trunk_length: Range
    branch_length: Range
    leaf_length: Range
    end_margin: Range
    trunk_radius: Range
    child_ratio: tuple[Range, ...]
    least_radius: float
    deviation: tuple[Range, ...]
    asymmetry: Range
    bend_radius: Range
    tortuosity: Range
    wave_length: Range
    twist: Range
    early_leaf: float
    target_station: Range
    turn_limit: float
    target_separation: float
    wall_gap: float

    @property
    def generations(self) -> int:
        """Bifurcations from the port to a target on the longest way."""
        return len(self.deviation)

    def make_seed(self, index: int) -> np.random.SeedSequence:
        """The seed of one duct: no two families or indices share one."""
        return np.random.SeedSequence(ROOT_SEED, spawn_key=(self.spawn_key, index))


_TRAIN = DuctFamily(
    name="train",
    spawn_key=1,
    robot_diameter=SHEATH_DIAMETER,
    trunk_length=Range(7.5 * MM, 11.0 * MM),  # first branch 8.0 +- 5.5 mm from the nipple, Ramsay 2005
    branch_length=Range(15.0 * MM, 18.0 * MM),  # 5-20 mm, suggested generator of the notes; long enough to part (prior)
    leaf_length=Range(19.0 * MM, 22.0 * MM),  # as above
    end_margin=Range(4.0 * MM, 7.0 * MM),  # prior: the tip can reach and pass the target
    trunk_radius=Range(3.75 * MM, 4.2 * MM),  # 2.5-3 robot diameters near the first branches, Wu et al. 2023
    child_ratio=(Range(0.65, 0.69), Range(0.76, 0.84)),  # 0.65-0.99 per generation, VICTRE phantom
    least_radius=0.5 * FIT * SHEATH_DIAMETER + MESH_ALLOWANCE,
    deviation=(Range(14.0 * DEG, 16.5 * DEG), Range(11.0 * DEG, 13.0 * DEG)),  # 25-75 deg between daughters (prior)
    asymmetry=Range(-0.1, 0.1),  # prior
    bend_radius=Range(30.0 * MM, 44.0 * MM),  # <= 10 mm at true scale, VICTRE; enlarged for the robot's 90 mm (prior)
    tortuosity=Range(0.2, 0.7),  # prior [1/m]
    wave_length=Range(16.0 * MM, 30.0 * MM),  # prior
    twist=Range(60.0 * DEG, 120.0 * DEG),  # uniform plane rotation (prior), without the planes in which branches meet
    early_leaf=0.1,  # prior
    target_station=Range(36.0 * MM, 50.0 * MM),  # the robot stalls at 73-76 mm on the straight, Wu et al. 2023; prior
    turn_limit=30.0 * DEG,  # the robot turns 32 degrees in 50 mm at full tendon pull, Wu et al. 2023, Fig. 10
    target_separation=6.0 * MM,  # more than the 5 mm within which a target counts as reached
    wall_gap=0.3 * MM,  # prior
)

_TRUE_SCALE = replace(
    _TRAIN,
    name="true_scale_train",
    spawn_key=6,
    robot_diameter=SHEATH_DIAMETER_2021,
    trunk_length=Range(5.0 * MM, 13.5 * MM),  # first branch 8.0 +- 5.5 mm from the nipple, Ramsay 2005
    branch_length=Range(10.0 * MM, 16.0 * MM),  # 5-20 mm, suggested generator of the notes
    leaf_length=Range(13.0 * MM, 18.0 * MM),  # as above
    trunk_radius=Range(2.4 * MM, 2.8 * MM),  # 2-3 mm diameter (Ramsay 2005, Geddes 2009), dilated to pass the robot
    child_ratio=(Range(0.80, 0.92), Range(0.88, 0.97)),  # 0.65-0.99 per generation, VICTRE phantom
    least_radius=0.5 * FIT * SHEATH_DIAMETER_2021 + MESH_ALLOWANCE,
    deviation=(Range(16.0 * DEG, 23.0 * DEG), Range(14.0 * DEG, 19.0 * DEG)),  # 30-70 deg between daughters (prior)
    bend_radius=Range(15.0 * MM, 25.0 * MM),  # the robot bends 12-25 1/m: 40-83 mm; the lumen gives the rest (prior)
    target_station=Range(29.0 * MM, 47.0 * MM),  # the 2021 robot grew 67 mm (Bath series)
    turn_limit=46.0 * DEG,  # 20-43 degrees in the distal 30 mm (Berthet-Rayne et al. 2021), more over the way (prior)
)

FAMILIES: dict[str, DuctFamily] = {
    family.name: family
    for family in (
        _TRAIN,
        replace(_TRAIN, name="held_out", spawn_key=2),
        replace(
            _TRAIN,
            name="wide_angle",
            spawn_key=3,
            deviation=(Range(20.0 * DEG, 25.0 * DEG), Range(15.0 * DEG, 19.0 * DEG)),  # 25-75 deg between (prior)
            turn_limit=46.0 * DEG,  # prior
        ),
        replace(
            _TRAIN,
            name="narrow",
            spawn_key=4,
            trunk_radius=Range(2.9 * MM, 3.3 * MM),  # 2 robot diameters (prior)
            child_ratio=(Range(0.68, 0.76), Range(0.90, 0.98)),  # 0.65-0.99 per generation, VICTRE phantom
        ),
        replace(
            _TRAIN,
            name="deep",
            spawn_key=5,
            trunk_length=Range(5.0 * MM, 7.0 * MM),  # first branch 8.0 +- 5.5 mm from the nipple, Ramsay 2005
            branch_length=Range(13.0 * MM, 14.5 * MM),  # 5-20 mm, suggested generator of the notes
            leaf_length=Range(16.5 * MM, 18.5 * MM),  # as above
            trunk_radius=Range(3.3 * MM, 3.7 * MM),  # prior
            child_ratio=(Range(0.65, 0.70), Range(0.84, 0.90), Range(0.96, 0.99)),  # 0.65-0.99, VICTRE phantom
            deviation=(
                Range(17.0 * DEG, 19.0 * DEG),  # 25-75 deg between daughters (prior), as in the default family
                Range(15.0 * DEG, 17.0 * DEG),
                Range(13.0 * DEG, 15.0 * DEG),
            ),
            bend_radius=Range(20.0 * MM, 28.0 * MM),  # as in the default family (prior)
            early_leaf=0.5,  # prior
            target_station=Range(36.0 * MM, 56.0 * MM),  # the robot grows some 58 mm on such a way
            turn_limit=52.0 * DEG,  # prior
        ),
        _TRUE_SCALE,
        replace(_TRUE_SCALE, name="true_scale_held_out", spawn_key=7),
    )
}
"""Every family by name. "train" and "held_out" (and their true-scale namesakes) differ only in their seeds."""


def find_family(name: str) -> DuctFamily:
    """The family of a name.

    Raises:
        ConfigError: There is none; the nearest name is suggested.
    """
    family = FAMILIES.get(name)
    if family is None:
        close = difflib.get_close_matches(str(name), FAMILIES, n=1)
        hint = f" Did you mean '{close[0]}'?" if close else ""
        raise ConfigError(f"There is no duct family '{name}'.{hint} Families: {', '.join(FAMILIES)}.")
    return family
