"""What dissipates never gives energy back: over every step, and over every closed cycle.

The work of the tip load less the change of the stored energy is what friction, damping and the implicit step take.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evergym.duct_models.field import WallField
from evergym.effects.tail_capstan_friction import TailCapstanFrictionParameters, compute_capstan_factor
from evergym.effects.tail_catheter_friction import TailCatheterFrictionParameters, compute_squeeze_loss
from evergym.effects.tail_coulomb_friction import TailCoulombFrictionParameters, compute_tail_loss
from evergym.energy import compute_energies
from evergym.simulator import Command, Simulator
from evergym.world import World

RADIUS = 0.925e-3
ROUNDING = 1e-12
"""Loss [J] by which a step may be negative: the solver's tolerance of 1e-14 J over a hundred steps."""

Create = Callable[..., Simulator]
CreatePlane = Callable[..., WallField]


@dataclass
class Balance:
    """Work of the tip load and loss over a drive [J], and the smallest loss of a single step."""

    work: float = 0.0
    loss: float = 0.0
    loss_min: float = math.inf


def _drive(robot: Simulator, loads: np.ndarray, step: float) -> Balance:
    """Apply the tip loads [N], shape (n, 3), one step each."""
    balance = Balance()
    tip, energy = robot.reading.tip_position, compute_energies(robot).total
    for load in loads:
        reading = robot.advance(Command(tip_load=tuple(load)), step)
        work = float(load @ (reading.tip_position - tip))
        tip, before, energy = reading.tip_position, energy, compute_energies(robot).total
        balance.work += work
        balance.loss += work - (energy - before)
        balance.loss_min = min(balance.loss_min, work - (energy - before))
    return balance


@pytest.mark.parametrize("damping_ms", [0.0, 5.0])
@pytest.mark.parametrize("step", [1e-3, 1e-2])
def test_damping_only_takes(create_robot: Create, damping_ms: float, step: float) -> None:
    changes = {
        "robot.catheter_damping_time_ms": damping_ms,
        "robot.catheter_anisotropy": 15.0,
        "pre_curvature.curvature_1_per_m": 2.2,
        "saline_weight.share": 1.0,
    }
    robot = create_robot(changes, step_s=step, tolerance_j=1e-14)
    phase = 2.0 * math.pi * 8.0 * step * np.arange(int(0.25 / step))
    loads = 0.05 * np.stack([np.sin(phase), np.cos(phase) - 1.0, 0.0 * phase], axis=1)
    balance = _drive(robot, loads, step)
    assert balance.loss_min >= -ROUNDING
    assert balance.loss > 0.0


def test_numerical_damping_vanishes_with_the_step_and_kelvin_voigts_stays(create_robot: Create) -> None:
    losses = {}
    for damping_ms in (0.0, 5.0):
        for step in (1e-3, 2.5e-4):
            robot = create_robot({"robot.catheter_damping_time_ms": damping_ms}, step_s=step, tolerance_j=1e-14)
            phase = 2.0 * math.pi * 4.0 * step * np.arange(int(0.25 / step))
            loads = np.stack([0.05 * (1.0 - np.cos(phase)), 0.0 * phase, 0.0 * phase], axis=1)
            losses[damping_ms, step] = _drive(robot, loads, step).loss
    assert losses[0.0, 2.5e-4] < 0.35 * losses[0.0, 1e-3]  # first order: a quarter
    assert losses[5.0, 2.5e-4] > 0.8 * losses[5.0, 1e-3]


@pytest.mark.parametrize("step", [0.02, 0.1])
def test_dragging_across_a_wall_and_back_takes_work(
    create_robot: Create, create_plane: CreatePlane, step: float
) -> None:
    world = World(wall=create_plane((0.0, 1.0, 0.0), -RADIUS), gravity=np.array([0.0, -9.81, 0.0]))
    count = round(10.0 / step)
    phase = 2.0 * math.pi * np.arange(count) / count
    loads = np.stack([0.03 * np.sin(phase), 0.0 * phase, 0.0 * phase], axis=1)
    works = {}
    for mu in (0.0, 0.3):
        robot = create_robot(
            {"saline_weight.share": 2.0, "contact_friction.mu_tissue": mu}, world=world, step_s=step, tolerance_j=1e-14
        )
        for _ in range(2):  # the second cycle is closed
            start = robot.reading.tip_position
            balance = _drive(robot, loads, step)
            assert balance.loss_min >= -ROUNDING
            assert balance.work >= 0.0 or not np.allclose(robot.reading.tip_position, start, atol=1e-6)
        assert balance.work == pytest.approx(
            balance.loss, abs=1e-9
        )  # all of it is lost: nothing is stored in a closed cycle
        works[mu] = balance.work
    # Coulomb's loss is the force times the way, 4 x amplitude, here at every section: within the bounds of sticking
    # sections (none slide) and of all sliding with the full amplitude.
    force = 0.3 * robot.reading.wall_force_sum
    amplitude = 0.03 * 0.095**3 / (3.0 * 4.23e-4)
    assert 0.1 * force * amplitude < works[0.3] - works[0.0] < 4.0 * force * amplitude


def test_tissue_takes_and_does_not_give(create_robot: Create, create_plane: CreatePlane) -> None:
    """Pressing into tissue and letting go: the damping costs work, less the slower it goes."""
    world = World(wall=create_plane((0.0, 1.0, 0.0), -RADIUS), gravity=np.zeros(3))
    losses = []
    for seconds in (1.0, 10.0):
        step = seconds / 100.0
        robot = create_robot({"duct_compliance.damping_time_s": 0.2}, world=world, step_s=step, tolerance_j=1e-14)
        phase = 2.0 * math.pi * np.arange(1, 101) / 100.0
        loads = np.stack([0.0 * phase, -0.05 * (1.0 - np.cos(phase)), 0.0 * phase], axis=1)
        balance = _drive(robot, loads, step)
        assert balance.loss_min >= -ROUNDING
        losses.append(balance.loss)
    assert 0.0 < losses[1] < losses[0]


non_negative = st.floats(0.0, 1e3)


@given(
    gradient=st.floats(0.0, 1e7),
    share=st.floats(0.0, 1e2),
    growth=st.floats(0.0, 1e2),
    exponent=st.floats(0.0, 1.0),
    length=st.floats(0.0, 0.14),
    pressure=st.floats(0.0, 6e4),
    feed=st.floats(-0.1, 0.1),
    mu=st.floats(0.0, 1.0),
    turn=st.floats(0.0, 10.0),
)
def test_tail_friction_never_helps(
    gradient: float,
    share: float,
    growth: float,
    exponent: float,
    length: float,
    pressure: float,
    feed: float,
    mu: float,
    turn: float,
) -> None:
    tail = TailCoulombFrictionParameters(gradient, share, growth, exponent)
    assert compute_tail_loss(tail, length, pressure, 1e4, feed) >= 0.0
    assert compute_squeeze_loss(TailCatheterFrictionParameters(mu), pressure, length, 0.925e-3, 1.5e-3) >= 0.0
    assert compute_capstan_factor(TailCapstanFrictionParameters(mu), turn) >= 1.0


def test_growing_out_and_pulling_back_takes_work(create_grower: Create) -> None:
    """Over a cycle of eversion and inversion the pressure gives p A dL and takes it back; yield and fold are lost."""
    pressure, area = 20e3, math.pi * 1.5e-3**2
    robot = create_grower({"eversion_yield.static_kpa": 8.0, "eversion_yield.kinetic_kpa": 8.0})
    start = robot.reset(everted_length=0.030, pressure=pressure)
    out = robot.advance(Command(tail_feed_velocity=5e-3, pressure=pressure), 2.0)
    drive_work, reading = 0.0, out
    while reading.everted_length > start.everted_length + 1e-9:
        before = reading.everted_length
        reading = robot.advance(Command(tail_feed_velocity=-5e-3, pressure=pressure), 0.125)
        assert not reading.buckled
        drive_work += reading.tail_tension * 2.0 * (before - reading.everted_length)
    # The regulator gets its fluid back, so the drive pays for all: at least what the pressure gave on the way out.
    assert drive_work >= pressure * area * (out.everted_length - start.everted_length)
