"""One link between two sections: its kinematics, and the energy of the springs that it stretches."""

from __future__ import annotations

import math

from evergym.effects.clearance_play import add_play
from evergym.effects.notch_closure import NotchClosureParameters, compute_closure
from evergym.effects.root_kink import compute_kink_moment
from evergym.effects.torsional_windup import compute_roll_friction, compute_torque_limit
from evergym.effects.wall_compliance import compute_wall_stretch
from evergym.effects.wall_pretension import compute_pretension_moment
from evergym.jit import njit
from evergym.lattice import compute_bundle
from evergym.state import Array, Parameters, Scalar, State, Workspace

__all__ = ["add_springs", "place_link"]

UNUSED_TWIST_SHARE = 1e-3
"""Torsional rigidity of a link without catheter, as a share of the catheter's: its roll needs some value."""


@njit
def place_link(
    j: int,
    length: float,
    px: float,
    py: float,
    shear: Array,
    link: Array,
    column: Array,
    half_column: Array,
    position: Array,
    frame: Array,
) -> None:
    """Place section j + 1 from section j and the bend between them, and the derivatives that the solver needs.

    The link is straight and points along the tangent halfway through its bend, so a uniformly bent link is exact to
    second order. Overwrites ``position[j + 1]``, ``frame[j + 1]``, and row j of the three arrays of derivatives.

    Args:
        j: Link.
        length: Its length [m].
        px: Bend about the first section's x [rad].
        py: Bend about its y [rad].
        shear: Sideways slide of each link over its length [1], shape (n, 2).
        link: Vector along each link [m], shape (n, 3).
        column: Derivative of the end rotation by the bends, shape (n, 2, 3).
        half_column: Derivative of the link's own rotation by the bends, shape (n, 2, 3).
        position: Node positions [m], shape (n + 1, 3).
        frame: Section frames, shape (n + 1, 3, 3).
    """
    square = px * px + py * py
    angle = math.sqrt(square)
    if angle > 1e-4:
        s1 = math.sin(angle) / angle
        c2 = (1.0 - math.cos(angle)) / square
        s2 = (1.0 - s1) / square
        half = 0.5 * angle
        h1 = math.sin(half) / half
        hc2 = (1.0 - math.cos(half)) / (half * half)
        hs2 = (1.0 - h1) / (half * half)
    else:
        s1 = 1.0 - square / 6.0
        c2 = 0.5 - square / 24.0
        s2 = 1.0 / 6.0 - square / 120.0
        h1 = 1.0 - square / 24.0
        hc2 = 0.5 - square / 96.0
        hs2 = 1.0 / 6.0 - square / 480.0
    qx = 0.5 * px
    qy = 0.5 * py
    # Direction of the link, in the first section's frame: the tangent turned by half the bend.
    dx = h1 * qy
    dy = -h1 * qx
    dz = 1.0 - hc2 * (qx * qx + qy * qy)
    sx = shear[j, 0]
    sy = shear[j, 1]
    if sx != 0.0 or sy != 0.0:
        # The slide turns with the link.
        dx += sx * (1.0 - hc2 * qy * qy) + sy * hc2 * qx * qy
        dy += sx * hc2 * qx * qy + sy * (1.0 - hc2 * qx * qx)
        dz += h1 * (sy * qx - sx * qy)
    # Columns of the end rotation exp(bend).
    e00 = 1.0 - c2 * py * py
    e01 = c2 * px * py
    e11 = 1.0 - c2 * px * px
    for a in range(3):
        r0 = frame[j, a, 0]
        r1 = frame[j, a, 1]
        r2 = frame[j, a, 2]
        step = length * (r0 * dx + r1 * dy + r2 * dz)
        link[j, a] = step
        position[j + 1, a] = position[j, a] + step
        frame[j + 1, a, 0] = r0 * e00 + r1 * e01 - r2 * s1 * py
        frame[j + 1, a, 1] = r0 * e01 + r1 * e11 + r2 * s1 * px
        frame[j + 1, a, 2] = r0 * s1 * py - r1 * s1 * px + r2 * (1.0 - c2 * square)
        # Left Jacobian of the exponential map, its first two columns turned into the world.
        column[j, 0, a] = r0 * (s1 + s2 * px * px) + r1 * s2 * px * py - r2 * c2 * py
        column[j, 1, a] = r0 * s2 * px * py + r1 * (s1 + s2 * py * py) + r2 * c2 * px
        half_column[j, 0, a] = 0.5 * (r0 * (h1 + hs2 * qx * qx) + r1 * hs2 * qx * qy - r2 * hc2 * qy)
        half_column[j, 1, a] = 0.5 * (r0 * hs2 * qx * qy + r1 * (h1 + hs2 * qy * qy) + r2 * hc2 * qx)


@njit
def _add_catheter(
    bundle: Array,
    share: float,
    length: float,
    bend_x: float,
    bend_y: float,
    c: float,
    s: float,
    closure: NotchClosureParameters,
    section: Array,
    gradient: Array,
    hessian: Array,
) -> float:
    """Bend a catheter bundle that is rolled by the angle with cosine c and sine s, and return its energy."""
    cx = c * bend_x + s * bend_y
    cy = -s * bend_x + c * bend_y
    compute_bundle(bundle, 0.0, cx, cy, length, section)
    mx = share * section[1]
    my = share * section[2]
    kxx = share * section[3]
    kxy = share * section[4]
    kyy = share * section[5]
    energy = share * section[0]
    if closure.stiffness > 0.0:
        closed, moment, stiffness = compute_closure(closure, cy, length)
        energy += share * closed
        my += share * moment
        kyy += share * stiffness
    gradient[0] += c * mx - s * my
    gradient[1] += s * mx + c * my
    # Rolling turns the bend in the catheter's frame at the rate (cy, -cx).
    by_roll = mx * cy - my * cx
    vx = kxx * cy - kxy * cx - my
    vy = kxy * cy - kyy * cx + mx
    roll_x = c * vx - s * vy
    roll_y = s * vx + c * vy
    roll_roll = kxx * cy * cy - 2.0 * kxy * cx * cy + kyy * cx * cx - mx * cx - my * cy
    # The roll halfway is that of the first node and half the twist.
    gradient[2] += 0.5 * by_roll
    gradient[3] += by_roll
    hessian[0, 0] += c * c * kxx - 2.0 * c * s * kxy + s * s * kyy
    hessian[0, 1] += c * s * (kxx - kyy) + (c * c - s * s) * kxy
    hessian[1, 1] += s * s * kxx + 2.0 * c * s * kxy + c * c * kyy
    hessian[0, 2] += 0.5 * roll_x
    hessian[1, 2] += 0.5 * roll_y
    hessian[0, 3] += roll_x
    hessian[1, 3] += roll_y
    hessian[2, 2] += 0.25 * roll_roll
    hessian[2, 3] += 0.5 * roll_roll
    hessian[3, 3] += roll_roll
    return float(energy)


@njit
def _sum_braces(bundle: Array) -> float:
    """Return the moment per twist rate [N m^2] with which a bundle's braces resist twist."""
    total = 0.0
    for i in range(bundle.shape[0]):
        total += bundle[i, 5] * (bundle[i, 1] ** 2 + bundle[i, 2] ** 2)
    return total


@njit
def _sum_stiffness(bundle: Array) -> float:
    """Return the bending stiffness [N m^2] of a bundle whose fibres are all taut, about y."""
    total = 0.0
    for i in range(bundle.shape[0]):
        total += bundle[i, 0] * bundle[i, 1] * bundle[i, 1]
    return total


@njit
def add_springs(
    parameters: Parameters, state: State, ws: Workspace, bend: Array, roll: Array, dt: float
) -> tuple[float, float]:
    """Overwrite the links' derivatives by bends, twist and first roll, and return their energy [J] and the tendon's
    path [m].

    The forces, in this order: sheath fibres under pressure (or the kink at the root), flexible and proximal catheter
    fibres, the catheter's play at the base in series with them, torsional braces, the tail's grip on the catheter's
    roll, damping in the fibres, the tail of a buckled column, the wall's pre-tension. The tendon's own energy is left
    to the caller.

    Args:
        parameters: `Parameters`.
        state: `State`; uses lengths, pressure and buckling.
        ws: Workspace; ``link_gradient``, ``link_hessian`` and ``tendon`` are overwritten.
        bend: Bends [rad], shape (n, 2).
        roll: Rolls of the nodes [rad], shape (n + 1,).
        dt: Step [s].
    """
    robot = parameters.robot
    section = ws.section
    effects = parameters.effects
    root_kink = effects.root_kink
    pressure = state.scalar[Scalar.PRESSURE]
    area = math.pi * robot.sheath_radius * robot.sheath_radius
    thrust = max(pressure, 0.0) * area * compute_wall_stretch(effects.wall_compliance.hoop, pressure) ** 2
    play = effects.clearance_play
    pretension = compute_pretension_moment(effects.wall_pretension, pressure, area)
    torque_limit = 0.0
    if effects.torsional_windup.mu > 0.0:
        torque_limit = compute_torque_limit(effects.torsional_windup, pressure, robot.catheter_radius)
    buckling_moment = 0.0
    if state.scalar[Scalar.BUCKLED] > 0.0:
        # The taut tail bears on the inside of the bend, one sheath radius off the axis.
        buckling_moment = state.scalar[Scalar.BUCKLING_FORCE] * robot.sheath_radius
    catheter_damping = robot.damping_time / dt * _sum_stiffness(robot.flexible_bundle)
    flexible_braces = _sum_braces(robot.flexible_bundle)
    proximal_braces = _sum_braces(robot.proximal_bundle)
    unused_braces = UNUSED_TWIST_SHARE * flexible_braces
    sheath_damping = robot.damping_time / dt * _sum_stiffness(robot.sheath_bundle)
    uncut = NotchClosureParameters(0.0, 0.0)
    energy = 0.0
    path = 0.0
    for j in range(state.links[0]):
        length = state.length[j]
        gradient = ws.link_gradient[j]
        hessian = ws.link_hessian[j]
        tendon = ws.tendon[j]
        gradient[:] = 0.0
        hessian[:] = 0.0
        tendon[:] = 0.0
        bend_x = bend[j, 0]
        bend_y = bend[j, 1]
        sheath_share = ws.cover[j, 0] / length
        if sheath_share > 0.0:
            # Creep takes over a part of the bend; the springs feel the rest.
            wall_x = bend_x - state.crept[j, 0] * length
            wall_y = bend_y - state.crept[j, 1] * length
            hinge = 0.0
            if j == 0 and (root_kink.moment > 0.0 or root_kink.share > 0.0):
                hinge = compute_kink_moment(root_kink, pressure, robot.sheath_radius)
            if hinge > 0.0:
                # Elastic at first, then the kink's constant moment.
                compute_bundle(robot.sheath_bundle, 1.0, 0.0, 0.0, length, section)
                width = hinge / section[3]
                root = math.sqrt(wall_x * wall_x + wall_y * wall_y + width * width)
                energy += hinge * (root - width)
                gradient[0] += hinge * wall_x / root
                gradient[1] += hinge * wall_y / root
                hessian[0, 0] += hinge / root * (1.0 - wall_x * wall_x / (root * root))
                hessian[0, 1] -= hinge / root * wall_x * wall_y / (root * root)
                hessian[1, 1] += hinge / root * (1.0 - wall_y * wall_y / (root * root))
            else:
                compute_bundle(robot.sheath_bundle, thrust, wall_x, wall_y, length, section)
                energy += sheath_share * section[0]
                gradient[0] += sheath_share * section[1]
                gradient[1] += sheath_share * section[2]
                hessian[0, 0] += sheath_share * section[3]
                hessian[0, 1] += sheath_share * section[4]
                hessian[1, 1] += sheath_share * section[5]
        has_play = j == 0 and play.angle > 0.0
        sheath_x = sheath_y = sheath_xx = sheath_xy = sheath_yy = tilt_x = tilt_y = 0.0
        if has_play:
            # The catheter feels what is beyond the play, the sheath all of it: its derivatives wait.
            sheath_x, sheath_y = gradient[0], gradient[1]
            sheath_xx, sheath_xy, sheath_yy = hessian[0, 0], hessian[0, 1], hessian[1, 1]
            gradient[:] = 0.0
            hessian[:] = 0.0
            # The play lies about the catheter's own bend, whose direction is that of the step's start.
            natural = robot.pre_curvature * ws.cover[j, 1]
            middle = 0.5 * (ws.previous_roll[j] + ws.previous_roll[j + 1])
            natural_x = -natural * math.sin(middle)
            natural_y = natural * math.cos(middle)
            tilt_x = bend_x - natural_x
            tilt_y = bend_y - natural_y
            size = math.sqrt(tilt_x * tilt_x + tilt_y * tilt_y)
            elastic = 1.0 - play.angle / size if size > play.angle else 0.0
            bend_x = natural_x + elastic * tilt_x
            bend_y = natural_y + elastic * tilt_y
        twist = roll[j + 1] - roll[j]
        flexible = ws.cover[j, 1] / length
        proximal = ws.cover[j, 2] / length
        arm = 0.0
        if flexible > 0.0 or proximal > 0.0:
            middle = 0.5 * (roll[j] + roll[j + 1])
            c = math.cos(middle)
            s = math.sin(middle)
            if flexible > 0.0:
                energy += _add_catheter(
                    robot.flexible_bundle,
                    flexible,
                    length,
                    bend_x,
                    bend_y,
                    c,
                    s,
                    effects.notch_closure,
                    section,
                    gradient,
                    hessian,
                )
            if proximal > 0.0:
                energy += _add_catheter(
                    robot.proximal_bundle,
                    proximal,
                    length,
                    bend_x,
                    bend_y,
                    c,
                    s,
                    uncut,
                    section,
                    gradient,
                    hessian,
                )
            # The tendon lies at (arm, 0) of the catheter's frame: bending towards it, about y, shortens its path.
            if not has_play or play.tendon_crosses:
                arm = robot.tendon_arm * flexible
                tendon[0] = -arm * s
                tendon[1] = arm * c
                tendon[3] = -arm * (c * bend[j, 0] + s * bend[j, 1])
                tendon[2] = 0.5 * tendon[3]
        bend_x = bend[j, 0]
        bend_y = bend[j, 1]
        if has_play:
            energy += add_play(play, tilt_x, tilt_y, gradient, hessian)
            gradient[0] += sheath_x
            gradient[1] += sheath_y
            hessian[0, 0] += sheath_xx
            hessian[0, 1] += sheath_xy
            hessian[1, 1] += sheath_yy
        braces = (flexible * flexible_braces + proximal * proximal_braces + unused_braces) / length
        energy += 0.5 * braces * twist * twist
        gradient[2] += braces * twist
        hessian[2, 2] += braces
        if torque_limit > 0.0:
            gripped = min(ws.cover[j, 0], ws.cover[j, 1] + ws.cover[j, 2])
            if gripped > 0.0:
                angle = 0.5 * (roll[j] + roll[j + 1]) - state.roll_anchor[j]
                work, torque, stiffness = compute_roll_friction(
                    torque_limit * gripped, angle, effects.torsional_windup.presliding
                )
                energy += work
                gradient[2] += 0.5 * torque
                gradient[3] += torque
                hessian[2, 2] += 0.25 * stiffness
                hessian[2, 3] += 0.5 * stiffness
                hessian[3, 3] += stiffness
        if robot.damping_time > 0.0:
            # Dashpots along the fibres, as stiff as the taut fibres of the catheter, or else of the sheath.
            damping = (catheter_damping if flexible > 0.0 else sheath_damping) / length
            ux = bend_x - ws.previous_bend[j, 0]
            uy = bend_y - ws.previous_bend[j, 1]
            energy += 0.5 * damping * (ux * ux + uy * uy)
            gradient[0] += damping * ux
            gradient[1] += damping * uy
            hessian[0, 0] += damping
            hessian[1, 1] += damping
            twisting = robot.damping_time / dt * braces
            ut = twist - (ws.previous_roll[j + 1] - ws.previous_roll[j])
            energy += 0.5 * twisting * ut * ut
            gradient[2] += twisting * ut
            hessian[2, 2] += twisting
        if buckling_moment > 0.0 and sheath_share > 0.0:
            moment = buckling_moment * sheath_share
            energy -= moment * (state.scalar[Scalar.BUCKLING_X] * bend_x + state.scalar[Scalar.BUCKLING_Y] * bend_y)
            gradient[0] -= moment * state.scalar[Scalar.BUCKLING_X]
            gradient[1] -= moment * state.scalar[Scalar.BUCKLING_Y]
        if pretension != 0.0 and sheath_share > 0.0:
            moment_x = -pretension * sheath_share * effects.wall_pretension.sine
            moment_y = pretension * sheath_share * effects.wall_pretension.cosine
            energy -= moment_x * bend_x + moment_y * bend_y
            gradient[0] -= moment_x
            gradient[1] -= moment_y
        path += tendon[1] * bend_y + tendon[0] * bend_x - arm * robot.pre_curvature * length
    return energy, path
