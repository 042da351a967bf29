"""What the kernels read and write: the robot's state, its constant parameters, the world, and scratch space."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evergym.duct_models.field import WallField
from evergym.effects.catalogue import EffectParameters

__all__ = [
    "Array",
    "NumericsParameters",
    "RobotParameters",
    "Scalar",
    "State",
    "Workspace",
    "WorldParameters",
    "copy_state",
    "create_state",
    "create_workspace",
]

Array = NDArray[np.float64]


class Scalar(IntEnum):
    """Index into `State.scalar`; SI units."""

    TIME = 0
    EVERTED_LENGTH = 1
    CATHETER_LENGTH = 2
    FED_LENGTH = 3
    """Tail fed in through the base since the robot was flat: 2 x everted length + slack."""
    PRESSURE = 4
    DRIVE_PULL = 5
    TRANSMITTED_PULL = 6
    ROLL = 7
    GROWTH_RATE = 8
    MOVING = 9
    """1 while the tip everts (the yield is kinetic), else 0."""
    TENDON_TENSION = 10
    TAIL_TENSION = 11
    BUCKLED = 12
    BURST = 13
    BUCKLING_X = 14
    BUCKLING_Y = 15
    """Direction, in the sections' frame, of the bend that the taut tail of a buckled column makes."""
    TIP_STIFFNESS = 16
    """Stiffness of the contact at the tip along the tip's direction [N/m]."""
    BUCKLING_FORCE = 17
    ITERATIONS = 18
    """Newton iterations since the reset."""
    SUBSTEPS = 19
    WALL_FORCE_MAX = 20
    """Largest contact force on one section [N]."""
    WALL_FORCE_SUM = 21
    CONTACT_COUNT = 22
    PENETRATION_MAX = 23
    SUPPLY_PRESSURE = 24
    """Pressure of the supply behind its lag; the robot's own is lower by the droop."""
    DROOP = 25
    WALL_LENGTH = 26
    """Everted length as the pressure stretches it."""
    TENDON_PATH = 27
    """By which the catheter's bend shortens the tendon [m]."""
    TENDON_SLIDE = 28
    """State of the tendon's friction: 1 while it is pulled, -1 while it is paid out."""
    COUNT = 29


class State(NamedTuple):
    """The robot's whole state; C-contiguous float64 arrays that a copy restores bit for bit.

    Node i lies at arclength i h from the port along the robot, the last node at its tip; link i joins nodes i and i
    + 1. The sections' frames have no twist (Bishop's frame); the catheter turns in them by its own roll.
    """

    scalar: Array
    """See `Scalar`, shape (Scalar.COUNT,)."""
    links: NDArray[np.int64]
    """Number of links in use, shape (1,)."""
    length: Array
    """Length of each link [m], shape (n,)."""
    bend: Array
    """Rotation over each link about its first section's x and y [rad], shape (n, 2)."""
    roll: Array
    """Roll of the catheter in the section's frame [rad], shape (n + 1,)."""
    position: Array
    """Node positions [m], shape (n + 1, 3)."""
    frame: Array
    """Section frames, columns x, y and tangent, shape (n + 1, 3, 3)."""
    velocity: Array
    """Node velocities [m/s], shape (n + 1, 3)."""
    contact_force: Array
    """Normal force of wall and pegs on each node [N], shape (n + 1, 3)."""
    friction_limit: Array
    """Largest friction force at each node, mu N [N], shape (n + 1,)."""
    depth: Array
    """Indentation of the wall or peg at each node [m], shape (n + 1,)."""
    roll_anchor: Array
    """Roll at which the sheath's friction holds the catheter, of each link [rad], shape (n,)."""
    crept: Array
    """Curvature that the wall has taken as its own by creep, of each link, about x and y [1/m], shape (n, 2)."""
    shear: Array
    """Sideways slide of each link over its length, along x and y [1], shape (n, 2)."""


def create_state(links: int) -> State:
    """Return a zero state with room for ``links`` links."""
    return State(
        scalar=np.zeros(int(Scalar.COUNT)),
        links=np.zeros(1, dtype=np.int64),
        length=np.zeros(links),
        bend=np.zeros((links, 2)),
        roll=np.zeros(links + 1),
        position=np.zeros((links + 1, 3)),
        frame=np.zeros((links + 1, 3, 3)),
        velocity=np.zeros((links + 1, 3)),
        contact_force=np.zeros((links + 1, 3)),
        friction_limit=np.zeros(links + 1),
        depth=np.zeros(links + 1),
        roll_anchor=np.zeros(links),
        crept=np.zeros((links, 2)),
        shear=np.zeros((links, 2)),
    )


def copy_state(source: State, target: State) -> None:
    """Overwrite ``target`` with ``source``; both have the same room."""
    for src, dst in zip(source, target, strict=True):
        dst[...] = src


class RobotParameters(NamedTuple):
    """Constants of the robot [SI]; bundles as in `evergym.lattice`."""

    sheath_bundle: Array
    flexible_bundle: Array
    proximal_bundle: Array
    sheath_radius: float
    catheter_radius: float
    flexible_length: float
    tendon_arm: float
    pre_curvature: float
    damping_time: float
    sheath_mass: float
    """Wall, tail and fluid of a sheath without catheter, per length [kg/m]."""
    catheter_mass: float
    """Catheter and tendon per length in air [kg/m]."""
    inner_mass: float
    """Catheter and tendon per length less the fluid they displace [kg/m]."""
    everted_length_max: float
    catheter_length_max: float
    has_sheath: bool
    has_catheter: bool
    may_protrude: bool


class NumericsParameters(NamedTuple):
    """Discretisation and tolerances."""

    section_length: float
    energy_tolerance: float
    iterations_max: int


class WorldParameters(NamedTuple):
    """What surrounds the robot."""

    wall: WallField
    has_wall: bool
    pegs: Array
    gravity: Array
    port_frame: Array


class Parameters(NamedTuple):
    """Everything that does not change while a simulator lives."""

    robot: RobotParameters
    effects: EffectParameters
    numerics: NumericsParameters
    world: WorldParameters


class Workspace(NamedTuple):
    """Scratch space of the solver for n links; nothing in it outlives a substep."""

    bend: Array
    roll: Array
    position: Array
    frame: Array
    reference: Array
    """Where friction holds each node [m], shape (n + 1, 3)."""
    previous_bend: Array
    previous_roll: Array
    predicted: Array
    mass: Array
    cover: Array
    """Length of each link inside sheath, flexible and proximal catheter [m], shape (n, 3)."""
    tributary: Array
    """Length of robot whose contact acts on each node [m], shape (n + 1,)."""
    contact_radius: Array
    normal: Array
    """Direction of the lagged contact force at each node, shape (n + 1, 3)."""
    column: Array
    """Derivative of a link's end rotation by its two bends, shape (n, 2, 3)."""
    half_column: Array
    """Derivative of the link's own rotation by its two bends, shape (n, 2, 3)."""
    link: Array
    """Vector along each link [m], shape (n, 3)."""
    link_gradient: Array
    """Derivatives by bend x, bend y, twist, and roll at the first node, shape (n, 4)."""
    link_hessian: Array
    """Second derivatives by the same four, shape (n, 4, 4)."""
    tendon: Array
    """Derivatives of the tendon's path by the same four, shape (n, 4)."""
    node_gradient: Array
    """Derivatives by position and rotation, shape (n + 1, 6)."""
    node_hessian: Array
    """Second derivatives by the same six, shape (n + 1, 6, 6)."""
    gain: Array
    """Feedback of each link's three unknowns on the seven of its first node, shape (n, 3, 7)."""
    feed_forward: Array
    """Newton step of each link's unknowns: from the gradient, and from the tendon, shape (n, 2, 3)."""
    section: Array
    """Results of `compute_bundle`, shape (7,)."""
    value: Array
    """Second derivatives of the energy beyond a node by its seven motions, shape (7, 7)."""
    value_gradient: Array
    value_tendon: Array
    value_column: Array
    step_column: Array
    pivot: Array
    coupling: Array
    point: Array
    gradient: Array
    hessian: Array
    contact_gradient: Array
    contact_hessian: Array
    contact_force: Array
    friction_limit: Array
    depth: Array
    tip_stiffness: Array
    ramp: Array
    """Command of a part of a step, shape (8,)."""
    rubbing: Array
    """Exponent mu theta of the tendon's friction in this step [1], and the path last evaluated [m], shape (2,)."""


def create_workspace(links: int) -> Workspace:
    """Return scratch space for ``links`` links."""
    n = links
    return Workspace(
        bend=np.zeros((n, 2)),
        roll=np.zeros(n + 1),
        position=np.zeros((n + 1, 3)),
        frame=np.zeros((n + 1, 3, 3)),
        reference=np.zeros((n + 1, 3)),
        previous_bend=np.zeros((n, 2)),
        previous_roll=np.zeros(n + 1),
        predicted=np.zeros((n + 1, 3)),
        mass=np.zeros(n + 1),
        cover=np.zeros((n, 3)),
        tributary=np.zeros(n + 1),
        contact_radius=np.zeros(n + 1),
        normal=np.zeros((n + 1, 3)),
        column=np.zeros((n, 2, 3)),
        half_column=np.zeros((n, 2, 3)),
        link=np.zeros((n, 3)),
        link_gradient=np.zeros((n, 4)),
        link_hessian=np.zeros((n, 4, 4)),
        tendon=np.zeros((n, 4)),
        node_gradient=np.zeros((n + 1, 6)),
        node_hessian=np.zeros((n + 1, 6, 6)),
        gain=np.zeros((n, 3, 7)),
        feed_forward=np.zeros((n, 2, 3)),
        section=np.zeros(7),
        value=np.zeros((7, 7)),
        value_gradient=np.zeros(7),
        value_tendon=np.zeros(7),
        value_column=np.zeros((2, 7)),
        step_column=np.zeros((2, 6)),
        pivot=np.zeros((3, 3)),
        coupling=np.zeros((3, 7)),
        point=np.zeros(3),
        gradient=np.zeros(3),
        hessian=np.zeros((3, 3)),
        contact_gradient=np.zeros(3),
        contact_hessian=np.zeros((3, 3)),
        contact_force=np.zeros((n + 1, 3)),
        friction_limit=np.zeros(n + 1),
        depth=np.zeros(n + 1),
        tip_stiffness=np.zeros(1),
        ramp=np.zeros(8),
        rubbing=np.zeros(2),
    )
