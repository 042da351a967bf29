"""Peg fields on the simulator: a robot that is only pushed misses the target, one bent towards it gets there."""

from __future__ import annotations

import math

import numpy as np
import pytest

from evergym.duct_models.peg_family import generate_pegs
from evergym.duct_models.pegs import PegField, paper_pegs
from evergym.model import load_model
from evergym.simulator import Command, Simulator
from evergym.world import World

MM = 1e-3
FIELDS = {"paper": paper_pegs(0), "train-0": generate_pegs("train", 0), "dense-0": generate_pegs("dense", 0)}


def approach(field: PegField, pull: float, roll: float) -> float:
    """Nearest the tip comes to the target while robot and catheter are pushed in under a constant pull and roll."""
    simulator = Simulator(load_model("mammobot_2023"), World.peg_field(field))
    simulator.reset(everted_length=10 * MM)
    for step in range(8):
        share = (step + 1) / 8
        simulator.advance(Command(roll=roll * share, tendon_pull=pull * share, pressure=5e3), 0.25)
    nearest = math.inf
    while simulator.reading.tip_position[2] < field.target[2] + 5 * MM:
        reading = simulator.advance(
            Command(insertion_velocity=3 * MM, roll=roll, tendon_pull=pull, pressure=48e3), 0.25
        )
        nearest = min(nearest, float(np.linalg.norm(reading.tip_position - field.target)))
        if nearest < 5 * MM or reading.time > 30.0:
            break
    return nearest


@pytest.mark.parametrize("name", sorted(FIELDS))
def test_pushing_misses_and_steering_reaches_the_target(name: str) -> None:
    field = FIELDS[name]
    assert approach(field, 0.0, 0.0) > 5 * MM
    # the tendon bends towards +x at roll 0
    roll = 0.0 if field.target[0] > 0.0 else math.pi
    assert min(approach(field, pull, roll) for pull in (3.5 * MM, 4.2 * MM)) < 5 * MM
