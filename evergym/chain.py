"""The chain of sections: where they lie, how many there are, and which body covers how much of each link."""

from __future__ import annotations

import math

from evergym.jit import njit
from evergym.links import place_link
from evergym.state import Parameters, Scalar, State, Workspace

__all__ = ["place_chain", "update_chain", "update_covers"]


@njit
def place_chain(parameters: Parameters, state: State, ws: Workspace) -> None:
    """Place all sections of ``state`` from its bends, from the port on."""
    for a in range(3):
        state.position[0, a] = 0.0
        for b in range(3):
            state.frame[0, a, b] = parameters.world.port_frame[a, b]
    for j in range(state.links[0]):
        place_link(
            j,
            state.length[j],
            state.bend[j, 0],
            state.bend[j, 1],
            state.shear,
            ws.link,
            ws.column,
            ws.half_column,
            state.position,
            state.frame,
        )


@njit
def update_chain(parameters: Parameters, state: State) -> int:
    """Fit the links to the robot's length: all of one length but the last, which has 0.5 to 1.5 of it.

    A link that is split or lengthened keeps its curvature, so growth moves no section that exists.
    """
    h = parameters.numerics.section_length
    total = max(state.scalar[Scalar.WALL_LENGTH], state.scalar[Scalar.CATHETER_LENGTH])
    old = state.links[0]
    new = min(max(math.floor(total / h - 0.5) + 1, 1), state.length.shape[0])
    last = old - 1
    kx = state.bend[last, 0] / state.length[last]
    ky = state.bend[last, 1] / state.length[last]
    if new < old:
        kx = state.bend[new - 1, 0] / state.length[new - 1]
        ky = state.bend[new - 1, 1] / state.length[new - 1]
    for j in range(min(old, new) - 1, new):
        length = h if j < new - 1 else total - h * (new - 1)
        state.length[j] = length
        state.bend[j, 0] = kx * length
        state.bend[j, 1] = ky * length
        if j >= old:
            # The new tip takes over what the old one felt.
            state.roll[j + 1] = state.roll[j]
            state.roll_anchor[j] = state.roll[j]
            state.crept[j, :] = 0.0
            state.shear[j, :] = 0.0
            state.friction_limit[j + 1] = state.friction_limit[j]
            state.depth[j + 1] = state.depth[j]
            for a in range(3):
                state.contact_force[j + 1, a] = state.contact_force[j, a]
                state.velocity[j + 1, a] = 0.0
    state.links[0] = new
    return int(old)


@njit
def update_covers(parameters: Parameters, state: State, ws: Workspace) -> None:
    """Overwrite which body covers how much of each link, and the nodes' masses, contact radii and contact lengths."""
    robot = parameters.robot
    n = state.links[0]
    everted = state.scalar[Scalar.WALL_LENGTH] if robot.has_sheath else 0.0
    inserted = state.scalar[Scalar.CATHETER_LENGTH] if robot.has_catheter else 0.0
    uncut = max(inserted - robot.flexible_length, 0.0)
    start = 0.0
    for i in range(n + 1):
        ws.mass[i] = 0.0
        ws.tributary[i] = 0.0
    for j in range(n):
        length = state.length[j]
        end = start + length
        sheath = min(max(everted - start, 0.0), length)
        catheter = min(max(inserted - start, 0.0), length)
        proximal = min(max(uncut - start, 0.0), length)
        ws.cover[j, 0] = sheath
        ws.cover[j, 1] = catheter - proximal
        ws.cover[j, 2] = proximal
        both = min(sheath, catheter)
        mass = robot.sheath_mass * sheath + robot.inner_mass * both + robot.catheter_mass * (catheter - both)
        # Shares of the ends, so that the first moment of a partly covered link is right to the link's middle.
        ws.mass[j] += 0.5 * mass
        ws.mass[j + 1] += 0.5 * mass
        ws.tributary[j] += 0.5 * length
        ws.tributary[j + 1] += 0.5 * length
        ws.contact_radius[j + 1] = robot.sheath_radius if everted >= end - 1e-9 else robot.catheter_radius
        start = end
    # The rounded end bears on its own cross-section as well.
    ws.tributary[n] += ws.contact_radius[n]
