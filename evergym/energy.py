"""Energies of a simulator's state, for tests and diagnostics; nothing here is part of a step."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from evergym.chain import update_covers
from evergym.contact import add_contact
from evergym.links import add_springs
from evergym.simulator import Simulator
from evergym.state import Scalar, create_workspace

__all__ = ["Energies", "compute_energies"]


class Energies(NamedTuple):
    """Energies of a robot and of the walls that it touches [J]."""

    springs: float
    """Of all fibres and braces, less the work of the pressure: a potential at constant pressure and lengths."""
    tendon: float
    """Of the stretched tendon line."""
    weight: float
    kinetic: float
    contact: float
    """Of indented tissue and pegs."""

    @property
    def total(self) -> float:
        """Their sum [J]."""
        return self.springs + self.tendon + self.weight + self.kinetic + self.contact


def compute_energies(simulator: Simulator) -> Energies:
    """Return the energies of the simulator's present state.

    Work of the tip load and of the drives is not included: over a step at constant pressure and lengths, what they do
    less the change of the total is what friction and damping take.

    Args:
        simulator: In any state; it is not changed.
    """
    parameters, state = simulator.parameters, simulator.state
    n = int(state.links[0])
    ws = create_workspace(state.length.shape[0])
    update_covers(parameters, state, ws)
    # The play at the base lies about the catheter's own bend, whose direction goes with the roll.
    ws.previous_roll[:] = state.roll
    # Dashpots have no energy in a step of infinite length.
    springs, path = add_springs(parameters, state, ws, state.bend, state.roll, math.inf)
    tendon = 0.0
    stretch = float(state.scalar[Scalar.TRANSMITTED_PULL]) - path
    if parameters.robot.has_catheter and state.scalar[Scalar.CATHETER_LENGTH] > 0.0 and stretch > 0.0:
        tendon = 0.5 * stretch * stretch / parameters.effects.tendon_stretch.compliance
    # The first node is clamped in the port.
    mass = ws.mass[1 : n + 1]
    height = state.position[1 : n + 1] @ parameters.world.gravity
    weight = -parameters.effects.saline_weight.share * float(mass @ height)
    kinetic = 0.5 * float(mass @ np.square(state.velocity[1 : n + 1]).sum(axis=1))
    contact = 0.0
    world = parameters.world
    for i in range(1, n + 1):
        radius = ws.contact_radius[i]
        point = state.position[i] - (radius * state.frame[i, :, 2] if i == n else 0.0)
        gradient, hessian = np.zeros(3), np.zeros((3, 3))
        contact += add_contact(
            world.has_wall,
            world.wall,
            world.pegs,
            parameters.effects.duct_compliance,
            parameters.effects.contact_friction,
            point,
            radius,
            ws.tributary[i],
            state.depth[i],
            math.inf,
            ws.gradient,
            ws.hessian,
            gradient,
            hessian,
        )[0]
    return Energies(springs, tendon, weight, kinetic, contact)
