"""The substep loop: what happens, in which order, from one state to the next.

1. pressure    follows its set point                                     `effects.pressure_*`, `effects.burst_limit`
2. tendon      takes up the drive's pull                                 `effects.tendon_backlash`
3. eversion    catheter slides, tail is fed, wall grows or inverts       `evergym.eversion`: yield, rate, feed,
friction, buckling
4. chain       gains or loses links at the tip; masses and covers        `evergym.chain`
5. equilibrium of springs, tendon, weight, contact and friction          `evergym.equilibrium`, `evergym.links`,
`evergym.contact`
6. records     contact forces, friction limits, velocities               here
7. histories   tendon friction, the tail's grip on the roll, creep       `evergym.history`

A new force is a term in step 5: of a link in `evergym.links.add_springs`, of a node in `evergym.equilibrium`. A new
effect on growth is a term in step 3. A command is an array of eight: insertion velocity, tail feed velocity [m/s],
roll [rad], tendon pull [m], pressure [Pa], and the load on the tip [N] along x, y, z.
"""

from __future__ import annotations

import math
from typing import Any

from evergym.chain import place_chain, update_chain, update_covers
from evergym.effects.burst_limit import has_burst
from evergym.effects.pressure_lag import compute_lagged_pressure
from evergym.effects.pressure_ripple import compute_ripple
from evergym.effects.tendon_backlash import compute_transmitted_pull
from evergym.equilibrium import solve_equilibrium
from evergym.eversion import update_eversion
from evergym.history import update_histories
from evergym.jit import TypedList, njit
from evergym.state import Array, Parameters, Scalar, State, Workspace

__all__ = ["advance", "advance_packed", "compute_supply", "pack", "settle"]

HALVINGS_MAX = 5
"""A substep that fails is taken again in 2, 4, ... steps, up to 2 to this power."""


@njit
def _prepare(parameters: Parameters, state: State, command: Array, ws: Workspace, old: int, dt: float) -> None:
    """Overwrite what the step holds constant: where each node was, is predicted, and would be without sliding."""
    n = state.links[0]
    everted = state.scalar[Scalar.WALL_LENGTH] if parameters.robot.has_sheath else 0.0
    kept = min(old, n) - 1
    # Nodes before the last link lie where they lay; the others, where growth along the old shape puts them.
    for i in range(n + 1):
        for a in range(3):
            ws.reference[i, a] = state.position[i, a]
    place_chain(parameters, state, ws)
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
def compute_supply(parameters: Parameters, set_point: float, time: float) -> float:
    """Return the pressure [Pa] that the supply drives at for a ``set_point`` [Pa] at ``time`` [s]."""
    effects = parameters.effects
    if effects.pressure_bias.bias != 0.0:
        set_point = max(set_point - effects.pressure_bias.bias, 0.0)
    set_point += compute_ripple(effects.pressure_ripple, time, set_point)
    return set_point * (1.0 - effects.pressure_leak.share)


@njit
def _prepare_tendon(parameters: Parameters, state: State, ws: Workspace) -> None:
    """Overwrite the exponent of the tendon's friction: its coefficient times the bend of the step's start."""
    ws.rubbing[0] = 0.0
    if parameters.effects.tendon_friction.mu > 0.0:
        angle = 0.0
        for j in range(state.links[0]):
            share = ws.cover[j, 1] / state.length[j]
            angle += share * math.sqrt(state.bend[j, 0] ** 2 + state.bend[j, 1] ** 2)
        ws.rubbing[0] = parameters.effects.tendon_friction.mu * angle


@njit
def _substep(parameters: Parameters, state: State, command: Array, ws: Workspace, dt: float) -> int:
    """Advance by one implicit step and return the solver's status."""
    scalar = state.scalar
    effects = parameters.effects
    # 1. pressure
    set_point = 0.0
    if scalar[Scalar.BURST] == 0.0:
        set_point = compute_supply(parameters, command[4], scalar[Scalar.TIME] + dt)
    scalar[Scalar.SUPPLY_PRESSURE] = compute_lagged_pressure(
        effects.pressure_lag, scalar[Scalar.SUPPLY_PRESSURE], set_point, dt
    )
    scalar[Scalar.PRESSURE] = scalar[Scalar.SUPPLY_PRESSURE] - scalar[Scalar.DROOP]
    if has_burst(effects.burst_limit, scalar[Scalar.PRESSURE]):
        scalar[Scalar.BURST] = 1.0
        scalar[Scalar.SUPPLY_PRESSURE] = 0.0
        scalar[Scalar.DROOP] = 0.0
        scalar[Scalar.PRESSURE] = 0.0
    # 2. tendon
    scalar[Scalar.DRIVE_PULL] = command[3]
    scalar[Scalar.TRANSMITTED_PULL] = compute_transmitted_pull(
        effects.tendon_backlash, command[3], scalar[Scalar.TRANSMITTED_PULL]
    )
    # 3. eversion
    update_eversion(parameters, state, command, ws, dt)
    # 4. chain
    old = update_chain(parameters, state)
    update_covers(parameters, state, ws)
    _prepare(parameters, state, command, ws, old, dt)
    turned = command[2] - scalar[Scalar.ROLL]
    scalar[Scalar.ROLL] = command[2]
    n = state.links[0]
    for i in range(n + 1):
        state.roll[i] += turned
    _prepare_tendon(parameters, state, ws)
    # 5. equilibrium
    status = solve_equilibrium(parameters, state, command, ws, dt)
    # 6. records
    _record(state, ws, dt)
    update_histories(parameters, state, ws, dt)
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
    target.roll_anchor[:] = source.roll_anchor
    target.crept[:] = source.crept
    target.shear[:] = source.shear


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
    update_chain(parameters, state)
    place_chain(parameters, state, ws)
    for j in range(min(state.links[0], tangent.shape[0] - 1)):
        # Bend about the axis that turns this section's tangent into the next one's.
        for a in range(2):
            b = 1 - a
            across = 0.0
            for c in range(3):
                across += state.frame[j, c, b] * tangent[j + 1, c]
            state.bend[j, a] = math.asin(min(max(across, -1.0), 1.0)) * (-1.0 if a == 0 else 1.0)
        place_chain(parameters, state, ws)
    for i in range(state.links[0] + 1):
        state.roll[i] = scalar[Scalar.ROLL]
        if i < state.links[0]:
            state.roll_anchor[i] = scalar[Scalar.ROLL]
    scalar[Scalar.DRIVE_PULL] = command[3]
    scalar[Scalar.TRANSMITTED_PULL] = compute_transmitted_pull(
        parameters.effects.tendon_backlash, command[3], -math.inf
    )
    status = 0
    for _ in range(3):
        update_covers(parameters, state, ws)
        _prepare(parameters, state, command, ws, state.links[0] + 1, 1.0)
        _prepare_tendon(parameters, state, ws)
        status = solve_equilibrium(parameters, state, command, ws, 1.0)
        _record(state, ws, 1.0)
        update_histories(parameters, state, ws, 0.0)
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
