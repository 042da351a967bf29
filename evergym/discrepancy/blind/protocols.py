"""Bench protocols: what a lab would run to look at one part of the robot, with the numbers drawn at random.

A protocol returns one run. Which protocols a campaign holds, and how often, is drawn in `campaign_plan`; the ranges
come from the model that the lab has (`BenchRange`), never from the hidden truth.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from evergym.discrepancy.blind.growth_forms import GrowthLaw
from evergym.discrepancy.blind.plan import ROW_S, PlannedRun, Profile
from evergym.model import Model

__all__ = ["PROTOCOLS", "BenchRange", "find_range"]

Array = NDArray[np.float64]

GRAVITY_MPS2 = 9.81
TAKE_UP_S = 2.0
CURVATURE_AIM_1_PER_M = 9.0
"""Bend that the lab aims at with its largest pull: about 50 degrees over 95 mm, as in the paper's Fig. 7."""


@dataclass(frozen=True)
class BenchRange:
    """What the lab may ask of its robot: lengths [mm], pressures [kPa], pulls [mm], feed [mm/s] and loads [N]."""

    length_mm: float
    """Everted length of the runs without growth."""
    pressure_low_kpa: float
    pressure_high_kpa: float
    pull_start_mm: float
    """Pull at which the tendon becomes taut, by the lab's model."""
    pull_high_mm: float
    feed_mm_s: float
    load_n: float
    law: GrowthLaw
    """Growth as the lab expects it."""
    collapse_length_mm: float
    """Of a sheath that hangs by itself at the high pressure, by the textbook, with something in hand."""


def find_range(model: Model) -> BenchRange:
    """Return what a lab would plan with, by the model that it has."""
    robot, effects = model.robot, model.effects
    # Short of the catheter's stiff part, so that the whole robot bends.
    length = min(0.68 * 0.5 * robot.sheath_material_length_mm, 0.9 * robot.catheter_flexible_length_mm)
    rigid = CURVATURE_AIM_1_PER_M * length * 1e-3 * robot.tendon_arm_mm
    tension = CURVATURE_AIM_1_PER_M * robot.catheter_bending_stiffness_n_m2 / (robot.tendon_arm_mm * 1e-3)
    stretch = 1.3 * tension * effects.tendon_stretch.compliance_mm_per_n
    lost = effects.tendon_backlash.lost_motion_mm + effects.tendon_backlash.backlash_mm
    tip_load = 0.35 * 2.0 * robot.catheter_bending_stiffness_n_m2 / (length * 1e-3) ** 2
    radius = 0.5 * robot.sheath_outer_diameter_mm * 1e-3
    collapse = math.pi * 0.97 * robot.pressure_max_kpa * 1e3 * radius**3
    weight = robot.fluid_density_kg_m3 * math.pi * radius**2 * GRAVITY_MPS2
    return BenchRange(
        length_mm=length,
        pressure_low_kpa=0.18 * robot.pressure_max_kpa,
        pressure_high_kpa=0.97 * robot.pressure_max_kpa,
        pull_start_mm=lost,
        pull_high_mm=lost + rigid + stretch,
        feed_mm_s=robot.feed_max_mm_s,
        load_n=tip_load,
        law=GrowthLaw(model, ()),
        collapse_length_mm=math.sqrt(2.0 * 0.7 * collapse / weight) * 1e3,
    )


def _finish(profile: Profile, length_mm: float, setup: str = "full", side: int = 0) -> PlannedRun:
    """Return the run; ``side``: how often the bench is turned by 90 degrees about the insertion."""
    angle = side * 0.5 * np.pi
    gravity = (GRAVITY_MPS2 * float(np.sin(angle)), -GRAVITY_MPS2 * float(np.cos(angle)), 0.0)
    # Whole numbers where they are whole: 1e-16 of gravity says nothing.
    gravity = (round(gravity[0], 9) + 0.0, round(gravity[1], 9) + 0.0, 0.0)
    commands: Array = np.asarray(
        np.round(profile.commands, 4) + 0.0, dtype=np.float64
    )  # what is logged is what was sent; no minus zero
    return PlannedRun("", "", setup, gravity, round(float(length_mm), 1), profile.time, commands)


def _pressure(generator: Generator, bench: BenchRange, low: float = 0.0, high: float = 1.0) -> float:
    share = generator.uniform(low, high)
    return round(bench.pressure_low_kpa + share * (bench.pressure_high_kpa - bench.pressure_low_kpa), 1)


def _start_growth(generator: Generator, bench: BenchRange, pressure_kpa: float, feed_mm_s: float) -> float:
    """Return a length [mm] from which the lab expects growth to show, short of where its model stalls."""
    stall = min(bench.law.find_stall_length(pressure_kpa, feed_mm_s), bench.length_mm)
    return max(stall * generator.uniform(0.15, 0.6), 6.0)


def _side(generator: Generator) -> int:
    return int(generator.choice([0, 0, 0, 1, 2, 3]))


def _staircase(generator: Generator, bench: BenchRange, profile: Profile, share: float) -> None:
    """Pull up, down and halfway up again, in steps that the motor takes in half a second, or evenly."""
    end = float(profile.time[-1])
    top = bench.pull_start_mm + share * (bench.pull_high_mm - bench.pull_start_mm)
    low = bench.pull_start_mm * generator.uniform(0.3, 0.8)
    middle = bench.pull_start_mm + 0.5 * (top - bench.pull_start_mm)
    up = np.linspace(low, top, 6)
    values = np.concatenate((up, up[-2::-1], [middle, top, middle]))
    times = np.linspace(0.0, end, len(values), endpoint=False)
    if generator.uniform() < 0.5:
        knots = [time for start in times.tolist()[1:] for time in (start, start + 2.0 * ROW_S)]
        profile.ramps("tendon_pull_mm", [0.0, *knots], [values[0], *np.repeat(values, 2)[1:-1].tolist()])
    else:
        profile.ramps("tendon_pull_mm", [*times.tolist(), end], [*values.tolist(), float(values[-1])])


def _take_up(profile: Profile, bench: BenchRange, pull: float) -> Profile:
    """Pull within the first two seconds, then hold."""
    return profile.ramps("tendon_pull_mm", [0.0, 0.25, TAKE_UP_S], [0.3 * bench.pull_start_mm] * 2 + [pull])


def tendon_staircase(generator: Generator, bench: BenchRange) -> PlannedRun:
    """Pull the tendon up, down and up again at one pressure and one length."""
    profile = Profile(generator.uniform(8.0, 10.0)).hold("pressure_kpa", _pressure(generator, bench))
    _staircase(generator, bench, profile, generator.uniform(0.75, 1.0))
    return _finish(profile, bench.length_mm * generator.uniform(0.8, 1.1), side=_side(generator))


def catheter_staircase(generator: Generator, bench: BenchRange) -> PlannedRun:
    """The same without the sheath; the lost motion of the assembly is not there."""
    profile = Profile(generator.uniform(6.0, 8.0))
    _staircase(generator, bench, profile, generator.uniform(0.7, 0.9))
    profile.commands[:, 3] = np.maximum(profile.commands[:, 3] - 0.85 * bench.pull_start_mm, 0.0)
    return _finish(profile, bench.length_mm, setup="catheter", side=_side(generator))


def pressure_steps(generator: Generator, bench: BenchRange) -> PlannedRun:
    """Step the pressure up and down with the tendon held, or slack."""
    end = generator.uniform(8.0, 10.0)
    levels = [_pressure(generator, bench, low, low + 0.2) for low in (0.0, 0.4, 0.8, 0.25, 0.6)]
    pull = 0.3 * bench.pull_start_mm
    if generator.uniform() < 0.7:
        pull = bench.pull_high_mm * generator.uniform(0.85, 1.0)
    times = [0.0, *np.linspace(TAKE_UP_S + 1.0, end, 4, endpoint=False).tolist()]
    profile = _take_up(Profile(end).steps("pressure_kpa", times, levels), bench, pull)
    return _finish(profile, bench.length_mm * generator.uniform(0.8, 1.1), side=_side(generator))


def growth(generator: Generator, bench: BenchRange) -> PlannedRun:
    """Grow at one feed and one or two pressures; feed, rest, feed."""
    end = generator.uniform(10.0, 13.0)
    feed = bench.feed_mm_s * generator.uniform(0.4, 1.0)
    pressure = _pressure(generator, bench, 0.5, 1.0)
    start = _start_growth(generator, bench, pressure, feed)
    profile = Profile(end)
    profile.steps("tail_feed_mm_s", [0.0, 1.0, 0.6 * end, 0.7 * end], [0.0, feed, 0.0, feed])
    profile.commands[:, 0] = 0.2 * profile.commands[:, 1]
    if generator.uniform() < 0.5:
        second = float(np.clip(pressure * generator.uniform(0.7, 1.2), 0.0, bench.pressure_high_kpa))
        profile.steps("pressure_kpa", [0.0, 0.45 * end], [pressure, round(second, 1)])
    else:
        profile.hold("pressure_kpa", pressure)
    return _finish(profile, start, side=_side(generator))


def growth_threshold(generator: Generator, bench: BenchRange) -> PlannedRun:
    """Feed all the time and raise the pressure slowly until the robot grows, then lower it until it stops."""
    end = generator.uniform(11.0, 13.0)
    top = _pressure(generator, bench, 0.5, 1.0)
    profile = Profile(end)
    profile.ramps("pressure_kpa", [0.0, 0.55 * end, end], [0.1 * bench.pressure_low_kpa, top, bench.pressure_low_kpa])
    feed = bench.feed_mm_s * generator.uniform(0.5, 1.0)
    profile.hold("tail_feed_mm_s", feed)
    profile.commands[:, 0] = 0.1 * profile.commands[:, 1]
    return _finish(profile, _start_growth(generator, bench, top, feed))


def growth_bent(generator: Generator, bench: BenchRange) -> PlannedRun:
    """Grow with the tendon pulled, so that the tail runs through a bend, then the same straight."""
    end = generator.uniform(10.0, 12.0)
    pressure = _pressure(generator, bench, 0.6, 1.0)
    profile = Profile(end).hold("pressure_kpa", pressure)
    feed = bench.feed_mm_s * generator.uniform(0.5, 1.0)
    profile.steps("tail_feed_mm_s", [0.0, TAKE_UP_S, 0.95 * end], [0.0, feed, 0.0])
    profile.commands[:, 0] = 0.2 * profile.commands[:, 1]
    pull = bench.pull_high_mm
    low = 0.3 * bench.pull_start_mm
    knots = [0.0, 0.25, TAKE_UP_S, 0.6 * end, 0.75 * end, end]
    profile.ramps("tendon_pull_mm", knots, [low, low, pull, pull, low, low])
    # Long enough to bend, short enough to grow.
    start = _start_growth(generator, bench, pressure, feed)
    return _finish(profile, max(start, 0.35 * bench.length_mm))


def roll_sweep(generator: Generator, bench: BenchRange) -> PlannedRun:
    """Turn the bent catheter back and forth."""
    end = generator.uniform(9.0, 11.0)
    angle = float(generator.choice([45.0, 60.0, 90.0]))
    profile = Profile(end).hold("pressure_kpa", _pressure(generator, bench))
    _take_up(profile, bench, bench.pull_high_mm * generator.uniform(0.8, 0.95))
    knots = [0.0, TAKE_UP_S, 0.4 * end, 0.8 * end, end]
    profile.ramps("roll_deg", knots, [0.0, 0.0, angle, -angle, 0.3 * angle])
    return _finish(profile, bench.length_mm * generator.uniform(0.8, 1.1), side=_side(generator))


def load_steps(generator: Generator, bench: BenchRange) -> PlannedRun:
    """Hang loads on the tip: towards, away and across, with the tendon slack or pulled."""
    end = generator.uniform(8.0, 10.0)
    load = bench.load_n * generator.uniform(0.5, 1.0)
    times = [0.0, *np.linspace(TAKE_UP_S + 0.5, end, 8, endpoint=False).tolist()]
    profile = Profile(end).hold("pressure_kpa", _pressure(generator, bench))
    profile.steps("load_x_n", times, [0.0, 0.5 * load, load, 0.0, -0.5 * load, -load, 0.0, 0.0, 0.0])
    profile.steps("load_y_n", times, [0.0] * 7 + [load, -load])
    if generator.uniform() < 0.4:
        _take_up(profile, bench, bench.pull_high_mm * generator.uniform(0.7, 0.9))
    return _finish(profile, bench.length_mm * generator.uniform(0.8, 1.0), side=_side(generator))


def hold(generator: Generator, bench: BenchRange) -> PlannedRun:
    """Pull, load and wait: what creeps and what drifts."""
    end = generator.uniform(14.0, 18.0)
    profile = Profile(end).hold("pressure_kpa", _pressure(generator, bench, 0.2, 1.0))
    pull = bench.pull_high_mm * generator.uniform(0.85, 1.0)
    low, down = 0.3 * bench.pull_start_mm, 0.7 * end
    profile.ramps("tendon_pull_mm", [0.0, 1.0, 3.0, down, down + 2.0, end], [low, low, pull, pull, low, low])
    return _finish(profile, bench.length_mm * generator.uniform(0.8, 1.1), side=_side(generator))


def sheath_alone(generator: Generator, bench: BenchRange) -> PlannedRun:
    """The sheath without catheter, hanging, while the pressure steps up and down."""
    end = generator.uniform(6.0, 8.0)
    length = min(bench.length_mm * generator.uniform(0.5, 1.0), 0.95 * bench.collapse_length_mm)
    # Nobody lets a sheath collapse on purpose: the pressure stays above what its weight would take.
    least = bench.pressure_high_kpa * (length / bench.collapse_length_mm) ** 2
    least = min(max(least, bench.pressure_low_kpa), 0.92 * bench.pressure_high_kpa)
    levels = [round(least + share * (bench.pressure_high_kpa - least), 1) for share in (1.0, 0.6, 0.0, 0.8)]
    profile = Profile(end).steps("pressure_kpa", np.linspace(0.0, end, 4, endpoint=False).tolist(), levels)
    return _finish(profile, length, setup="sheath")


def retraction(generator: Generator, bench: BenchRange) -> PlannedRun:
    """Grow a little, then pull the tail back."""
    end = generator.uniform(8.0, 10.0)
    feed = bench.feed_mm_s * generator.uniform(0.5, 0.9)
    pressure = _pressure(generator, bench, 0.5, 1.0)
    profile = Profile(end).hold("pressure_kpa", pressure)
    profile.steps("tail_feed_mm_s", [0.0, 0.5, 0.4 * end, 0.5 * end], [0.0, feed, 0.0, -feed])
    profile.steps("insertion_mm_s", [0.0, 0.5 * end], [0.0, -0.6 * feed])
    return _finish(profile, _start_growth(generator, bench, pressure, feed))


def peg_sweep(generator: Generator, bench: BenchRange) -> PlannedRun:
    """Bend the robot against a peg and drag it along by turning the catheter and growing."""
    end = generator.uniform(9.0, 11.0)
    length = bench.length_mm * generator.uniform(0.85, 1.0)
    pull = bench.pull_high_mm
    profile = Profile(end).hold("pressure_kpa", _pressure(generator, bench, 0.3, 1.0))
    profile.ramps("tendon_pull_mm", [0.0, 0.4 * end, 0.6 * end, end], [0.0, pull, 0.9 * pull, pull])
    profile.ramps("roll_deg", [0.0, 0.4 * end, 0.6 * end, 0.8 * end, end], [0.0, 0.0, 30.0, -30.0, 0.0])
    profile.steps("tail_feed_mm_s", [0.0, 0.8 * end], [0.0, 0.6 * bench.feed_mm_s])
    profile.commands[:, 0] = 0.2 * profile.commands[:, 1]
    run = _finish(profile, length)
    peg = (round(generator.uniform(7.0, 11.0), 1), round(0.7 * length, 1), 8.0)
    return PlannedRun("", "", run.setup, run.gravity, run.initial_everted_length_mm, run.time_s, run.commands, (peg,))


PROTOCOLS: dict[str, Callable[[Generator, BenchRange], PlannedRun]] = {
    "tendon_staircase": tendon_staircase,
    "catheter_staircase": catheter_staircase,
    "pressure_steps": pressure_steps,
    "growth": growth,
    "growth_threshold": growth_threshold,
    "growth_bent": growth_bent,
    "roll_sweep": roll_sweep,
    "load_steps": load_steps,
    "hold": hold,
    "sheath_alone": sheath_alone,
    "retraction": retraction,
    "peg_sweep": peg_sweep,
}
"""Every protocol by name."""
