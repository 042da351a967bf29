"""What a robot remembers from step to step: its tendon's friction, the tail's grip, creep, and the lagged shear."""

from __future__ import annotations

import math

from evergym.effects.tendon_friction import compute_slide
from evergym.effects.wall_creep import compute_crept_curvature
from evergym.effects.wall_shear import compute_shear_stiffness
from evergym.jit import njit
from evergym.state import Parameters, Scalar, State, Workspace

__all__ = ["update_histories"]


@njit
def update_histories(parameters: Parameters, state: State, ws: Workspace, dt: float) -> None:
    """Advance what remembers: the tendon's friction, the tail's grip, the wall's creep, and the lagged shear."""
    scalar = state.scalar
    effects = parameters.effects
    robot = parameters.robot
    if effects.tendon_friction.mu > 0.0:
        scalar[Scalar.TENDON_SLIDE] = compute_slide(
            ws.rubbing[1],
            scalar[Scalar.TENDON_PATH],
            scalar[Scalar.TENDON_SLIDE],
            effects.tendon_friction.presliding,
        )
    scalar[Scalar.TENDON_PATH] = ws.rubbing[1]
    if effects.torsional_windup.mu > 0.0:
        width = effects.torsional_windup.presliding
        for j in range(state.links[0]):
            middle = 0.5 * (state.roll[j] + state.roll[j + 1])
            state.roll_anchor[j] = min(max(state.roll_anchor[j], middle - width), middle + width)
    if effects.wall_creep.share > 0.0:
        for j in range(state.links[0]):
            for a in range(2):
                curvature = state.bend[j, a] / state.length[j]
                state.crept[j, a] = compute_crept_curvature(effects.wall_creep, state.crept[j, a], curvature, dt)
    if effects.wall_shear.enabled and robot.has_sheath:
        thrust = max(scalar[Scalar.PRESSURE], 0.0) * math.pi * robot.sheath_radius**2
        stiffness = compute_shear_stiffness(effects.wall_shear, thrust)
        fx = fy = fz = 0.0
        for j in range(state.links[0] - 1, -1, -1):
            # In equilibrium a link carries the sum of the forces beyond it.
            fx -= ws.node_gradient[j + 1, 0]
            fy -= ws.node_gradient[j + 1, 1]
            fz -= ws.node_gradient[j + 1, 2]
            bare = max(ws.cover[j, 0] - ws.cover[j, 1] - ws.cover[j, 2], 0.0) / state.length[j]
            for a in range(2):
                along = 0.0
                along += fx * (state.frame[j, 0, a] + state.frame[j + 1, 0, a])
                along += fy * (state.frame[j, 1, a] + state.frame[j + 1, 1, a])
                along += fz * (state.frame[j, 2, a] + state.frame[j + 1, 2, a])
                state.shear[j, a] = 0.5 * bare * along / stiffness
