"""Retraction: pulling the tail back inverts the wall, or buckles it when it takes more than the column carries."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo
from evergym.jit import njit
from evergym.units import KPA

__all__ = [
    "RetractionBuckling",
    "RetractionBucklingParameters",
    "compute_axial_limit",
    "compute_inversion_tension",
]


class RetractionBucklingParameters(NamedTuple):
    """SI parameters: inversion yield [Pa], length factor K [1] (0: never buckles), shear rigidity G pi R t [N]."""

    inversion_yield: float
    length_factor: float
    shear_rigidity: float


@dataclass(frozen=True)
class RetractionBuckling:
    """Inversion takes the tail tension (p A + F_inv) / 2; above the axial limit of the column it buckles instead.

    The limit is Fichter's column k (pA + G pi R t) / (k + pA + G pi R t), k the Euler load of the unsupported length.
    Off at length factor zero: pulling always inverts. Source: Fichter 1966 (NASA TN D-3466); Coad et al. 2020.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=28,
        acts_on="state",
        moves=("everted_length_mm", "tip_x_mm", "tip_y_mm"),
        depends_on=("pressure", "length"),
        partners=("axial_buckling",),
        off={"length_factor": 0.0},
        strength=("length_factor",),
        typical={"length_factor": 2.0},
    )

    inversion_yield_kpa: float = parameter(
        9.9, unit="kPa", low=0.0, high=1000.0, prior=True, source="taken equal to the kinetic yield of eversion"
    )
    length_factor: float = parameter(2.0, unit="1", low=0.0, high=2.0, source="fixed at the port, free at the tip")
    wall_poisson_ratio: float = parameter(
        0.42, unit="1", low=0.0, high=0.5, source="low-density polyethylene 0.40-0.46"
    )

    def compile(self, sheath_radius: float, wall_thickness: float, modulus: float) -> RetractionBucklingParameters:
        """Return the SI parameters for a sheath of that radius [m], thickness [m] and modulus [Pa]."""
        shear = modulus / (2.0 * (1.0 + self.wall_poisson_ratio)) * math.pi * sheath_radius * wall_thickness
        return RetractionBucklingParameters(self.inversion_yield_kpa * KPA, self.length_factor, shear)


@njit
def compute_inversion_tension(parameters: RetractionBucklingParameters, pressure: float, area: float) -> float:
    """Return the tail tension [N] that inverts the wall at the tip of a sheath with a cross-section ``area`` [m^2]."""
    return 0.5 * (pressure + parameters.inversion_yield) * area


@njit
def compute_axial_limit(
    parameters: RetractionBucklingParameters, bending_stiffness: float, length: float, thrust: float
) -> float:
    """Return the axial load [N] that buckles a column of ``length`` [m] under the thrust p A [N]; inf when off."""
    if parameters.length_factor == 0.0 or length <= 0.0:
        return math.inf
    euler = math.pi**2 * bending_stiffness / (parameters.length_factor * length) ** 2
    shear = thrust + parameters.shear_rigidity
    return euler * shear / (euler + shear)
