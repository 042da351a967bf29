"""The runs of one bench campaign: 10 to 20 short runs, 100 to 150 s of robot time, some of them repeats."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.random import Generator

from evergym.discrepancy.blind.plan import PlannedRun
from evergym.discrepancy.blind.protocols import PROTOCOLS, find_range
from evergym.model import Model

__all__ = ["draw_campaign"]

ROBOT_TIME_S = (100.0, 150.0)
RUN_COUNT = (10, 20)
EXCITING_EXPERIMENTS = 4
"""Experiments that excite what is hidden: enough to choose on some and to hold others out."""
BROAD = {
    "tendon_staircase": 2.0,
    "catheter_staircase": 0.6,
    "pressure_steps": 2.0,
    "growth": 2.0,
    "growth_threshold": 1.0,
    "growth_bent": 1.0,
    "roll_sweep": 1.0,
    "load_steps": 1.0,
    "hold": 0.7,
    "sheath_alone": 0.5,
    "retraction": 0.7,
    "peg_sweep": 0.4,
}
"""How often a lab that suspects nothing in particular would run each protocol."""
REPEAT_SHARE = 0.35


def draw_campaign(generator: Generator, model: Model, exciting: Sequence[str]) -> tuple[PlannedRun, ...]:
    """Draw the runs of a campaign, in random order, so that the plan does not say what is hidden.

    Args:
        generator: Source of all draws.
        model: The lab's model, from which the ranges of the commands come.
        exciting: Protocols of which at least some must be there; empty: none in particular.

    Returns:
        Runs with ids "r01", ... and experiments "e01", ...; a repeat shares its experiment.
    """
    bench = find_range(model)
    names = [str(generator.choice(list(exciting))) for _ in range(EXCITING_EXPERIMENTS)] if exciting else []
    weights = [BROAD[name] for name in PROTOCOLS]
    total = sum(weights)
    broad = generator.choice(list(PROTOCOLS), size=40, p=[weight / total for weight in weights])
    target = generator.uniform(ROBOT_TIME_S[0] + 5.0, ROBOT_TIME_S[1] - 10.0)
    experiments: list[list[PlannedRun]] = []
    time, count, repeats = 0.0, 0, 0
    for name in [*names, *broad.tolist()]:
        run = PROTOCOLS[name](generator, bench)
        # Two repeats at least: the noise is known from their differences.
        again = repeats < 2 or generator.uniform() < REPEAT_SHARE
        copies = 2 if again and time + 2.0 * run.duration < target else 1
        if count + copies > RUN_COUNT[1] or (time + copies * run.duration > target + 8.0 and count >= RUN_COUNT[0]):
            break
        experiments.append([run] * copies)
        time, count, repeats = time + copies * run.duration, count + copies, repeats + copies - 1
    order = generator.permutation(len(experiments))
    runs: list[PlannedRun] = []
    for number, place in enumerate(order, start=1):
        for run in experiments[place]:
            runs.append(run.rename(f"r{len(runs) + 1:02d}", f"e{number:02d}"))
    return tuple(runs)
