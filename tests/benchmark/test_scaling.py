"""Cost against the number of sections: printed, never asserted as a time."""

from __future__ import annotations

import time

import numpy as np

from evergym.model import Numerics, load_model
from evergym.simulator import Command, Simulator
from evergym.state import Scalar


def test_cost_against_sections() -> None:
    counts, costs = (20, 40, 80, 160, 320), []
    for count in counts:
        robot = Simulator(load_model("mammobot_2023"), numerics=Numerics(section_length_mm=100.0 / count))
        robot.reset(everted_length=0.100, pressure=30e3)
        robot.advance(Command(pressure=30e3), 0.25)  # loads the kernels
        iterations = robot.state.scalar[Scalar.ITERATIONS]
        start = time.process_time()
        for k in range(30):
            robot.advance(Command(tendon_pull=1e-4 * k, roll=0.03 * k, pressure=30e3), 0.25)
        spent = time.process_time() - start
        iterations = robot.state.scalar[Scalar.ITERATIONS] - iterations
        costs.append(spent / 60.0)
        print(f"{count:4d} sections: {costs[-1] * 1e6:8.1f} us per substep, {iterations / 60.0:.2f} iterations")
        assert iterations > 0.0
    exponent = float(np.polyfit(np.log(counts), np.log(costs), 1)[0])
    print(f"log-log exponent of the cost per substep: {exponent:.2f}")
    assert np.isfinite(exponent)
