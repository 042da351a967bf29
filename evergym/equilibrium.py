"""The energy of one implicit step, and the Newton method that finds its minimum.

The unknowns are the two bends and the twist of every link; the sections follow from them by exact kinematics, so the
axis is inextensible and no stiff mode exists. The energy is a sum over links (springs) and nodes (inertia, weight,
contact), hence its Newton step is a linear-quadratic control problem: `evergym.riccati` solves it from tip to base at
a cost linear in the number of links, and the step is applied from base to tip with feedback on the motion that the
sections really make.
"""

from __future__ import annotations

import math

from evergym.contact import add_contact, add_friction
from evergym.effects.tendon_friction import compute_rubbing_tendon
from evergym.jit import njit
from evergym.links import add_springs, place_link
from evergym.riccati import sweep_back
from evergym.state import Array, Parameters, Scalar, State, Workspace

__all__ = ["Status", "add_contacts", "solve_equilibrium"]

LINE_SEARCH_MAX = 14
DAMPING_MIN = 1e-2
DAMPING_MAX = 1e6
"""Range of the Levenberg damping, tried only after a line search that failed."""

ROUND_OFF = 1e-13
"""Share of the energy's magnitude below which a change of it means nothing."""


class Status:
    """Status codes of the kernels."""

    CONVERGED = 0
    NOT_CONVERGED = 1
    NOT_FINITE = 2


@njit
def _add_nodes(
    parameters: Parameters, state: State, command: Array, ws: Workspace, position: Array, frame: Array, dt: float
) -> float:
    """Overwrite the nodes' derivatives and the workspace's contact records, and return the nodes' energy [J].

    The forces, in this order: inertia, weight, the load on the tip, contact, friction.
    """
    world = parameters.world
    touching = world.has_wall or world.pegs.shape[0] > 0
    share = parameters.effects.saline_weight.share
    wx = share * world.gravity[0]
    wy = share * world.gravity[1]
    wz = share * world.gravity[2]
    n = state.links[0]
    energy = 0.0
    for i in range(1, n + 1):
        gradient = ws.node_gradient[i]
        hessian = ws.node_hessian[i]
        gradient[:] = 0.0
        hessian[:] = 0.0
        mass = ws.mass[i]
        inertia = mass / (dt * dt)
        ux = position[i, 0] - ws.predicted[i, 0]
        uy = position[i, 1] - ws.predicted[i, 1]
        uz = position[i, 2] - ws.predicted[i, 2]
        energy += 0.5 * inertia * (ux * ux + uy * uy + uz * uz)
        energy -= mass * (wx * position[i, 0] + wy * position[i, 1] + wz * position[i, 2])
        gradient[0] = inertia * ux - mass * wx
        gradient[1] = inertia * uy - mass * wy
        gradient[2] = inertia * uz - mass * wz
        hessian[0, 0] = inertia
        hessian[1, 1] = inertia
        hessian[2, 2] = inertia
        if i == n:
            along = 0.0
            if not parameters.effects.axial_buckling.enabled:
                # The axis takes what presses along the port: taken along the tip, P sin(theta) would be left.
                port = parameters.world.port_frame
                along = command[5] * port[0, 2] + command[6] * port[1, 2] + command[7] * port[2, 2]
                along = min(along, 0.0)
            for a in range(3):
                load = command[5 + a] - along * parameters.world.port_frame[a, 2]
                energy -= load * position[i, a]
                gradient[a] -= load
    if touching:
        energy += add_contacts(parameters, state, ws, position, frame, dt)
    return energy


@njit
def add_contacts(
    parameters: Parameters, state: State, ws: Workspace, position: Array, frame: Array, dt: float
) -> float:
    """Add contact and friction to the nodes' derivatives, record the contacts, and return their energy [J]."""
    gradient = ws.contact_gradient
    hessian = ws.contact_hessian
    point = ws.point
    n = state.links[0]
    slip = parameters.effects.contact_friction.sliding_speed * dt
    energy = 0.0
    for i in range(1, n + 1):
        # The contact of the tip is that of its rounded end, whose centre lies one radius back.
        back = ws.contact_radius[i] if i == n else 0.0
        for a in range(3):
            point[a] = position[i, a] - back * frame[i, a, 2]
        gradient[:] = 0.0
        hessian[:] = 0.0
        work, depth, limit = add_contact(
            parameters.world.has_wall,
            parameters.world.wall,
            parameters.world.pegs,
            parameters.effects.duct_compliance,
            parameters.effects.contact_friction,
            point,
            ws.contact_radius[i],
            ws.tributary[i],
            state.depth[i],
            dt,
            ws.gradient,
            ws.hessian,
            gradient,
            hessian,
        )
        energy += work
        ws.depth[i] = depth
        ws.friction_limit[i] = limit
        for a in range(3):
            ws.contact_force[i, a] = -gradient[a]
        if i == n:
            stiffness = 0.0
            for a in range(3):
                for b in range(3):
                    stiffness += frame[i, a, 2] * hessian[a, b] * frame[i, b, 2]
            ws.tip_stiffness[0] = max(stiffness, 0.0)
        if state.friction_limit[i] > 0.0:
            energy += add_friction(
                state.friction_limit[i], ws.normal[i], point, ws.reference[i], slip, gradient, hessian
            )
        elif depth <= 0.0:
            continue
        for a in range(3):
            ws.node_gradient[i, a] += gradient[a]
            for b in range(3):
                ws.node_hessian[i, a, b] += hessian[a, b]
        if i == n:
            _add_lever(back, frame[i], gradient, hessian, ws.node_gradient[i], ws.node_hessian[i])
    return energy


@njit
def _add_lever(back: float, frame: Array, force: Array, stiffness: Array, gradient: Array, hessian: Array) -> None:
    """Add the rotational derivatives of an energy of the point x - back * tangent, given its translational ones."""
    lx = -back * frame[0, 2]
    ly = -back * frame[1, 2]
    lz = -back * frame[2, 2]
    gradient[3] += ly * force[2] - lz * force[1]
    gradient[4] += lz * force[0] - lx * force[2]
    gradient[5] += lx * force[1] - ly * force[0]
    for a in range(3):
        m0 = ly * stiffness[a, 2] - lz * stiffness[a, 1]
        m1 = lz * stiffness[a, 0] - lx * stiffness[a, 2]
        m2 = lx * stiffness[a, 1] - ly * stiffness[a, 0]
        hessian[a, 3] += m0
        hessian[a, 4] += m1
        hessian[a, 5] += m2
        hessian[3, a] += m0
        hessian[4, a] += m1
        hessian[5, a] += m2
    for a in range(3):
        m0 = hessian[0, 3 + a]
        m1 = hessian[1, 3 + a]
        m2 = hessian[2, 3 + a]
        hessian[3, 3 + a] += ly * m2 - lz * m1
        hessian[4, 3 + a] += lz * m0 - lx * m2
        hessian[5, 3 + a] += lx * m1 - ly * m0
    lever = (lx, ly, lz)
    along = lx * force[0] + ly * force[1] + lz * force[2]
    for a in range(3):
        hessian[3 + a, 3 + a] -= along
        for b in range(3):
            hessian[3 + a, 3 + b] += 0.5 * (force[a] * lever[b] + force[b] * lever[a])


@njit
def _evaluate(
    parameters: Parameters,
    state: State,
    command: Array,
    ws: Workspace,
    bend: Array,
    roll: Array,
    position: Array,
    frame: Array,
    dt: float,
    place: bool,
) -> tuple[float, float, float]:
    """Place all sections, overwrite all derivatives, and return energy [J], the tendon's compliance [m/N], which is 0
    where it is slack, and the tension [N] that the drive feels.

    With ``place`` false the sections lie where the bends put them already.
    """
    n = state.links[0]
    if place:
        for j in range(n):
            place_link(
                j,
                state.length[j],
                bend[j, 0],
                bend[j, 1],
                state.shear,
                ws.link,
                ws.column,
                ws.half_column,
                position,
                frame,
            )
    energy, path = add_springs(parameters, state, ws, bend, roll, dt)
    energy += _add_nodes(parameters, state, command, ws, position, frame, dt)
    stretch = state.scalar[Scalar.TRANSMITTED_PULL] - path
    if not parameters.robot.has_catheter or state.scalar[Scalar.CATHETER_LENGTH] <= 0.0:
        stretch = -1.0
    ws.rubbing[1] = path
    line = 0.0
    drive_tension = 0.0
    if stretch > 0.0:
        line = parameters.effects.tendon_stretch.compliance
        tension = stretch / line
        drive_tension = tension
        if ws.rubbing[0] > 0.0:
            work, tension, line = compute_rubbing_tendon(
                ws.rubbing[0],
                state.scalar[Scalar.TRANSMITTED_PULL],
                path,
                state.scalar[Scalar.TENDON_PATH],
                state.scalar[Scalar.TENDON_SLIDE],
                parameters.effects.tendon_friction.presliding,
                line,
            )
            energy += work
        else:
            energy += 0.5 * stretch * tension
        for j in range(n):
            c1 = ws.tendon[j, 1]
            c0 = ws.tendon[j, 0]
            # The path's second derivatives: by bend and roll, and by roll twice; half of the twist rolls the middle.
            along = tension * (c0 * bend[j, 0] + c1 * bend[j, 1])
            for a in range(4):
                ws.link_gradient[j, a] -= tension * ws.tendon[j, a]
            ws.link_hessian[j, 0, 2] += 0.5 * tension * c1
            ws.link_hessian[j, 0, 3] += tension * c1
            ws.link_hessian[j, 1, 2] -= 0.5 * tension * c0
            ws.link_hessian[j, 1, 3] -= tension * c0
            ws.link_hessian[j, 2, 2] += 0.25 * along
            ws.link_hessian[j, 2, 3] += 0.5 * along
            ws.link_hessian[j, 3, 3] += along
    return energy, line, drive_tension


@njit
def _apply_step(step: float, scale: float, n: int, ws: Workspace, state: State) -> None:
    """Overwrite the trial bends and rolls with a step of size ``scale``, section by section from the base.

    Each link answers to the motion of its first section that the trial really makes: the trial positions are placed as
    it goes.
    """
    for j in range(n):
        d0 = ws.position[j, 0] - state.position[j, 0]
        d1 = ws.position[j, 1] - state.position[j, 1]
        d2 = ws.position[j, 2] - state.position[j, 2]
        w0 = w1 = w2 = 0.0
        for k in range(3):
            a0 = state.frame[j, 0, k]
            a1 = state.frame[j, 1, k]
            a2 = state.frame[j, 2, k]
            b0 = ws.frame[j, 0, k]
            b1 = ws.frame[j, 1, k]
            b2 = ws.frame[j, 2, k]
            w0 += a1 * b2 - a2 * b1
            w1 += a2 * b0 - a0 * b2
            w2 += a0 * b1 - a1 * b0
        turn = ws.roll[j] - state.roll[j]
        gain = ws.gain[j]
        for a in range(3):
            u = scale * (ws.feed_forward[j, 0, a] + step * ws.feed_forward[j, 1, a])
            u += gain[a, 0] * d0 + gain[a, 1] * d1 + gain[a, 2] * d2
            u += 0.5 * (gain[a, 3] * w0 + gain[a, 4] * w1 + gain[a, 5] * w2) + gain[a, 6] * turn
            if a < 2:
                ws.bend[j, a] = state.bend[j, a] + u
            else:
                ws.roll[j + 1] = ws.roll[j] + state.roll[j + 1] - state.roll[j] + u
        place_link(
            j,
            state.length[j],
            ws.bend[j, 0],
            ws.bend[j, 1],
            state.shear,
            ws.link,
            ws.column,
            ws.half_column,
            ws.position,
            ws.frame,
        )


@njit
def _accept(n: int, ws: Workspace, state: State) -> None:
    for i in range(n + 1):
        state.roll[i] = ws.roll[i]
        for a in range(3):
            state.position[i, a] = ws.position[i, a]
            for b in range(3):
                state.frame[i, a, b] = ws.frame[i, a, b]
        if i < n:
            state.bend[i, 0] = ws.bend[i, 0]
            state.bend[i, 1] = ws.bend[i, 1]


@njit
def solve_equilibrium(parameters: Parameters, state: State, command: Array, ws: Workspace, dt: float) -> int:
    """Move ``state`` to the minimum of the step's energy; its sections must be placed, its first roll set.

    Args:
        parameters: `Parameters`.
        state: `State`; bends, rolls, positions and frames are overwritten, and the tendon's tension.
        command: Command, see `evergym.stepper`, shape (8,).
        ws: `Workspace`, its step-constant rows filled by `evergym.stepper`.
        dt: Step [s].

    Returns:
        A `Status` code.
    """
    n = state.links[0]
    energy, line, tension = _evaluate(
        parameters, state, command, ws, state.bend, state.roll, state.position, state.frame, dt, True
    )
    for i in range(n + 1):
        ws.roll[i] = state.roll[i]
    for a in range(3):
        ws.position[0, a] = state.position[0, a]
        for b in range(3):
            ws.frame[0, a, b] = state.frame[0, a, b]
    status = 1
    damping = 0.0
    for _ in range(parameters.numerics.iterations_max):
        state.scalar[Scalar.ITERATIONS] += 1.0
        slope, mixed, tendon = sweep_back(n, ws, damping)
        if not (math.isfinite(slope) and math.isfinite(energy)):
            return 2
        # The tendon joins all links: a rank-one term, by Sherman and Morrison from a second right-hand side.
        weight = 0.0
        decrease = slope
        if line > 0.0:
            weight = mixed / (line + tendon)
            decrease -= mixed * weight
        decrease *= 0.5
        if decrease <= parameters.numerics.energy_tolerance * 1e-6:
            status = 0
            break
        scale = 1.0
        accepted = False
        margin = ROUND_OFF * abs(energy)
        for _ in range(LINE_SEARCH_MAX):
            _apply_step(-weight, scale, n, ws, state)
            trial, trial_line, trial_tension = _evaluate(
                parameters, state, command, ws, ws.bend, ws.roll, ws.position, ws.frame, dt, False
            )
            if trial <= energy - 1e-4 * scale * decrease + margin:
                accepted = True
                break
            scale *= 0.5
        if not accepted:
            energy, line, tension = _evaluate(
                parameters, state, command, ws, state.bend, state.roll, state.position, state.frame, dt, True
            )
            if decrease <= parameters.numerics.energy_tolerance * 1e3 or damping >= DAMPING_MAX:
                # No step lowers the energy: it is a minimum to rounding, or the derivatives fail at a kink of the
                # energy.
                status = 0 if decrease <= parameters.numerics.energy_tolerance * 1e3 else 1
                break
            damping = max(10.0 * damping, DAMPING_MIN)
            continue
        damping = 0.1 * damping if damping > DAMPING_MIN else 0.0
        energy = trial
        line = trial_line
        tension = trial_tension
        _accept(n, ws, state)
        # Newton converges quadratically: after a full step of this decrease the next would be of its square.
        if scale == 1.0 and decrease <= parameters.numerics.energy_tolerance:
            status = 0
            break
    state.scalar[Scalar.TENDON_TENSION] = tension
    return status
