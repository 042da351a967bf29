"""Contact of one section with the duct's wall and the pegs: compliant normal force, damping, Coulomb friction."""

from __future__ import annotations

import math

from evergym.duct_models.field import WallField, compute_wall_distance
from evergym.duct_models.pegs import compute_peg_distance
from evergym.effects.contact_friction import ContactFrictionParameters
from evergym.effects.duct_compliance import DuctComplianceParameters, compute_wall_force
from evergym.jit import njit
from evergym.state import Array

__all__ = ["add_contact", "add_friction"]


@njit
def _add_spring(
    force: float, stiffness: float, normal: Array, curvature: Array, gradient: Array, hessian: Array
) -> None:
    """Add a spring along the distance's gradient; the wall's curvature is part of the Hessian."""
    for a in range(3):
        gradient[a] -= force * normal[a]
        for b in range(3):
            hessian[a, b] += stiffness * normal[a] * normal[b] - force * curvature[a, b]


@njit
def add_contact(
    has_wall: bool,
    wall: WallField,
    pegs: Array,
    law: DuctComplianceParameters,
    friction: ContactFrictionParameters,
    point: Array,
    radius: float,
    tributary: float,
    previous_depth: float,
    dt: float,
    normal: Array,
    curvature: Array,
    gradient: Array,
    hessian: Array,
) -> tuple[float, float, float]:
    """Add the contact of a sphere at ``point`` and return its energy [J], largest depth [m] and friction limit mu N
    [N].

    Args:
        has_wall: Whether there is a duct.
        wall: Its `WallField`.
        pegs: shape (k, 7).
        law: `DuctComplianceParameters`.
        friction: `ContactFrictionParameters`.
        point: Centre [m], shape (3,).
        radius: Radius of the robot here [m].
        tributary: Length of robot that bears on this contact [m].
        previous_depth: Depth at the start of the step [m], for the damping.
        dt: Step [s].
        normal: Scratch for the distance's gradient, shape (3,).
        curvature: Scratch for its second derivatives, shape (3, 3).
        gradient: Energy's derivative by the point [N], shape (3,), accumulated.
        hessian: Its second derivative [N/m], shape (3, 3), accumulated.
    """
    energy = 0.0
    deepest = 0.0
    friction_limit = 0.0
    if has_wall:
        depth = radius - compute_wall_distance(wall, point, normal, curvature)
        if depth > 0.0:
            work, force, stiffness = compute_wall_force(law.stiffness * tributary, law.depth, depth)
            friction_limit += friction.mu_tissue * force
            energy += work
            pressed = depth - previous_depth
            if pressed > 0.0:
                damping = law.damping_time * law.stiffness * tributary / dt
                energy += 0.5 * damping * pressed * pressed
                force += damping * pressed
                stiffness += damping
            _add_spring(force, stiffness, normal, curvature, gradient, hessian)
            deepest = depth
    for k in range(pegs.shape[0]):
        depth = radius - compute_peg_distance(pegs[k], point, normal, curvature)
        if depth > 0.0:
            stiffness = law.peg_stiffness * tributary
            force = stiffness * depth
            friction_limit += friction.mu_peg * force
            energy += 0.5 * force * depth
            _add_spring(force, stiffness, normal, curvature, gradient, hessian)
            deepest = max(deepest, depth)
    return energy, deepest, friction_limit


@njit
def add_friction(
    limit: float, normal: Array, point: Array, reference: Array, slip_distance: float, gradient: Array, hessian: Array
) -> float:
    """Add regularised Coulomb friction against sliding from ``reference`` and return its potential [J].

    The potential limit * (sqrt(u^2 + e^2) - e) of the tangential motion u is convex: its force opposes the motion and
    tends to the limit. The limit and the normal are those of the last step, so that the potential exists.

    Args:
        limit: mu N [N].
        normal: Unit normal of the contact, shape (3,).
        point: Where the section is [m], shape (3,).
        reference: Where it would be without sliding [m], shape (3,).
        slip_distance: e, the motion at which the force is 0.7 of the limit [m].
        gradient: [N], shape (3,), accumulated.
        hessian: [N/m], shape (3, 3), accumulated.
    """
    ux = point[0] - reference[0]
    uy = point[1] - reference[1]
    uz = point[2] - reference[2]
    along = ux * normal[0] + uy * normal[1] + uz * normal[2]
    ux -= along * normal[0]
    uy -= along * normal[1]
    uz -= along * normal[2]
    root = math.sqrt(ux * ux + uy * uy + uz * uz + slip_distance * slip_distance)
    u = (ux, uy, uz)
    scale = limit / root
    for a in range(3):
        gradient[a] += scale * u[a]
        for b in range(3):
            projector = (1.0 if a == b else 0.0) - normal[a] * normal[b]
            hessian[a, b] += scale * (projector - u[a] * u[b] / (root * root))
    return limit * (root - slip_distance)
