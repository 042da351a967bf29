"""Frames a second of the endoscope and of the map: printed, never asserted as a time."""

from __future__ import annotations

import time

import numpy as np
import pytest

from evergym.duct_models.duct import generate_duct
from evergym.duct_models.pegs import paper_pegs
from evergym.envs.rendering.view import Scene, make_view
from evergym.model import load_model
from evergym.simulator import Simulator
from evergym.units import MM
from evergym.world import World

FRAMES = 60


@pytest.mark.parametrize("place", ["duct", "pegs"])
@pytest.mark.parametrize(("view", "size"), [("endoscope", (64, 64)), ("map", (480, 360))])
def test_frames_a_second(view: str, size: tuple[int, int], place: str) -> None:
    """Of one core, counted in processor time: the machine may be busy with other things."""
    scene: Scene = generate_duct("held_out", 0) if place == "duct" else paper_pegs(0)
    world = World.duct(generate_duct("held_out", 0)) if place == "duct" else World.peg_field(paper_pegs(0))
    simulator = Simulator(load_model("mammobot_2023"), world)
    picture = make_view(view, scene, (0.0, 0.0, 40 * MM), *size)
    picture.frame(simulator)  # loads the kernels
    spent = 0.0
    frames = []
    for length in np.linspace(10, 30, 6):
        simulator.reset(everted_length=length * MM)
        start = time.process_time()
        frames += [picture.frame(simulator) for _ in range(FRAMES // 6)]
        spent += time.process_time() - start
    picture.close()
    print(f"{view} {size[0]} x {size[1]}, {place}: {FRAMES / max(spent, 1e-9):.0f} frames per second of processor time")
    assert (frames[0] != frames[-1]).any()
