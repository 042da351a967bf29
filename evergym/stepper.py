"""The substep loop: what happens, in which order, from one state to the next.

1. pressure    follows its set point                                     `effects.pressure_lag`, `effects.burst_limit`
2. tendon      takes up the drive's pull                                 `effects.tendon_backlash`
3. eversion    catheter slides, tail is fed, wall grows or inverts       `evergym.eversion`: yield, rate, feed,
friction, buckling
4. chain       gains or loses links at the tip; masses and covers        here
5. equilibrium of springs, tendon, weight, contact and friction          `evergym.equilibrium`, `evergym.links`,
`evergym.contact`
6. records     contact forces, friction limits, velocities               here

A new force is a term in step 5: of a link in `evergym.links.add_springs`, of a node in `evergym.equilibrium`. A new
effect on growth is a term in step 3. A command is an array of eight: insertion velocity, tail feed velocity [m/s],
roll [rad], tendon pull [m], pressure [Pa], and the load on the tip [N] along x, y, z.
"""

from __future__ import annotations

import math
from typing import Any

from evergym.effects.burst_limit import has_burst
from evergym.effects.pressure_lag import compute_lagged_pressure
from evergym.effects.tendon_backlash import compute_transmitted_pull
from evergym.equilibrium import solve_equilibrium
from evergym.eversion import update_eversion
from evergym.jit import TypedList, njit
from evergym.links import place_link
from evergym.state import Array, Parameters, Scalar, State, Workspace

__all__ = ["advance", "advance_packed", "pack", "settle"]

HALVINGS_MAX = 5
"""A substep that fails is taken again in 2, 4, ... steps, up to 2 to this power."""


@njit
def _place_chain(parameters: Parameters, state: State, ws: Workspace) -> None:
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
            ws.link,
            ws.column,
            ws.half_column,
            state.position,
            state.frame,
        )


@njit
def _update_chain(parameters: Parameters, state: State) -> int:
    """Fit the links to the robot's length: all of one length but the last, which has 0.5 to 1.5 of it.

    A link that is split or lengthened keeps its curvature, so growth moves no section that exists.
    """
    h = parameters.numerics.section_length
    total = max(state.scalar[Scalar.EVERTED_LENGTH], state.scalar[Scalar.CATHETER_LENGTH])
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
            state.friction_limit[j + 1] = state.friction_limit[j]
            state.depth[j + 1] = state.depth[j]
            for a in range(3):
                state.contact_force[j + 1, a] = state.contact_force[j, a]
                state.velocity[j + 1, a] = 0.0
    state.links[0] = new
    return int(old)


@njit
def _update_covers(parameters: Parameters, state: State, ws: Workspace) -> None:
    """Overwrite which body covers how much of each link, and the nodes' masses, contact radii and contact lengths."""
    robot = parameters.robot
    n = state.links[0]
    everted = state.scalar[Scalar.EVERTED_LENGTH] if robot.has_sheath else 0.0
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


@njit
def _prepare(parameters: Parameters, state: State, command: Array, ws: Workspace, old: int, dt: float) -> None:
    """Overwrite what the step holds constant: where each node was, is predicted, and would be without sliding."""
    n = state.links[0]
    everted = state.scalar[Scalar.EVERTED_LENGTH] if parameters.robot.has_sheath else 0.0
    kept = min(old, n) - 1
    # Nodes before the last link lie where they lay; the others, where growth along the old shape puts them.
    for i in range(n + 1):
        for a in range(3):
            ws.reference[i, a] = state.position[i, a]
    _place_chain(parameters, state, ws)
    start = 0.0
    for i in range(n + 1):
        if i > 0:
            start += state.length[i - 1]
        sliding = 0.0
        if start > everted + 1e-9:
            # Only the catheter is here: its surface slides along the robot's path.
            sliding = command[0] * dt
        back = ws.contact_radius[i] if i == n else 0.0
        norm = 0.0
        for a in range(3):
            if i > kept:
                ws.reference[i, a] = state.position[i, a] - back * state.frame[i, a, 2]
                ws.predicted[i, a] = state.position[i, a] + dt * state.velocity[i, a]
            else:
                ws.predicted[i, a] = ws.reference[i, a] + dt * state.velocity[i, a]
            ws.reference[i, a] -= sliding * state.frame[i, a, 2]
            norm += state.contact_force[i, a] ** 2
        norm = math.sqrt(norm)
        if norm == 0.0:
            state.friction_limit[i] = 0.0
        for a in range(3):
            ws.normal[i, a] = state.contact_force[i, a] / norm if norm > 0.0 else 0.0
        ws.previous_roll[i] = state.roll[i]
        if i < n:
            ws.previous_bend[i, 0] = state.bend[i, 0]
            ws.previous_bend[i, 1] = state.bend[i, 1]
        # The velocity row keeps the node's place until the step is done.
        for a in range(3):
            state.velocity[i, a] = state.position[i, a] if i > kept else ws.predicted[i, a] - dt * state.velocity[i, a]


@njit
def _record(state: State, ws: Workspace, dt: float) -> None:
    """Store what the next step needs of this one: contact and velocities (whose rows hold the old places)."""
    scalar = state.scalar
    largest = total = deepest = count = 0.0
    for i in range(state.links[0] + 1):
        state.depth[i] = ws.depth[i]
        state.friction_limit[i] = ws.friction_limit[i]
        square = 0.0
        for a in range(3):
            force = ws.contact_force[i, a]
            square += force * force
            state.contact_force[i, a] = force
            state.velocity[i, a] = (state.position[i, a] - state.velocity[i, a]) / dt
        force = math.sqrt(square)
        largest = max(largest, force)
        total += force
        count += 1.0 if force > 0.0 else 0.0
        deepest = max(deepest, ws.depth[i])
    scalar[Scalar.WALL_FORCE_MAX] = largest
    scalar[Scalar.WALL_FORCE_SUM] = total
    scalar[Scalar.CONTACT_COUNT] = count
    scalar[Scalar.PENETRATION_MAX] = deepest
    scalar[Scalar.TIP_STIFFNESS] = ws.tip_stiffness[0]


@njit
def _substep(parameters: Parameters, state: State, command: Array, ws: Workspace, dt: float) -> int:
    """Advance by one implicit step and return the solver's status."""
    scalar = state.scalar
    effects = parameters.effects
    # 1. pressure
    set_point = command[4] if scalar[Scalar.BURST] == 0.0 else 0.0
    scalar[Scalar.PRESSURE] = compute_lagged_pressure(effects.pressure_lag, scalar[Scalar.PRESSURE], set_point, dt)
    if has_burst(effects.burst_limit, scalar[Scalar.PRESSURE]):
        scalar[Scalar.BURST] = 1.0
        scalar[Scalar.PRESSURE] = 0.0
    # 2. tendon
    scalar[Scalar.DRIVE_PULL] = command[3]
    scalar[Scalar.TRANSMITTED_PULL] = compute_transmitted_pull(
        effects.tendon_backlash, command[3], scalar[Scalar.TRANSMITTED_PULL]
    )
    # 3. eversion
    update_eversion(parameters, state, command, ws, dt)
    # 4. chain
    old = _update_chain(parameters, state)
    _update_covers(parameters, state, ws)
    _prepare(parameters, state, command, ws, old, dt)
    turned = command[2] - scalar[Scalar.ROLL]
    scalar[Scalar.ROLL] = command[2]
    n = state.links[0]
    for i in range(n + 1):
        state.roll[i] += turned
    # 5. equilibrium
    status = solve_equilibrium(parameters, state, command, ws, dt)
    # 6. records
    _record(state, ws, dt)
    scalar[Scalar.TIME] += dt
    scalar[Scalar.SUBSTEPS] += 1.0
    return status


@njit
def _copy(source: State, target: State) -> None:
    target.scalar[:] = source.scalar
    target.links[:] = source.links
    target.length[:] = source.length
    target.bend[:] = source.bend
    target.roll[:] = source.roll
    target.position[:] = source.position
    target.frame[:] = source.frame
    target.velocity[:] = source.velocity
    target.contact_force[:] = source.contact_force
    target.friction_limit[:] = source.friction_limit
    target.depth[:] = source.depth


@njit
def advance(
    parameters: Parameters, state: State, backup: State, command: Array, ws: Workspace, duration: float, step: float
) -> int:
    """Advance ``state`` by ``duration`` under a constant command, in equal substeps of at most ``step``.

    Args:
        parameters: `Parameters`.
        state: `State`, overwritten; on failure, the state at the last good substep.
        backup: `State` of the same room, scratch.
        command: shape (8,), see the module.
        ws: `Workspace`.
        duration: [s].
        step: [s].

    Returns:
        A `evergym.equilibrium.Status` code.
    """
    count = max(math.ceil(duration / step - 1e-9), 1)
    dt = duration / count
    for _ in range(count):
        _copy(state, backup)
        status = _substep(parameters, state, command, ws, dt)
        level = 0
        while status != 0 and level < HALVINGS_MAX:
            level += 1
            _copy(backup, state)
            parts = 1 << level
            ramp = ws.ramp
            ramp[:] = command
            for k in range(parts):
                # A jump of the drives is spread over the step in which it happens: every part makes its share.
                share = (k + 1.0) / parts
                ramp[2] = backup.scalar[Scalar.ROLL] + share * (command[2] - backup.scalar[Scalar.ROLL])
                ramp[3] = backup.scalar[Scalar.DRIVE_PULL] + share * (command[3] - backup.scalar[Scalar.DRIVE_PULL])
                status = _substep(parameters, state, ramp, ws, dt / parts)
                if status != 0:
                    break
        if status != 0:
            _copy(backup, state)
            return status
    return 0


@njit
def settle(parameters: Parameters, state: State, command: Array, ws: Workspace, tangent: Array) -> int:
    """Place a robot of the state's lengths along a path and let it find its shape, with nothing sliding or growing.

    Args:
        parameters: `Parameters`.
        state: `State`; its scalars are given, the rest is overwritten.
        command: shape (8,).
        ws: `Workspace`.
        tangent: Unit tangents at the nodes, shape (k, 3); none: straight.

    Returns:
        A `evergym.equilibrium.Status` code.
    """
    scalar = state.scalar
    state.links[0] = 1
    state.length[0] = max(scalar[Scalar.EVERTED_LENGTH], scalar[Scalar.CATHETER_LENGTH])
    _update_chain(parameters, state)
    _place_chain(parameters, state, ws)
    for j in range(min(state.links[0], tangent.shape[0] - 1)):
        # Bend about the axis that turns this section's tangent into the next one's.
        for a in range(2):
            b = 1 - a
            across = 0.0
            for c in range(3):
                across += state.frame[j, c, b] * tangent[j + 1, c]
            state.bend[j, a] = math.asin(min(max(across, -1.0), 1.0)) * (-1.0 if a == 0 else 1.0)
        _place_chain(parameters, state, ws)
    for i in range(state.links[0] + 1):
        state.roll[i] = scalar[Scalar.ROLL]
    scalar[Scalar.DRIVE_PULL] = command[3]
    scalar[Scalar.TRANSMITTED_PULL] = compute_transmitted_pull(parameters.effects.tendon_backlash, command[3], 0.0)
    status = 0
    for _ in range(3):
        _update_covers(parameters, state, ws)
        _prepare(parameters, state, command, ws, state.links[0] + 1, 1.0)
        status = solve_equilibrium(parameters, state, command, ws, 1.0)
        _record(state, ws, 1.0)
        state.velocity[:] = 0.0
        if status != 0:
            break
    scalar[Scalar.ITERATIONS] = 0.0
    return status


@njit
def pack(parameters: Parameters, state: State, backup: State, ws: Workspace) -> Any:
    """Return the four in a box that enters a kernel as one pointer: handing over some 200 values takes 60 us a call.

    The arrays stay shared with the caller; the numbers in ``parameters`` are copied.
    """
    box = TypedList()
    box.append((parameters, state, backup, ws))
    return box


@njit
def advance_packed(box: Any, command: Array, duration: float, step: float) -> int:
    """Advance as `advance` does, with what `pack` returned."""
    parameters, state, backup, ws = box[0]
    return advance(parameters, state, backup, command, ws, duration, step)
