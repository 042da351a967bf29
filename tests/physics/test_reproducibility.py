"""A saved state goes on bit for bit, in the same simulator, in another, and in another process."""

from __future__ import annotations

import hashlib
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from evergym.duct_models.field import WallField
from evergym.errors import ConfigError
from evergym.model import Numerics, load_model
from evergym.simulator import Command, Simulator
from evergym.world import World

CreatePlane = Callable[..., WallField]


@pytest.fixture
def create(create_plane: CreatePlane) -> Callable[[], Simulator]:
    def create() -> Simulator:
        world = World(
            wall=create_plane((0.0, 1.0, 0.0), -1.45e-3),
            pegs=np.array([[7e-3, 0.0, 0.050, 0.0, 1.0, 0.0, 2.5e-3]]),
            gravity=np.array([0.0, -9.81, 0.0]),
        )
        return Simulator(load_model("mammobot_2023"), world, Numerics())

    return create


def _drive(robot: Simulator, seed: int, count: int) -> None:
    generator = np.random.default_rng(seed)
    for _ in range(count):
        robot.advance(
            Command(
                insertion_velocity=generator.uniform(-2e-3, 6e-3),
                tail_feed_velocity=generator.uniform(-2e-3, 2e-2),
                roll=generator.uniform(-1.0, 1.0),
                tendon_pull=generator.uniform(0.0, 4.9e-3),
                pressure=generator.uniform(0.0, 50e3),
                tip_load=(0.0, -0.02, 0.0),
            ),
            0.3,
        )


def _assert_same_bits(one: Simulator, other: Simulator) -> None:
    for name, a, b in zip(one.state._fields, one.state, other.state, strict=True):
        assert a.tobytes() == b.tobytes(), name
    for name, a, b in zip(one.reading._fields, one.reading, other.reading, strict=True):
        np.testing.assert_array_equal(a, b, err_msg=name)


def test_restored_state_goes_on_bit_for_bit(create: Callable[[], Simulator]) -> None:
    robot = create()
    robot.reset(everted_length=0.030, pressure=20e3)
    _drive(robot, 1, 25)
    assert robot.reading.contact_count > 0
    snapshot = robot.save()
    stored = pickle.dumps(snapshot)
    _drive(robot, 2, 25)
    after = robot.save()

    # In the same simulator, which has been elsewhere meanwhile; the snapshot is no view of it.
    assert robot.restore(snapshot).time < after.state.scalar[0]
    assert pickle.dumps(robot.save()) == stored
    _drive(robot, 2, 25)
    assert pickle.dumps(robot.save()) == pickle.dumps(after)

    # In a fresh simulator, through a file: nothing outside the state counts.
    fresh = create()
    fresh.restore(pickle.loads(stored))
    _drive(fresh, 2, 25)
    _assert_same_bits(fresh, robot)


def test_same_commands_same_bits(create: Callable[[], Simulator]) -> None:
    robots = [create(), create()]
    _drive(robots[1], 9, 5)  # another past, ended by the reset
    for robot in robots:
        robot.reset(everted_length=0.020, pressure=10e3)
        _drive(robot, 3, 20)
    _assert_same_bits(*robots)


def test_reading_and_shape_are_copies(create: Callable[[], Simulator]) -> None:
    robot = create()
    robot.reset(everted_length=0.030, pressure=20e3)
    before = robot.save()
    reading, shape, contacts = robot.reading, robot.shape(), robot.contacts()
    for array in (reading.tip_position, reading.tip_direction, reading.tip_force, *shape, *contacts):
        if array.dtype == np.float64:
            array[...] = np.nan
    _drive(robot, 4, 3)
    other = create()
    other.restore(before)
    _drive(other, 4, 3)
    _assert_same_bits(robot, other)


def test_snapshot_of_another_resolution_is_refused(create: Callable[[], Simulator]) -> None:
    coarse = Simulator(load_model("mammobot_2023"), numerics=Numerics(section_length_mm=5.0))
    with pytest.raises(ConfigError, match="room for"):
        create().restore(coarse.save())


PROGRAM = """
import hashlib
from evergym.simulator import Command, Simulator
from evergym.model import load_model
robot = Simulator(load_model("mammobot_2023"))
robot.reset(everted_length=0.030, pressure=20e3)
for k in range(40):
    robot.advance(Command(insertion_velocity=2e-3, roll=0.1 * k, tendon_pull=1e-4 * k, pressure=45e3), 0.25)
print(hashlib.sha256(b"".join(array.tobytes() for array in robot.state)).hexdigest())
"""


def test_two_processes_give_the_same_bits(checkout: Path) -> None:
    digests = []
    for hash_seed in ("1", "2"):
        result = subprocess.run(
            [sys.executable, "-c", PROGRAM],
            env={**os.environ, "PYTHONHASHSEED": hash_seed, "PYTHONPATH": str(checkout)},
            capture_output=True,
            text=True,
            check=True,
            cwd=checkout,
        )
        digests.append(result.stdout.strip())
    assert len(digests[0]) == hashlib.sha256().digest_size * 2
    assert digests[0] == digests[1]
