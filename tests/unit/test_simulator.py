"""The simulator's surface: what it reads out, what it refuses, how it fails."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from evergym.errors import ConfigError
from evergym.model import Numerics, load_model
from evergym.simulator import Command, Simulator
from evergym.world import World

COARSE = Numerics(section_length_mm=5.0)


@pytest.fixture
def robot() -> Simulator:
    return Simulator(load_model("mammobot_2023"), World.free(), COARSE)


def test_a_new_robot_stands_ready(robot: Simulator) -> None:
    reading = robot.reading
    assert (reading.time, reading.everted_length, reading.catheter_length) == (0.0, 0.010, 0.010)
    assert (reading.slack, reading.growth_rate, reading.pressure) == (0.0, 0.0, 0.0)
    assert not reading.buckled
    assert not reading.burst


def test_reading_agrees_with_shape(robot: Simulator) -> None:
    robot.reset(everted_length=0.030, catheter_length=0.042, pressure=20e3, roll=0.4)
    reading = robot.advance(Command(pressure=20e3, tendon_pull=3.5e-3, roll=0.7), 1.0)
    shape = robot.shape()
    np.testing.assert_array_equal(shape.position[0], 0.0)
    np.testing.assert_array_equal(shape.position[-1], reading.tip_position)
    np.testing.assert_array_equal(shape.tangent[-1], reading.tip_direction)
    np.testing.assert_array_equal(shape.catheter_direction[-1], reading.tendon_side)
    assert shape.station[-1] == pytest.approx(0.042, abs=1e-12)
    # The catheter protrudes by 12 mm: the sections beyond 30 mm are bare.
    assert shape.station[shape.in_sheath].max() <= 0.030 + 1e-9
    assert not shape.in_sheath[-1]
    for vectors in (shape.tangent, shape.catheter_direction):
        np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.sum(shape.tangent * shape.catheter_direction, axis=1), 0.0, atol=1e-12)
    assert reading.roll == 0.7
    assert reading.time == pytest.approx(1.0)


def test_time_is_the_sum_of_durations_even_odd_ones(robot: Simulator) -> None:
    for duration in (0.1, 0.125, 0.3, 1.0, 0.007):
        robot.advance(Command(), duration)
    assert robot.reading.time == pytest.approx(1.532, abs=1e-12)


def test_tail_is_coupled_to_the_insertion_unless_told_otherwise(robot: Simulator) -> None:
    robot.reset(everted_length=0.010)
    assert robot.advance(Command(insertion_velocity=2e-3), 1.0).slack == pytest.approx(4e-3, abs=1e-12)
    robot.reset(everted_length=0.010)
    apart = robot.advance(Command(insertion_velocity=2e-3, tail_feed_velocity=1e-3), 1.0)
    assert apart.slack == pytest.approx(1e-3, abs=1e-12)
    assert apart.catheter_length == pytest.approx(0.012, abs=1e-12)


def test_pressure_follows_its_set_point_with_the_models_lag(robot: Simulator) -> None:
    reading = robot.advance(Command(pressure=40e3), 0.15)
    assert reading.pressure == pytest.approx(40e3 * (1.0 - math.exp(-1.0)), rel=1e-9)


def test_burst_is_for_good(robot: Simulator) -> None:
    assert robot.advance(Command(pressure=80e3), 2.0).burst
    after = robot.advance(Command(pressure=20e3, insertion_velocity=1e-3), 2.0)
    assert after.burst
    assert after.pressure == pytest.approx(0.0, abs=1.0)
    assert after.growth_rate == 0.0
    assert not robot.reset().burst


def test_protrusion_can_be_forbidden() -> None:
    model = load_model("mammobot_2023")
    off = dataclasses.replace(model.effects.catheter_protrusion, enabled=False)
    model = dataclasses.replace(model, effects=dataclasses.replace(model.effects, catheter_protrusion=off))
    robot = Simulator(model, numerics=COARSE)
    reading = robot.advance(Command(insertion_velocity=5e-3), 2.0)
    assert reading.catheter_length == reading.everted_length == 0.010


def test_catheter_stops_at_both_ends(robot: Simulator) -> None:
    assert robot.advance(Command(insertion_velocity=-1.0), 1.0).catheter_length == 0.0
    longest = robot.parameters.robot.catheter_length_max
    assert robot.advance(Command(insertion_velocity=1.0, tail_feed_velocity=0.0), 1.0).catheter_length <= longest


def test_unknown_setup_is_refused() -> None:
    with pytest.raises(ConfigError, match="Unknown setup 'both'"):
        Simulator(load_model("mammobot_2023"), setup="both")


@pytest.mark.parametrize("length", [0.0, 1e-3, 0.141, math.nan])
def test_impossible_start_is_refused(robot: Simulator, length: float) -> None:
    with pytest.raises(ConfigError, match=r"everted length.*140 mm"):
        robot.reset(everted_length=length)


@pytest.mark.parametrize("length", [-1e-3, 10.0, math.nan])
def test_impossible_catheter_is_refused(robot: Simulator, length: float) -> None:
    with pytest.raises(ConfigError, match="inserted catheter length"):
        robot.reset(catheter_length=length)


@pytest.mark.parametrize("name", ["pressure", "tendon_pull", "roll"])
def test_start_that_is_no_number_is_refused(robot: Simulator, name: str) -> None:
    before = robot.save()
    with pytest.raises(ConfigError, match=f"The {name} at the start must be a finite number"):
        robot.reset(**{name: math.nan})
    np.testing.assert_array_equal(robot.state.position, before.state.position)


@pytest.mark.parametrize(
    ("command", "duration"),
    [
        (Command(pressure=math.nan), 0.1),
        (Command(roll=math.inf), 0.1),
        (Command(tip_load=(0.0, math.nan, 0.0)), 0.1),
        (Command(), 0.0),
        (Command(), -1.0),
        (Command(), math.nan),
        (Command(), math.inf),
    ],
)
def test_commands_that_are_no_numbers_are_refused_and_change_nothing(
    robot: Simulator, command: Command, duration: float
) -> None:
    before = robot.save()
    with pytest.raises(ConfigError, match="must be finite"):
        robot.advance(command, duration)
    for a, b in zip(before.state, robot.state, strict=True):
        np.testing.assert_array_equal(a, b)
    # And the next good command does not carry the bad one along.
    assert np.isfinite(robot.advance(Command(), 0.1).tip_position).all()


def test_path_lays_the_robot_along_it() -> None:
    angle = np.linspace(0.0, 0.8, 60)
    arc = np.stack([0.05 * (1.0 - np.cos(angle)), 0.0 * angle, 0.05 * np.sin(angle)], axis=1)
    peg = [0.05, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0475]  # inside the arc: it holds the robot on its way around
    world = World(pegs=np.array([peg]), gravity=np.zeros(3))
    robot = Simulator(load_model("mammobot_2023"), world, COARSE)
    straight = robot.reset(everted_length=0.030)
    laid = robot.reset(everted_length=0.030, path=arc)
    assert np.isfinite(laid.tip_position).all()
    assert straight.everted_length == laid.everted_length
