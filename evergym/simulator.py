"""The simulator: owns a state, advances it under commands, and reads it out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evergym.effects.catalogue import compile_effects
from evergym.errors import ConfigError, SimulationDiverged
from evergym.eversion import EVERTED_LENGTH_MIN
from evergym.model import Model, Numerics, compile_numerics, compile_robot
from evergym.state import Parameters, Scalar, State, copy_state, create_state, create_workspace
from evergym.stepper import advance_packed, compute_supply, pack, settle
from evergym.world import World

__all__ = ["Command", "Contacts", "Reading", "Shape", "Simulator", "Snapshot"]

Array = NDArray[np.float64]

SETUPS = ("full", "catheter", "sheath")


@dataclass(frozen=True, slots=True)
class Command:
    """What the drives are told, held for the duration of an advance.

    Attributes:
        insertion_velocity: Of the catheter [m/s], signed.
        tail_feed_velocity: Of the tail [m/s], signed; None: coupled, twice the insertion.
        roll: Angle of the catheter at the base [rad].
        tendon_pull: [m], not negative.
        pressure: Set point [Pa gauge].
        tip_load: Force on the tip [N], shape (3,).
    """

    insertion_velocity: float = 0.0
    tail_feed_velocity: float | None = None
    roll: float = 0.0
    tendon_pull: float = 0.0
    pressure: float = 0.0
    tip_load: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Reading(NamedTuple):
    """What can be read off the robot; SI units, fresh arrays."""

    time: float
    tip_position: Array
    tip_direction: Array
    tendon_side: Array
    """Side to which pulling bends the tip, (3,), unit."""
    everted_length: float
    catheter_length: float
    """Length of catheter inserted beyond the port."""
    slack: float
    growth_rate: float
    pressure: float
    tendon_pull: float
    tendon_tension: float
    tail_tension: float
    roll: float
    wall_force_max: float
    """Largest contact force on one section."""
    wall_force_sum: float
    tip_force: Array
    penetration_max: float
    """Deepest indentation of the wall or a peg."""
    contact_count: int
    buckled: bool
    burst: bool


class Shape(NamedTuple):
    """The robot's shape: n nodes from the port to the tip."""

    position: Array
    """(n, 3) [m]."""
    tangent: Array
    """(n, 3), unit."""
    station: Array
    """(n,) arclength from the port [m]."""
    in_sheath: NDArray[np.bool_]
    """(n,) whether the everted wall covers the node."""
    catheter_direction: Array
    """(n, 3) the side of the tendon, towards which pulling bends; unit."""


class Contacts(NamedTuple):
    """Sections that touch: where, and the normal force on the robot."""

    position: Array
    """(k, 3) [m]."""
    force: Array
    """(k, 3) [N]."""


@dataclass(frozen=True)
class Snapshot:
    """A saved state; picklable, restored bit for bit."""

    state: State


class Simulator:
    """Simulate one robot in one world.

    Args:
        model: Robot and effects.
        world: Surroundings.
        numerics: Discretisation and tolerances.
        setup: "full", "catheter" (no sheath) or "sheath" (no catheter).

    Raises:
        ConfigError: unknown setup.
    """

    def __init__(
        self, model: Model, world: World | None = None, numerics: Numerics | None = None, setup: str = "full"
    ) -> None:
        if setup not in SETUPS:
            raise ConfigError(f"Unknown setup {setup!r}. Choose one of {', '.join(SETUPS)}.")
        self.model = model
        self.world = World.free() if world is None else world
        self.numerics = Numerics() if numerics is None else numerics
        self.setup = setup
        robot = compile_robot(model, self.numerics, setup)
        effects = compile_effects(model.effects, model.robot)
        if setup == "catheter":
            # The lost motion is that of the assembled robot.
            effects = effects._replace(tendon_backlash=effects.tendon_backlash._replace(lost_motion=0.0))
        if setup != "full":
            effects = effects._replace(clearance_play=effects.clearance_play._replace(angle=0.0))
        self.parameters = Parameters(robot, effects, compile_numerics(self.numerics), self.world.compile())
        reach = max(robot.everted_length_max, robot.catheter_length_max if robot.has_catheter else 0.0)
        links = int(np.ceil(reach / self.parameters.numerics.section_length)) + 2
        self.state = create_state(links)
        self._backup = create_state(links)
        self.workspace = create_workspace(links)
        self._command = np.zeros(8)
        self._box = pack(self.parameters, self.state, self._backup, self.workspace)
        self.reset()

    def reset(
        self,
        everted_length: float = 0.010,
        catheter_length: float | None = None,
        pressure: float = 0.0,
        tendon_pull: float = 0.0,
        roll: float = 0.0,
        path: Array | None = None,
    ) -> Reading:
        """Put the robot into the port, at rest and without slack, and return its reading.

        Args:
            everted_length: Wall outside the port [m]; ignored without a sheath.
            catheter_length: Catheter inserted [m]; None: up to the sheath's tip (95 mm without a sheath).
            pressure: Set point, reached already [Pa gauge].
            tendon_pull: [m].
            roll: Of the catheter [rad].
            path: Points from the port on along which to lay the robot before it settles [m], shape (k, 3); None:
                straight.

        Raises:
            ConfigError: a length outside the robot's, or a value that is not finite.
        """
        for name, value in (("pressure", pressure), ("tendon_pull", tendon_pull), ("roll", roll)):
            if not math.isfinite(value):
                raise ConfigError(f"The {name} at the start must be a finite number: got {value}.")
        robot = self.parameters.robot
        everted = everted_length if robot.has_sheath else 0.0
        if robot.has_sheath and not EVERTED_LENGTH_MIN <= everted <= robot.everted_length_max:
            raise ConfigError(
                f"The everted length is {everted * 1e3:g} mm; it must be between {EVERTED_LENGTH_MIN * 1e3:g} and "
                f"{robot.everted_length_max * 1e3:g} mm, half of the sheath's material."
            )
        if catheter_length is None:
            catheter_length = everted if robot.has_sheath else self.model.robot.catheter_length_mm * 1e-3
        inserted = catheter_length if robot.has_catheter else 0.0
        if not 0.0 <= inserted <= robot.catheter_length_max or max(inserted, everted) <= 0.0:
            raise ConfigError(
                f"The inserted catheter length is {inserted * 1e3:g} mm; it must be above 0 and at most "
                f"{robot.catheter_length_max * 1e3:g} mm."
            )
        for array in self.state:
            array[...] = 0
        scalar = self.state.scalar
        scalar[Scalar.EVERTED_LENGTH] = everted
        scalar[Scalar.CATHETER_LENGTH] = inserted
        scalar[Scalar.FED_LENGTH] = 2.0 * everted
        supply = compute_supply(self.parameters, pressure, 0.0)
        scalar[Scalar.PRESSURE] = supply
        scalar[Scalar.SUPPLY_PRESSURE] = supply
        scalar[Scalar.WALL_LENGTH] = everted * (1.0 + self.parameters.effects.wall_compliance.axial * supply)
        scalar[Scalar.ROLL] = roll
        self._command[:] = (0.0, 0.0, roll, tendon_pull, pressure, 0.0, 0.0, 0.0)
        tangent = np.zeros((0, 3)) if path is None else self._sample_tangents(path)
        status = settle(self.parameters, self.state, self._command, self.workspace, tangent)
        if status != 0:
            raise SimulationDiverged(
                "The robot finds no equilibrium at reset. Check its start and the model's stiffnesses."
            )
        return self.reading

    def _sample_tangents(self, path: Array) -> Array:
        """Return the unit tangents of a polyline at every section [1], shape (n, 3)."""
        step = np.diff(path, axis=0)
        size = np.linalg.norm(step, axis=1)
        middle = np.cumsum(size) - 0.5 * size
        station = self.parameters.numerics.section_length * np.arange(self.state.length.shape[0] + 1)
        tangent = np.stack([np.interp(station, middle, step[:, a] / size) for a in range(3)], axis=1)
        return np.ascontiguousarray(tangent / np.linalg.norm(tangent, axis=1)[:, None])

    def advance(self, command: Command, duration: float) -> Reading:
        """Advance under a constant command and return the reading at the end.

        Args:
            command: What the drives are told.
            duration: [s], positive.

        Raises:
            ConfigError: a command that is not finite, or a duration that is not positive.
            SimulationDiverged: no equilibrium was found, even in small steps; the state is the last good one.
        """
        tail = command.tail_feed_velocity
        row = self._command
        row[0] = command.insertion_velocity
        row[1] = 2.0 * command.insertion_velocity if tail is None else tail
        row[2] = command.roll
        row[3] = command.tendon_pull
        row[4] = command.pressure
        row[5:8] = command.tip_load
        if not (np.isfinite(row).all() and 0.0 < duration < np.inf):
            raise ConfigError(
                f"A command and its duration must be finite, the duration positive: got {command}, {duration} s."
            )
        status = advance_packed(self._box, row, duration, self.numerics.step_s)
        if status != 0:
            kind = "its energy is not finite" if status == 2 else "the solver found no equilibrium"
            raise SimulationDiverged(
                f"The simulation stopped at t = {self.state.scalar[Scalar.TIME]:.3f} s: {kind}, even in steps of "
                f"{self.numerics.step_s * 1e3 / 32:.3g} ms. Change the command more slowly or use a shorter step_s."
            )
        return self.reading

    @property
    def reading(self) -> Reading:
        """What can be read off the robot now."""
        state = self.state
        s = state.scalar.tolist()
        n = int(state.links[0])
        roll = float(state.roll[n])
        frame = state.frame[n]
        return Reading(
            time=s[Scalar.TIME],
            tip_position=state.position[n].copy(),
            tip_direction=frame[:, 2].copy(),
            tendon_side=math.cos(roll) * frame[:, 0] + math.sin(roll) * frame[:, 1],
            everted_length=s[Scalar.WALL_LENGTH],
            catheter_length=s[Scalar.CATHETER_LENGTH],
            slack=max(s[Scalar.FED_LENGTH] - 2.0 * s[Scalar.EVERTED_LENGTH], 0.0),
            growth_rate=s[Scalar.GROWTH_RATE],
            pressure=s[Scalar.PRESSURE],
            tendon_pull=s[Scalar.DRIVE_PULL],
            tendon_tension=s[Scalar.TENDON_TENSION],
            tail_tension=s[Scalar.TAIL_TENSION],
            roll=s[Scalar.ROLL],
            wall_force_max=s[Scalar.WALL_FORCE_MAX],
            wall_force_sum=s[Scalar.WALL_FORCE_SUM],
            tip_force=state.contact_force[n].copy(),
            penetration_max=s[Scalar.PENETRATION_MAX],
            contact_count=int(s[Scalar.CONTACT_COUNT]),
            buckled=s[Scalar.BUCKLED] > 0.0,
            burst=s[Scalar.BURST] > 0.0,
        )

    def shape(self) -> Shape:
        """Return the robot's shape."""
        state = self.state
        n = int(state.links[0])
        station = np.concatenate(([0.0], np.cumsum(state.length[:n])))
        frame = state.frame[: n + 1]
        cos = np.cos(state.roll[: n + 1])[:, None]
        sin = np.sin(state.roll[: n + 1])[:, None]
        return Shape(
            position=state.position[: n + 1].copy(),
            tangent=frame[:, :, 2].copy(),
            station=station,
            in_sheath=station <= state.scalar[Scalar.WALL_LENGTH] + 1e-9,
            catheter_direction=cos * frame[:, :, 0] + sin * frame[:, :, 1],
        )

    def contacts(self) -> Contacts:
        """Return the sections that touch a wall or peg."""
        n = int(self.state.links[0])
        force = self.state.contact_force[: n + 1]
        touching = np.any(force != 0.0, axis=1)
        return Contacts(self.state.position[: n + 1][touching].copy(), force[touching].copy())

    def save(self) -> Snapshot:
        """Return a copy of the whole state."""
        saved = create_state(self.state.length.shape[0])
        copy_state(self.state, saved)
        return Snapshot(saved)

    def restore(self, snapshot: Snapshot) -> Reading:
        """Return to a saved state, bit for bit, and return its reading.

        Raises:
            ConfigError: the snapshot is of a simulator with other numerics or another robot.
        """
        if snapshot.state.bend.shape != self.state.bend.shape:
            raise ConfigError(
                f"The snapshot has room for {snapshot.state.bend.shape[0]} links, this simulator for "
                f"{self.state.bend.shape[0]}. Restore it in a simulator with the same robot and section length."
            )
        copy_state(snapshot.state, self.state)
        return self.reading
