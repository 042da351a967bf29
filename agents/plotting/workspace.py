"""The tip's workspace in free space: tendon pull by pressure, pulled and let go again."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from evergym.agents.plotting.style import FULL_WIDTH_MM, make_shades, write_figure
from evergym.model import load_model
from evergym.simulator import Command, Simulator
from evergym.units import DEG, KPA, MM
from evergym.world import World

__all__ = ["WorkspaceCurve", "draw_workspace", "measure_workspace"]

Array = NDArray[np.float64]

_BACK = (0, (3, 1.5))
_PULL_SPEED = 2 * MM  # m/s; the environments' largest, which is a prior


class WorkspaceCurve(NamedTuple):
    """What pulling and letting go does at one length and pressure; SI units."""

    everted_length: float
    pressure: float
    pull: Array
    """Up to the largest and back, shape (2 n - 1,)."""
    tip: Array
    """Along the insertion and towards the tendon, shape (2 n - 1, 2)."""
    angle: Array
    """Between the tip and the insertion, in the plane in which the tendon bends, shape (2 n - 1,)."""


def measure_workspace(
    model: str, everted_lengths_mm: Sequence[float], pressures_kpa: Sequence[float], pull_count: int
) -> tuple[WorkspaceCurve, ...]:
    """Simulate one curve per length and pressure; gravity acts across the plane in which the tendon bends."""
    robot = load_model(model)
    pulls = np.linspace(0.0, robot.robot.tendon_max_pull_mm * MM, pull_count)
    pulls = np.concatenate([pulls, pulls[-2::-1]])
    hold = max(pulls[1] / _PULL_SPEED, 0.1)
    simulator = Simulator(robot, World.free())
    curves = []
    for length_mm, pressure_kpa in itertools.product(everted_lengths_mm, pressures_kpa):
        length, pressure = length_mm * MM, pressure_kpa * KPA
        simulator.reset(everted_length=length, pressure=pressure)
        tips, angles = [], []
        for pull in pulls:
            reading = simulator.advance(Command(tendon_pull=float(pull), pressure=pressure), hold)
            tips.append(reading.tip_position[[2, 0]])
            angles.append(np.arctan2(reading.tip_direction[0], reading.tip_direction[2]))
        curves.append(WorkspaceCurve(length, pressure, pulls, np.array(tips), np.unwrap(angles)))
    return tuple(curves)


def draw_workspace(curves: Sequence[WorkspaceCurve], path: Path) -> Path:
    """Draw the tip's places and its angle; returns the file."""
    pressures = sorted({curve.pressure for curve in curves})
    longest = max(curve.everted_length for curve in curves)

    def draw(figure: Figure, axes: list[Axes]) -> None:
        del figure
        places, angles = axes
        shades = make_shades()
        for curve in curves:
            share = pressures.index(curve.pressure) / max(len(pressures) - 1, 1)
            colour = shades(share)
            turn = len(curve.pull) // 2
            tip, pull, angle = curve.tip / MM, curve.pull / MM, curve.angle / DEG
            places.plot(*tip[: turn + 1].T, color=colour, linewidth=0.6)
            # Pressure hardly moves the line along which the tip goes, only how far it gets: rings of another size for
            # each pressure are seen where the curves lie on each other.
            label = f"{curve.pressure / KPA:g} kPa" if curve.everted_length == longest else None
            places.plot(
                *tip[: turn + 1 : max(1, turn // 5)].T, "o", color=colour, label=label,
                markersize=2.0 + 7.0 * share, markerfacecolor="none", markeredgewidth=0.8,
            )  # fmt: skip
            if curve.everted_length == longest:
                angles.plot(pull[: turn + 1], angle[: turn + 1], color=colour)
                angles.plot(pull[turn:], angle[turn:], color=colour, linestyle=_BACK, linewidth=0.8)
        for length in sorted({curve.everted_length for curve in curves}):
            ends = np.array([curve.tip[0] / MM for curve in curves if curve.everted_length == length])
            low = (float(ends[:, 0].mean()), float(ends[:, 1].min()))
            places.annotate(
                f"{length / MM:g} mm",
                low,
                xytext=(0, -5),
                textcoords="offset points",
                ha="center",
                va="top",
                fontsize=7,
            )
        places.plot(0.0, 0.0, marker=">", color="black", markersize=5.0, clip_on=False)
        places.annotate("port", (0.0, 0.0), xytext=(5, 4), textcoords="offset points", fontsize=7)
        places.set(xlabel="along the insertion [mm]", ylabel="towards the tendon [mm]", title="Places of the tip")
        places.margins(x=0.08, y=0.12)
        places.set_aspect("equal", adjustable="datalim")
        places.legend(loc="upper left", title="pressure", title_fontsize=7)
        places.grid(visible=True)
        angles.set(xlabel="tendon pull [mm]", ylabel="tip angle [°]", title=f"Steering at {longest / MM:g} mm")
        angles.grid(visible=True)
        angles.plot([], [], color="#555555", label="pulled")
        angles.plot([], [], color="#555555", linestyle=_BACK, linewidth=0.8, label="let go")
        angles.legend()

    return write_figure(path, FULL_WIDTH_MM, 78.0, 2, 1, draw)
