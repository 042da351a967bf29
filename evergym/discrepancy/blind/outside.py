"""The effects outside the library, with the numbers that make them visible and the runs that show them."""

# ruff: noqa: ARG001  (all effects are drawn alike)
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from numpy.random import Generator

from evergym.discrepancy.blind.alteration import Alteration
from evergym.discrepancy.blind.outside_forms import (
    ActuatorSaturation,
    OutOfRoundSheath,
    PortPlay,
    SealStickSlip,
    ShapeMemory,
    ThermalDrift,
)
from evergym.discrepancy.blind.protocols import BenchRange

__all__ = ["OUTSIDE", "OutsideEffect"]


@dataclass(frozen=True)
class OutsideEffect:
    """An effect that the library lacks.

    Attributes:
        form: Its code.
        draw: Draws its numbers.
        exciting: Protocols that show it.
    """

    form: type[Alteration]
    draw: Callable[[Generator, BenchRange], dict[str, float]]
    exciting: tuple[str, ...]


def _draw_drift(generator: Generator, bench: BenchRange) -> dict[str, float]:
    return {
        "amplitude_mm": round(0.055 * bench.length_mm * generator.uniform(0.6, 1.4), 2),
        "time_s": round(generator.uniform(200.0, 600.0), 0),
        "direction_deg": round(generator.uniform(40.0, 140.0), 0),
    }


def _draw_memory(generator: Generator, bench: BenchRange) -> dict[str, float]:
    return {"share": round(generator.uniform(0.25, 0.5), 2), "threshold_mm": round(bench.pull_start_mm, 2)}


def _draw_stick_slip(generator: Generator, bench: BenchRange) -> dict[str, float]:
    return {"stuck_mm": round(generator.uniform(9.0, 16.0), 1), "release_factor": round(generator.uniform(3.0, 6.0), 1)}


def _draw_port_play(generator: Generator, bench: BenchRange) -> dict[str, float]:
    return {"angle_deg": round(generator.uniform(2.5, 5.0), 2), "gain": round(generator.uniform(0.3, 0.8), 2)}


def _draw_saturation(generator: Generator, bench: BenchRange) -> dict[str, float]:
    way = bench.pull_high_mm - bench.pull_start_mm
    return {
        "pull_mm": round(bench.pull_start_mm + generator.uniform(0.35, 0.6) * way, 2),
        "softness_mm": round(0.04 * way, 3),
    }


def _draw_out_of_round(generator: Generator, bench: BenchRange) -> dict[str, float]:
    return {
        "share": round(generator.uniform(0.35, 0.6), 2),
        "plane_deg": round(generator.uniform(20.0, 70.0), 0),
        "rounding_kpa": round(0.6 * bench.pressure_high_kpa, 1),
        "pull_start_mm": round(bench.pull_start_mm, 2),
    }


OUTSIDE = {
    "thermal_drift": OutsideEffect(ThermalDrift, _draw_drift, ("hold", "tendon_staircase", "growth")),
    "shape_memory": OutsideEffect(ShapeMemory, _draw_memory, ("tendon_staircase", "hold", "growth_bent")),
    "seal_stick_slip": OutsideEffect(SealStickSlip, _draw_stick_slip, ("growth", "growth_bent", "growth")),
    "port_play": OutsideEffect(PortPlay, _draw_port_play, ("roll_sweep", "tendon_staircase", "load_steps")),
    "actuator_saturation": OutsideEffect(
        ActuatorSaturation, _draw_saturation, ("tendon_staircase", "pressure_steps", "hold")
    ),
    "out_of_round_sheath": OutsideEffect(OutOfRoundSheath, _draw_out_of_round, ("roll_sweep", "load_steps")),
}
"""Fixed beforehand: thermal drift, plastic set, stick-slip of the seal, play of the port, a drive that saturates, a
sheath that is out of round."""
