"""A round rod, clamped level at one end, that sags under its weight: the case on which simulators are compared.

Length 0.1 m, radius 0.8 mm, Young's modulus 40 MPa, density 1000 kg/m^3, so w L^3 / EI = 1.53. Coordinates: x along the
clamp, y up.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np
from scipy import integrate

from evergym.effects.pre_curvature import PreCurvature
from evergym.effects.saline_weight import SalineWeight
from evergym.model import Numerics, load_model
from evergym.simulator import Command, Simulator
from evergym.world import World

__all__ = ["CASE", "EXACT_TIP_MM", "Result", "SagCase", "run_evergym", "solve_elastica"]


@dataclass(frozen=True)
class SagCase:
    """The rod [SI]."""

    length: float = 0.1
    radius: float = 0.8e-3
    modulus: float = 40e6
    density: float = 1000.0
    gravity: float = 9.81

    @property
    def bending_stiffness(self) -> float:
        """E I [N m^2]."""
        return self.modulus * math.pi / 4.0 * self.radius**4

    @property
    def mass_per_length(self) -> float:
        """Mass per length [kg/m]."""
        return self.density * math.pi * self.radius**2


CASE = SagCase()

EXACT_TIP_MM = (97.9957, -18.6251)
"""Tip of the inextensible, unshearable rod [mm]."""


@dataclass(frozen=True)
class Result:
    """What a simulator says.

    Attributes:
        name: The simulator and its version.
        method: How it models the rod.
        elements: Number of links, elements or edges.
        tip_mm: Tip position along the clamp and up [mm].
        cpu_s: Time of the processor to come to rest, without imports and compilation [s].
    """

    name: str
    method: str
    elements: int
    tip_mm: tuple[float, float]
    cpu_s: float

    @property
    def error_mm(self) -> float:
        """Distance from the exact tip [mm]."""
        return math.dist(self.tip_mm, EXACT_TIP_MM)


def solve_elastica(case: SagCase = CASE) -> tuple[float, float]:
    """Return the tip of the inextensible rod [mm], from its differential equation.

    EI theta'' = -w (L - s) cos(theta) with theta(0) = 0 and theta'(L) = 0; theta is the angle above the clamp.
    """
    weight = case.mass_per_length * case.gravity * case.length**3 / case.bending_stiffness

    def bend(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.vstack([y[1], weight * (1.0 - s) * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    def ends(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        return np.array([start[0], end[1], start[2], start[3]])

    station = np.linspace(0.0, 1.0, 41)
    solution = integrate.solve_bvp(bend, ends, station, np.zeros((4, 41)), tol=1e-9)
    assert solution.success, solution.message
    along, up = solution.y[2:, -1] * case.length * 1e3
    return float(along), float(up)


def run_evergym(case: SagCase = CASE, links: int = 50) -> Result:
    """Return what this project's lattice says: the bare catheter, isotropic, of the case's dimensions."""
    default = load_model("mammobot_2023")
    length_mm = case.length * 1e3
    robot = replace(
        default.robot,
        catheter_length_mm=length_mm,
        catheter_flexible_length_mm=length_mm,
        catheter_outer_diameter_mm=2e3 * case.radius,
        catheter_inner_diameter_mm=0.0,
        catheter_bending_stiffness_n_m2=case.bending_stiffness,
        catheter_anisotropy=1.0,
        catheter_mass_g=0.0,
        catheter_damping_time_ms=0.0,
    )
    # The simulator adds the tendon's mass to that of the catheter: gravity makes up for the difference.
    effects = replace(default.effects, pre_curvature=PreCurvature(0.0), saline_weight=SalineWeight(1.0))
    model = replace(default, robot=robot, effects=effects)
    numerics = Numerics(section_length_mm=length_mm / links, step_s=1.0, energy_tolerance_j=1e-16)
    mass = Simulator(model, World.free(), numerics, "catheter").parameters.robot.catheter_mass
    gravity = case.gravity * case.mass_per_length / mass
    world = World.free(gravity=(0.0, -gravity, 0.0))
    Simulator(model, world, numerics, "catheter").advance(Command(), 1.0)  # loads the compiled kernels
    start = time.process_time()
    reading = Simulator(model, world, numerics, "catheter").advance(Command(), 5.0)
    seconds = time.process_time() - start
    _, up, along = reading.tip_position * 1e3
    return Result("evergym", "fibre lattice, implicit", links, (float(along), float(up)), seconds)
