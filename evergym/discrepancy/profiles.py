"""Command profiles that a bench can run: what the next experiment is chosen from."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import CHANNELS, COMMANDS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.robot import RobotConfig

__all__ = ["Profile", "list_profiles", "to_columns"]

Array = NDArray[np.float64]

SAMPLING_S = 0.2


@dataclass(frozen=True)
class Profile:
    """A feasible run that has not been done.

    Attributes:
        title: What it does, for people.
        run: Its commands; nothing is measured yet.
    """

    title: str
    run: Run


class _Script:
    """Builds the commands of a profile piece by piece."""

    def __init__(self) -> None:
        self.now = dict.fromkeys(COMMANDS, 0.0) | {"tail_feed_mm_s": float("nan")}
        self.rows: list[list[float]] = []

    def hold(self, duration: float, **values: float) -> _Script:
        """Set commands at once and hold them."""
        self.now.update(values)
        self.rows += [list(self.now.values()) for _ in range(max(1, round(duration / SAMPLING_S)))]
        return self

    def ramp(self, duration: float, **values: float) -> _Script:
        """Move commands steadily to new values."""
        start = {key: self.now[key] for key in values}
        count = max(1, round(duration / SAMPLING_S))
        for i in range(1, count + 1):
            self.now.update({key: start[key] + (value - start[key]) * i / count for key, value in values.items()})
            self.rows.append(list(self.now.values()))
        return self


@dataclass(frozen=True)
class _Limits:
    """What the bench can do: from the robot, and from what was commanded before."""

    setup: str
    pressures: tuple[float, float, float]
    pull: float
    insertion: float
    """Everting 1 mm takes 2 mm of tail, so the catheter goes at half the tail's speed."""
    lengths: tuple[float, float]
    load: float
    gravity: tuple[float, float, float]


def list_profiles(dataset: Dataset, robot: RobotConfig) -> list[Profile]:
    """Return feasible profiles in free space, with the setup that most runs of the dataset have."""
    setups = [run.setup for run in dataset.runs]
    setup = max(dict.fromkeys(setups), key=setups.count)
    commanded = np.concatenate([run.commands for run in dataset.runs])
    top = float(np.max(commanded[:, 4], initial=0.0)) or robot.pressure_max_kpa
    top = min(top, robot.pressure_max_kpa)
    # The drives' limits are the model's unless the rig gives its own: not beyond what was commanded before, either.
    pulled = float(np.max(commanded[:, 3], initial=0.0))
    inserted, fed = (float(np.nanmax(np.abs(commanded[:, column]), initial=0.0)) for column in (0, 1))
    grown = 0.5 * robot.sheath_material_length_mm
    limits = _Limits(
        setup=setup,
        pressures=(0.4 * top, 0.7 * top, top) if setup != "catheter" else (0.0, 0.0, 0.0),
        pull=min(robot.tendon_max_pull_mm, pulled or np.inf) if setup != "sheath" else 0.0,
        insertion=min(0.5 * robot.feed_max_mm_s, max(inserted, 0.5 * fed) or np.inf),
        lengths=(0.4 * grown, 0.8 * grown),
        load=float(np.max(np.abs(commanded[:, 5:8]), initial=0.0)),
        gravity=dataset.runs[0].gravity,
    )
    profiles = []
    for number, (title, script, length) in enumerate(_write_scripts(limits)):
        commands = np.array(script.rows, dtype=np.float64)
        time = SAMPLING_S * np.arange(len(commands), dtype=np.float64)
        name = f"next{number:02d}"
        measured = np.full((len(time), len(CHANNELS)), np.nan)
        run = Run(name, limits.setup, limits.gravity, name, "free", length, time, commands, measured)
        profiles.append(Profile(title, run))
    return profiles


def _write_scripts(limits: _Limits) -> Iterator[tuple[str, _Script, float]]:
    low, middle, high = limits.pressures
    if limits.pull > 0.0:
        yield from _pull_scripts(limits)
    if limits.load > 0.0:
        for p, pull in itertools.product(dict.fromkeys((low, high)), dict.fromkeys((0.0, 0.7 * limits.pull))):
            script = _Script().hold(0.6, pressure_kpa=p).ramp(1.0, tendon_pull_mm=pull)
            for f in (0.5, 1.0, 0.0, -0.5, -1.0, 0.0):
                script.hold(0.8, load_x_n=f * limits.load)
            yield f"tip load up and down at {p:.0f} kPa and {pull:.1f} mm of pull", script, limits.lengths[1]
    if limits.setup == "catheter":
        return
    for p, v in itertools.product((low, middle, high), (0.5 * limits.insertion, limits.insertion)):
        script = _Script().hold(0.6, pressure_kpa=p).hold(8.0, insertion_mm_s=v).hold(1.0, insertion_mm_s=0.0)
        yield f"growing straight at {p:.0f} kPa, fed at {v:.1f} mm/s", script, 0.3 * limits.lengths[0]
        if limits.pull > 0.0:
            script = _Script().hold(0.6, pressure_kpa=p).ramp(1.5, tendon_pull_mm=0.8 * limits.pull)
            script.hold(8.0, insertion_mm_s=v).hold(1.0, insertion_mm_s=0.0)
            yield f"growing bent at {p:.0f} kPa, fed at {v:.1f} mm/s", script, limits.lengths[0]
    for length, pull in itertools.product(limits.lengths, dict.fromkeys((0.0, 0.7 * limits.pull))):
        script = _Script().ramp(1.0, tendon_pull_mm=pull)
        for p in (low, high, middle, high, low):
            script.hold(2.0, pressure_kpa=p)
        yield f"pressure steps at {length:.0f} mm and {pull:.1f} mm of pull", script, length
        script = _Script().ramp(1.0, tendon_pull_mm=pull).hold(12.0, pressure_kpa=high).hold(8.0, pressure_kpa=low)
        yield f"long holds of the pressure at {length:.0f} mm and {pull:.1f} mm of pull", script, length
    for p in (low, high):
        v = limits.insertion
        script = _Script().hold(0.6, pressure_kpa=p).hold(5.0, insertion_mm_s=v).hold(1.0, insertion_mm_s=0.0)
        script.hold(4.0, insertion_mm_s=-0.8 * v).hold(1.0, insertion_mm_s=0.0)
        yield f"growing and retracting at {p:.0f} kPa", script, limits.lengths[0]


def _pull_scripts(limits: _Limits) -> Iterator[tuple[str, _Script, float]]:
    low, _, high = limits.pressures
    lengths: Sequence[float] = limits.lengths if limits.setup == "full" else limits.lengths[1:]
    for p, length, top in itertools.product(dict.fromkeys((low, high)), lengths, (0.5, 1.0)):
        pull = top * limits.pull
        script = _Script().hold(0.6, pressure_kpa=p)
        for end in (1.0, 0.5, 0.8, 0.3, 0.6, 0.0):
            script.ramp(1.6, tendon_pull_mm=end * pull).hold(0.4)
        yield f"tendon pulled and released to {pull:.1f} mm at {p:.0f} kPa and {length:.0f} mm", script, length
    for duration, p in itertools.product((1.0, 8.0), dict.fromkeys((low, high))):
        script = _Script().hold(0.6, pressure_kpa=p).ramp(duration, tendon_pull_mm=limits.pull).hold(1.0)
        script.ramp(duration, tendon_pull_mm=0.0).hold(1.0)
        yield f"tendon pulled within {duration:.0f} s at {p:.0f} kPa", script, lengths[-1]
    for p, pull in itertools.product(dict.fromkeys((low, high)), (0.5 * limits.pull, limits.pull)):
        script = _Script().hold(0.6, pressure_kpa=p).ramp(1.5, tendon_pull_mm=pull)
        script.ramp(4.0, roll_deg=180.0).ramp(4.0, roll_deg=0.0).ramp(2.0, roll_deg=-90.0).hold(0.6)
        yield f"rolled to and fro at {pull:.1f} mm of pull and {p:.0f} kPa", script, lengths[-1]


def to_columns(run: Run) -> Mapping[str, list[object]]:
    """Return the commands of a run as the columns of ``samples.csv``; coupled feeds are empty."""
    columns: dict[str, list[object]] = {
        "run": [run.id] * len(run.time_s),
        "time_s": [round(float(time), 4) for time in run.time_s],
    }
    for index, name in enumerate(COMMANDS):
        columns[name] = [None if np.isnan(value) else round(float(value), 6) for value in run.commands[:, index]]
    return columns
