"""A step ends at a minimum of its energy, found with the energy's true derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from evergym.duct_models.field import WallField
from evergym.equilibrium import _evaluate
from evergym.model import Numerics, load_model
from evergym.riccati import sweep_back
from evergym.simulator import Command, Simulator
from evergym.state import Scalar, copy_state
from evergym.world import World

STEP = 0.05

CreatePlane = Callable[..., WallField]


class Case(NamedTuple):
    """A robot just after a step, and the energy that the step has minimised."""

    robot: Simulator
    links: int
    bend: np.ndarray
    roll: np.ndarray

    def evaluate(self, bend: np.ndarray, roll: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the energy [J] and its derivatives by bend x, bend y and twist of every link, shape (n, 3)."""
        state, ws, n = self.robot.state, self.robot.workspace, self.links
        position, frame = state.position.copy(), state.frame.copy()
        energy = _evaluate(
            self.robot.parameters, state, self.robot._command, ws, bend, roll, position, frame, STEP, True
        )[0]
        gradient = ws.link_gradient[:n, :3].copy()
        twist = np.append(ws.link_gradient[1:n, 3], 0.0)  # by the roll of each link's end, from the next link's roll
        gradient[:, 2] += np.cumsum(twist[::-1])[::-1]
        for j in range(n):
            for k in range(2):
                for i in range(j + 1, n + 1):
                    # A bend turns the link by its half column and all beyond the link by its column.
                    turn = ws.column[j, k]
                    motion = np.cross(ws.half_column[j, k], ws.link[j]) + np.cross(turn, position[i] - position[j + 1])
                    gradient[j, k] += ws.node_gradient[i, :3] @ motion + ws.node_gradient[i, 3:] @ turn
        return float(energy), gradient

    def move(self, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return bends and rolls after a step of bends and twists, shape (n, 3), from the solution."""
        bend, roll = self.bend.copy(), self.roll.copy()
        bend[: self.links] += step[:, :2]
        roll[1 : self.links + 1] += np.cumsum(step[:, 2])
        return bend, roll


@pytest.fixture
def case(create_plane: CreatePlane) -> Case:
    """Every term at once: fibres partly slack, taut tendon, weight, inertia, damping, wall, peg, friction, roll,
    growth.
    """
    world = World(
        wall=create_plane((0.0, 1.0, 0.0), -1.45e-3),
        pegs=np.array([[3.4e-3, 0.0, 0.020, 0.0, 1.0, 0.0, 2.5e-3]]),
        gravity=np.array([0.0, -9.81, 0.0]),
    )
    numerics = Numerics(section_length_mm=4.0, energy_tolerance_j=1e-18, step_s=STEP)
    robot = Simulator(load_model("mammobot_2023"), world, numerics)
    robot.reset(everted_length=0.030, pressure=30e3, catheter_length=0.034, tendon_pull=3.2e-3)
    command = Command(insertion_velocity=2e-3, roll=0.5, tendon_pull=4e-3, pressure=30e3, tip_load=(0.01, -0.02, 0.0))
    for _ in range(3):
        robot.advance(command, STEP)
    before = robot.save().state
    reading = robot.advance(command, STEP)
    assert reading.contact_count >= 4
    assert reading.tendon_tension > 1.0
    # The step's energy holds what contact was like before it; the records after the step have overwritten that.
    now = robot.save().state
    copy_state(now._replace(depth=before.depth, friction_limit=before.friction_limit), robot.state)
    assert robot.state.friction_limit.max() > 0.0
    return Case(robot, int(now.links[0]), now.bend.copy(), now.roll.copy())


@pytest.mark.parametrize("distance", [0.0, 0.05])
def test_gradient_is_the_energys_derivative(case: Case, distance: float) -> None:
    generator = np.random.default_rng(5)
    place = distance * generator.standard_normal((case.links, 3))
    _, gradient = case.evaluate(*case.move(place))
    size = 1e-6
    difference = np.zeros_like(gradient)
    for index in np.ndindex(gradient.shape):
        for sign in (1.0, -1.0):
            step = place.copy()
            step[index] += sign * size
            difference[index] += sign * case.evaluate(*case.move(step))[0] / (2.0 * size)
    # Rounding of an energy of some mJ over 2e-6 is 1e-12 N m; near the solution the tissue's damping has a kink, across
    # which central differences see half of its stiffness times 1e-6 rad.
    scale = np.abs(gradient).max() if distance > 0.0 else 0.0
    np.testing.assert_allclose(difference, gradient, atol=5e-8 + 1e-9 * scale)


def test_solution_is_stationary_and_lowest(case: Case) -> None:
    energy, gradient = case.evaluate(case.bend, case.roll)
    # An energy tolerance of 1e-18 J at a stiffness of 0.1 N m/rad: sqrt(2 * 1e-18 * 0.1) = 5e-10 N m.
    assert np.abs(gradient).max() < 5e-10
    for index in np.ndindex(case.links, 3):
        for size in (1e-3, 1e-5):
            for sign in (1.0, -1.0):
                step = np.zeros((case.links, 3))
                step[index] = sign * size
                assert case.evaluate(*case.move(step))[0] > energy


def test_sweep_solves_newtons_system(case: Case) -> None:
    """The decrement of the recursive factorisation against a dense Hessian from differences of the gradient."""
    generator = np.random.default_rng(7)
    place = 1e-3 * generator.standard_normal((case.links, 3))
    size, count = 1e-6, 3 * case.links
    hessian = np.zeros((count, count))
    for column in range(count):
        step = np.zeros(count)
        step[column] = size
        plus = case.evaluate(*case.move(place + step.reshape(-1, 3)))[1]
        minus = case.evaluate(*case.move(place - step.reshape(-1, 3)))[1]
        hessian[:, column] = (plus - minus).ravel() / (2.0 * size)
    _, gradient = case.evaluate(*case.move(place))
    # The gradient of an energy: its derivative is symmetric. Differences are good to 1e-6.
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-6 * np.abs(hessian).max())
    exact = gradient.ravel() @ np.linalg.solve(0.5 * (hessian + hessian.T), gradient.ravel())
    slope, mixed, tendon = sweep_back(case.links, case.robot.workspace, 0.0)
    compliance = case.robot.parameters.effects.tendon_stretch.compliance
    # 5 %: the sweep leaves out terms of the order of a link's bend (here up to 0.08 rad).
    assert slope - mixed**2 / (compliance + tendon) == pytest.approx(exact, rel=0.05)


def test_newton_converges_in_few_iterations(case: Case) -> None:
    robot = Simulator(case.robot.model, case.robot.world, Numerics(energy_tolerance_j=1e-14))
    robot.reset(everted_length=0.040, pressure=30e3)
    start = robot.state.scalar.copy()
    for k in range(80):
        robot.advance(Command(tendon_pull=5e-5 * k, roll=0.02 * k, pressure=30e3), 0.125)
    spent = robot.state.scalar - start
    # A wrong derivative costs many times this, silently.
    assert spent[Scalar.ITERATIONS] / spent[Scalar.SUBSTEPS] < 6.0
