"""Growth in free space: everted length and its rate over time at several pressures."""

from __future__ import annotations

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
from evergym.units import KPA, MM
from evergym.world import World

__all__ = ["GrowthCurve", "draw_growth", "measure_growth"]

Array = NDArray[np.float64]

_SAMPLE = 0.1
_START = 10 * MM


class GrowthCurve(NamedTuple):
    """Growth at one pressure; SI units."""

    pressure: float
    time: Array
    everted_length: Array
    growth_rate: Array
    """Between one time and the next, one fewer."""
    fed_rate: float
    """Rate of growth that would use up the tail as it is fed."""


def measure_growth(
    model: str, pressures_kpa: Sequence[float], insertion_mm_s: float, duration_s: float
) -> tuple[GrowthCurve, ...]:
    """Simulate one curve per pressure, from 10 mm, catheter and tail fed together."""
    simulator = Simulator(load_model(model), World.free())
    speed = insertion_mm_s * MM
    count = max(1, round(duration_s / _SAMPLE))
    curves = []
    for pressure_kpa in pressures_kpa:
        pressure = pressure_kpa * KPA
        readings = [simulator.reset(everted_length=_START, pressure=pressure)]
        command = Command(insertion_velocity=speed, pressure=pressure)
        readings += [simulator.advance(command, duration_s / count) for _ in range(count)]
        length = np.array([reading.everted_length for reading in readings])
        time = np.array([reading.time for reading in readings])
        # Of what is seen between samples: a growth in jerks is shown as it is on average over a sample.
        rate = np.diff(length) / np.diff(time)
        curves.append(GrowthCurve(pressure, time, length, rate, speed))
    return tuple(curves)


def draw_growth(curves: Sequence[GrowthCurve], path: Path) -> Path:
    """Draw length and rate; returns the file."""

    def draw(figure: Figure, axes: list[Axes]) -> None:
        del figure
        shades = make_shades()
        for number, curve in enumerate(curves):
            colour = shades(number / max(len(curves) - 1, 1))
            label = f"{curve.pressure / KPA:g} kPa"
            axes[0].plot(curve.time, curve.everted_length / MM, color=colour, label=label)
            axes[1].plot(0.5 * (curve.time[1:] + curve.time[:-1]), curve.growth_rate / MM, color=colour)
        fed = curves[0].fed_rate / MM
        axes[1].axhline(fed, color="#555555", linestyle=(0, (3, 1.5)), linewidth=0.8)
        axes[1].annotate(
            "all of the tail that is fed",
            (1.0, fed),
            xycoords=("axes fraction", "data"),
            xytext=(0, 2),
            textcoords="offset points",
            ha="right",
            va="bottom",
            fontsize=7,
            color="#555555",
        )
        axes[0].set(xlabel="time [s]", ylabel="everted length [mm]", title="Everted length", ylim=(0.0, None))
        axes[1].set(xlabel="time [s]", ylabel="growth rate [mm/s]", title="Growth rate")
        axes[1].set_ylim(min(0.0, axes[1].get_ylim()[0]), max(1.15 * fed, axes[1].get_ylim()[1]))
        for axis in axes:
            axis.set_xlim(0.0, float(curves[0].time[-1]))
            axis.grid(visible=True)
        axes[0].legend(title="pressure", title_fontsize=7)

    return write_figure(path, FULL_WIDTH_MM, 70.0, 2, 1, draw)
