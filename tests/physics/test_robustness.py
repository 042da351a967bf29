"""Steps from 1 ms to 1 s under violent random commands: no divergence, nothing lost, nothing that is not finite."""

from __future__ import annotations

import numpy as np
import pytest

from evergym.duct_models.duct import generate_duct
from evergym.duct_models.peg_family import random_pegs
from evergym.model import Numerics, load_model
from evergym.simulator import Command, Reading, Simulator
from evergym.state import Scalar
from evergym.world import World

STEPS = (1e-3, 0.01, 0.125, 1.0)


def _create_world(name: str) -> World:
    if name == "duct":
        return World.duct(generate_duct("train", 1))
    if name == "pegs":
        return World.peg_field(random_pegs(3))
    return World.free()


def _draw_command(generator: np.random.Generator) -> Command:
    """Return a command within the drives' limits, but with none of their rate limits."""
    return Command(
        insertion_velocity=float(generator.uniform(-6e-3, 6e-3)),
        tail_feed_velocity=None if generator.random() < 0.3 else float(generator.uniform(-6e-3, 12e-3)),
        roll=float(generator.uniform(-3.2, 3.2)),
        tendon_pull=float(generator.choice([0.0, 4.9e-3, generator.uniform(0.0, 4.9e-3)])),
        pressure=float(generator.choice([0.0, 50e3, generator.uniform(0.0, 50e3)])),
        tip_load=tuple(generator.uniform(-0.02, 0.02, 3)) if generator.random() < 0.3 else (0.0, 0.0, 0.0),
    )


def _check(reading: Reading, robot: Simulator) -> None:
    for name, value in zip(reading._fields, reading, strict=True):
        assert np.all(np.isfinite(value)), name
    shape = robot.shape()
    # The axis neither stretches nor tears: links keep their length to rounding.
    spacing = np.linalg.norm(np.diff(shape.position, axis=0), axis=1)
    np.testing.assert_allclose(spacing, np.diff(shape.station), rtol=1e-9)
    assert 2e-3 - 1e-12 <= reading.everted_length <= 0.140
    assert reading.slack >= 0.0


@pytest.mark.parametrize("name", ["free", "duct", "pegs"])
@pytest.mark.parametrize("step", STEPS)
def test_violent_commands(name: str, step: float) -> None:
    generator = np.random.default_rng([STEPS.index(step), len(name)])
    robot = Simulator(load_model("mammobot_2023"), _create_world(name), Numerics(step_s=step))
    robot.reset(everted_length=0.020)
    substeps = 0.0
    for k in range(250):
        # Ten substeps of a millisecond, or a few of the longer ones, under each command; some durations are no
        # multiple.
        reading = robot.advance(_draw_command(generator), float(step * generator.choice([1.0, 2.0, 2.5])))
        _check(reading, robot)
        if k % 50 == 49:
            # Out again: a robot that never leaves the port proves little.
            substeps += robot.state.scalar[Scalar.SUBSTEPS]
            robot.reset(everted_length=float(generator.uniform(0.005, 0.060)), pressure=20e3)
    assert substeps >= 250.0


def test_growth_stops_at_the_end_of_the_material_under_random_commands() -> None:
    generator = np.random.default_rng(11)
    robot = Simulator(load_model("mammobot_2023"), numerics=Numerics(section_length_mm=4.0))
    # Without losses: else friction would end growth before the material does.
    robot.reset(everted_length=0.138, pressure=50e3)
    for _ in range(40):
        reading = robot.advance(
            Command(tail_feed_velocity=float(generator.uniform(0.0, 0.1)), pressure=50e3, insertion_velocity=1e-3), 0.5
        )
        assert reading.everted_length <= 0.140


def test_speeding_up_and_slowing_down_agree() -> None:
    """The same bench drive in steps of 10 ms and of 125 ms ends at the same place but for the order of the method."""
    tips = []
    for step in (0.01, 0.125):
        robot = Simulator(load_model("mammobot_2023"), numerics=Numerics(step_s=step))
        robot.reset(everted_length=0.040, pressure=30e3)
        for k in range(20):
            reading = robot.advance(Command(tendon_pull=2e-4 * k, roll=0.05 * k, pressure=30e3), 0.25)
        tips.append(reading.tip_position)
    # Of the order of the way that the tip makes in a step: a millimetre a second times 0.1 s.
    np.testing.assert_allclose(tips[0], tips[1], atol=1e-4)
