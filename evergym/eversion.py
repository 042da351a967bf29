"""Growth by eversion and retraction by inversion: how far the wall's tip moves in a step, and the tail that it takes.

The driving pressure is what remains of the gauge pressure p after the yield, the friction of the tail along its
length, on the catheter and in bends, and the contact force on the tip. It drives growth as fast as the rate law
allows, if there is tail: slack is laid in freely, a taut tail comes at the drive's pace. Pulled back, the tail first
gives up its slack; then it inverts the wall, or buckles the robot if that takes more than the column carries.
"""

from __future__ import annotations

import math

from evergym.effects.eversion_yield import compute_yield_pressure
from evergym.effects.feed_limit import compute_taut_speed
from evergym.effects.pressure_droop import compute_droop
from evergym.effects.retraction_buckling import compute_axial_limit, compute_inversion_tension
from evergym.effects.tail_capstan_friction import compute_capstan_factor
from evergym.effects.tail_catheter_friction import compute_squeeze_loss
from evergym.effects.tail_coulomb_friction import compute_tail_loss
from evergym.effects.viscous_eversion import compute_pressure_speed
from evergym.effects.wall_compliance import compute_wall_stretch
from evergym.jit import njit
from evergym.lattice import compute_bundle
from evergym.state import Array, Parameters, Scalar, State, Workspace

__all__ = ["EVERTED_LENGTH_MIN", "update_eversion"]

GROWTH_STEP = 0.01
"""Longest step of the growth law [s]: it is a scalar equation, so it is followed far more finely than the shape."""

EVERTED_LENGTH_MIN = 2e-3
"""Wall that stays outside the base when everything is pulled in [m]."""

SLACK_MIN = 1e-12
"""Slack below which the tail counts as taut [m]."""

HALVINGS = 40
"""Halvings of the interval in which the growth of a step with droop is sought: a relative error of 1e-12."""


@njit
def _compute_resistance(
    parameters: Parameters, state: State, length: float, pressure: float, feed_speed: float, turn_angle: float
) -> tuple[float, float]:
    """Return what tail friction takes from growth at ``length`` and ``pressure`` [Pa], and its factor in bends [1]."""
    effects = parameters.effects
    loss = compute_tail_loss(
        effects.tail_coulomb_friction, length, pressure, effects.eversion_yield.kinetic, feed_speed
    )
    loss += compute_squeeze_loss(
        effects.tail_catheter_friction,
        pressure,
        min(length, state.scalar[Scalar.CATHETER_LENGTH]),
        parameters.robot.catheter_radius,
        parameters.robot.sheath_radius,
    )
    return loss, compute_capstan_factor(effects.tail_capstan_friction, turn_angle)


@njit
def _compute_column_limit(parameters: Parameters, state: State, ws: Workspace) -> float:
    """Return the axial load [N] that the robot carries over its longest span between wall contacts."""
    robot = parameters.robot
    n = state.links[0]
    everted = state.scalar[Scalar.EVERTED_LENGTH]
    span = 0.0
    longest = 0.0
    for i in range(1, n + 1):
        span += state.length[i - 1]
        if state.depth[i] > 0.0 or i == n:
            longest = max(longest, span)
            span = 0.0
    thrust = max(state.scalar[Scalar.PRESSURE], 0.0) * math.pi * robot.sheath_radius**2
    compute_bundle(robot.sheath_bundle, thrust, 0.0, 0.0, 1.0, ws.section)
    sheath = min(ws.section[3], ws.section[5])
    compute_bundle(robot.flexible_bundle, 0.0, 0.0, 0.0, 1.0, ws.section)
    both = sheath + min(ws.section[3], ws.section[5])
    share = min(state.scalar[Scalar.CATHETER_LENGTH] / everted, 1.0)
    if share < 1.0 and sheath <= 0.0:
        return 0.0
    compliance = share / both + ((1.0 - share) / sheath if share < 1.0 else 0.0)
    return compute_axial_limit(parameters.effects.retraction_buckling, 1.0 / compliance, longest, thrust)


@njit
def _pull_tail(parameters: Parameters, state: State, ws: Workspace, turn_angle: float, pulled: float) -> float:
    """Take ``pulled`` [m] of tail out: slack first, then inverted wall; a column that cannot carry it buckles."""
    scalar = state.scalar
    slack = max(scalar[Scalar.FED_LENGTH] - 2.0 * scalar[Scalar.EVERTED_LENGTH], 0.0)
    from_slack = min(pulled, slack)
    scalar[Scalar.FED_LENGTH] -= from_slack
    rest = pulled - from_slack
    scalar[Scalar.MOVING] = 0.0
    if rest <= 0.0:
        scalar[Scalar.TAIL_TENSION] = 0.0
        return 0.0
    robot = parameters.robot
    area = math.pi * robot.sheath_radius**2
    factor = compute_capstan_factor(parameters.effects.tail_capstan_friction, turn_angle)
    tension = compute_inversion_tension(parameters.effects.retraction_buckling, scalar[Scalar.PRESSURE], area)
    limit = _compute_column_limit(parameters, state, ws)
    if tension > limit:
        if scalar[Scalar.BUCKLED] == 0.0:
            # It gives way to the side to which it is bent already.
            bx = by = 0.0
            for j in range(state.links[0]):
                bx += state.bend[j, 0]
                by += state.bend[j, 1]
            norm = math.sqrt(bx * bx + by * by)
            scalar[Scalar.BUCKLING_X] = bx / norm if norm > 0.0 else 0.0
            scalar[Scalar.BUCKLING_Y] = by / norm if norm > 0.0 else 1.0
        scalar[Scalar.BUCKLED] = 1.0
        scalar[Scalar.BUCKLING_FORCE] = limit
        scalar[Scalar.TAIL_TENSION] = limit
        return 0.0
    scalar[Scalar.TAIL_TENSION] = tension * factor
    inverted = min(0.5 * rest, max(scalar[Scalar.EVERTED_LENGTH] - EVERTED_LENGTH_MIN, 0.0))
    scalar[Scalar.EVERTED_LENGTH] -= inverted
    scalar[Scalar.FED_LENGTH] -= 2.0 * inverted
    return -float(inverted)


@njit
def _drive(
    parameters: Parameters,
    state: State,
    pressure: float,
    turn_angle: float,
    tip_force: float,
    feed: float,
    moving: bool,
) -> float:
    """Return the driving pressure [Pa], negative where growth stops, of a tip that is ``moving`` or rests."""
    area = math.pi * parameters.robot.sheath_radius**2
    loss, factor = _compute_resistance(
        parameters, state, state.scalar[Scalar.EVERTED_LENGTH], pressure, feed, turn_angle
    )
    folding = compute_yield_pressure(parameters.effects.eversion_yield, moving)
    return float(pressure - (folding + loss) * factor - tip_force / area)


@njit
def _compute_speed(
    parameters: Parameters,
    state: State,
    pressure: float,
    turn_angle: float,
    tip_force: float,
    tip_stiffness: float,
    feed: float,
    dt: float,
) -> float:
    """Return the speed [m/s] at which the ``pressure`` [Pa] drives a moving tip that enough tail is fed to."""
    driving = _drive(parameters, state, pressure, turn_angle, tip_force, feed, True)
    if driving <= 0.0:
        return 0.0
    area = math.pi * parameters.robot.sheath_radius**2
    length = state.scalar[Scalar.EVERTED_LENGTH]
    viscous = parameters.effects.viscous_eversion
    # What the step itself adds to contact and friction counts (semi-implicit), so that no step overshoots the balance.
    probe = 1e-6
    loss, factor = _compute_resistance(parameters, state, length, pressure, feed, turn_angle)
    farther, factor = _compute_resistance(parameters, state, length + probe, pressure, feed, turn_angle)
    hardening = max((farther - loss) * factor / probe, 0.0) + tip_stiffness / area
    speed = compute_pressure_speed(viscous, driving)
    if speed > 1e6:
        return driving / (hardening * dt) if hardening > 0.0 else 1e6
    return float(speed / (1.0 + viscous.exponent * speed / driving * hardening * dt))


@njit
def _limit_growth(parameters: Parameters, state: State, speed: float, feed: float, dt: float) -> float:
    """Return the growth [m] in ``dt`` of a tip driven at ``speed`` [m/s]: no more than there is tail and wall for."""
    scalar = state.scalar
    robot = parameters.robot
    slack = scalar[Scalar.FED_LENGTH] - 2.0 * scalar[Scalar.EVERTED_LENGTH]
    material = 2.0 * robot.everted_length_max - scalar[Scalar.FED_LENGTH]
    if slack > SLACK_MIN:
        growth = min(speed * dt, 0.5 * (slack + max(min(feed * dt, material), 0.0)))
    else:
        effect = parameters.effects.feed_limit
        taut_speed = 0.5 * (1.0 - effect.slip) * feed
        growth = min(compute_taut_speed(effect, speed, taut_speed) * dt, 0.5 * max(material, 0.0))
    return float(min(growth, robot.everted_length_max - scalar[Scalar.EVERTED_LENGTH]))


@njit
def _droop_to(parameters: Parameters, state: State, rate: float, dt: float) -> tuple[float, float]:
    """Return droop and pressure [Pa] at the end of a step ``dt`` in which the tip grows at ``rate`` [m/s]."""
    effects = parameters.effects
    droop = compute_droop(effects.pressure_droop, state.scalar[Scalar.DROOP], rate, effects.pressure_lag.time, dt)
    return droop, state.scalar[Scalar.SUPPLY_PRESSURE] - droop


@njit
def _grow(
    parameters: Parameters,
    state: State,
    turn_angle: float,
    tip_force: float,
    tip_stiffness: float,
    feed: float,
    dt: float,
) -> float:
    """Grow for ``dt`` [s], with the tail fed at ``feed`` [m/s], and return the growth [m]."""
    scalar = state.scalar
    robot = parameters.robot
    drooping = parameters.effects.pressure_droop.resistance > 0.0
    pressure = _droop_to(parameters, state, 0.0, dt)[1] if drooping else scalar[Scalar.PRESSURE]
    moving = scalar[Scalar.MOVING] > 0.0 or _drive(parameters, state, pressure, turn_angle, tip_force, feed, False) > 0
    speed = growth = 0.0
    if moving:
        speed = _compute_speed(parameters, state, pressure, turn_angle, tip_force, tip_stiffness, feed, dt)
        growth = _limit_growth(parameters, state, speed, feed, dt)
    scalar[Scalar.MOVING] = 1.0 if speed > 0.0 else 0.0
    if drooping and growth > 0.0:
        # The faster it grows the less pressure drives it: the rate at which both hold, by halving.
        low, high = 0.0, growth
        for _ in range(HALVINGS):
            growth = 0.5 * (low + high)
            pressure = _droop_to(parameters, state, growth / dt, dt)[1]
            speed = _compute_speed(parameters, state, pressure, turn_angle, tip_force, tip_stiffness, feed, dt)
            if _limit_growth(parameters, state, speed, feed, dt) > growth:
                low = growth
            else:
                high = growth
    slack = scalar[Scalar.FED_LENGTH] - 2.0 * scalar[Scalar.EVERTED_LENGTH]
    scalar[Scalar.TAIL_TENSION] = 0.0
    if scalar[Scalar.MOVING] > 0.0 and slack <= SLACK_MIN:
        scalar[Scalar.FED_LENGTH] += 2.0 * growth
        if speed > 0.0:
            # The tail takes up what the pressure could drive beyond the pace of the feed.
            driving = _drive(parameters, state, pressure, turn_angle, tip_force, feed, True)
            area = math.pi * robot.sheath_radius**2
            scalar[Scalar.TAIL_TENSION] = 0.5 * driving * area * max(1.0 - growth / (speed * dt), 0.0)
    else:
        material = 2.0 * robot.everted_length_max - scalar[Scalar.FED_LENGTH]
        scalar[Scalar.FED_LENGTH] += max(min(feed * dt, material), 0.0)
    scalar[Scalar.EVERTED_LENGTH] += growth
    return float(growth)


@njit
def update_eversion(parameters: Parameters, state: State, command: Array, ws: Workspace, dt: float) -> None:
    """Slide the catheter, feed or pull the tail, and grow or invert the wall, for one step.

    Args:
        parameters: `Parameters`.
        state: `State`; lengths, rates, tail tension, motion and buckling are overwritten.
        command: Command, see `evergym.stepper`, shape (8,).
        ws: `Workspace`.
        dt: Step [s].
    """
    scalar = state.scalar
    robot = parameters.robot
    if robot.has_catheter:
        reach = robot.catheter_length_max
        if robot.has_sheath and not robot.may_protrude:
            reach = min(reach, scalar[Scalar.EVERTED_LENGTH])
        scalar[Scalar.CATHETER_LENGTH] = min(max(scalar[Scalar.CATHETER_LENGTH] + command[0] * dt, 0.0), reach)
    if not robot.has_sheath:
        return
    turn_angle = 0.0
    everted = scalar[Scalar.EVERTED_LENGTH]
    start = 0.0
    for j in range(state.links[0]):
        share = min(max(everted - start, 0.0) / state.length[j], 1.0)
        turn_angle += share * math.sqrt(state.bend[j, 0] ** 2 + state.bend[j, 1] ** 2)
        start += state.length[j]
    n = state.links[0]
    tip_force = 0.0
    tip_stiffness = 0.0
    if scalar[Scalar.CATHETER_LENGTH] <= everted:
        for a in range(3):
            tip_force -= state.contact_force[n, a] * state.frame[n, a, 2]
        tip_force = max(tip_force, 0.0)
        tip_stiffness = scalar[Scalar.TIP_STIFFNESS]
    feed = command[1]
    count = max(math.ceil(dt / GROWTH_STEP - 1e-9), 1)
    step = dt / count
    scalar[Scalar.BUCKLED] = 0.0
    for _ in range(count):
        if scalar[Scalar.BURST] > 0.0:
            break
        growth = 0.0
        if feed < 0.0:
            _pull_tail(parameters, state, ws, turn_angle, -feed * step)
        else:
            growth = _grow(parameters, state, turn_angle, tip_force, tip_stiffness, feed, step)
            tip_force += tip_stiffness * growth
        if parameters.effects.pressure_droop.resistance > 0.0:
            scalar[Scalar.DROOP], scalar[Scalar.PRESSURE] = _droop_to(parameters, state, growth / step, step)
    stretch = compute_wall_stretch(parameters.effects.wall_compliance.axial, scalar[Scalar.PRESSURE])
    scalar[Scalar.WALL_LENGTH] = scalar[Scalar.EVERTED_LENGTH] * stretch
    scalar[Scalar.GROWTH_RATE] = (scalar[Scalar.EVERTED_LENGTH] - everted) / dt
    if robot.has_catheter and not robot.may_protrude:
        scalar[Scalar.CATHETER_LENGTH] = min(scalar[Scalar.CATHETER_LENGTH], scalar[Scalar.EVERTED_LENGTH])
