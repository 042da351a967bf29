"""The columns of a dataset: commands and measured channels, their units, and what no bench can command or read."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["ANGLES", "CHANNELS", "COLUMNS", "COMMANDS", "KEYS", "Column", "channel_index", "command_index"]


class Column(NamedTuple):
    """One column of the samples: its unit, the range beyond which it can only be a mistake, and its meaning.

    A range is wide on purpose: it is to catch a wrong unit (Pa for kPa, um for mm), not a bad reading.
    """

    unit: str
    low: float
    high: float
    meaning: str


COLUMNS = {
    "insertion_mm_s": Column("mm/s", -500.0, 500.0, "speed of the catheter at the port"),
    "tail_feed_mm_s": Column("mm/s", -1000.0, 1000.0, "speed of the tail; empty: coupled, twice the insertion"),
    "roll_deg": Column("deg", -36000.0, 36000.0, "angle of the catheter at the port"),
    "tendon_pull_mm": Column("mm", -50.0, 200.0, "travel of the tendon's drive"),
    "pressure_kpa": Column("kPa", -101.3, 2000.0, "set point of the regulator, gauge"),
    "load_x_n": Column("N", -20.0, 20.0, "force on the tip along x"),
    "load_y_n": Column("N", -20.0, 20.0, "force on the tip along y"),
    "load_z_n": Column("N", -20.0, 20.0, "force on the tip along z"),
    "tip_x_mm": Column("mm", -5000.0, 5000.0, "position of the tip, x"),
    "tip_y_mm": Column("mm", -5000.0, 5000.0, "position of the tip, y"),
    "tip_z_mm": Column("mm", -5000.0, 5000.0, "position of the tip, z, along the insertion"),
    "everted_length_mm": Column("mm", -100.0, 5000.0, "wall outside the port"),
    "growth_speed_mm_s": Column("mm/s", -2000.0, 2000.0, "rate of the everted length"),
    "curvature_1_per_m": Column("1/m", -1000.0, 1000.0, "angle of the tip's tangent against +z / free length"),
    "tip_angle_deg": Column("deg", -720.0, 720.0, "angle of the tip's tangent against +z"),
    "bending_angle_deg": Column("deg", -720.0, 720.0, "angle of the chord from the port to the tip against +z"),
    "pressure_measured_kpa": Column("kPa", -101.3, 2000.0, "reading of the pressure gauge"),
}
"""Every number column, by name."""

COMMANDS = tuple(COLUMNS)[:8]
"""What the drives are told, in the order of `Run.commands`."""
CHANNELS = tuple(COLUMNS)[8:]
"""What is measured, in the order of `Run.measured`."""
RATES = [COMMANDS.index("insertion_mm_s"), COMMANDS.index("tail_feed_mm_s")]
"""Commands that say how fast; the others are set points."""
KEYS = ("run", "time_s")
"""The columns that say to which run and time a row belongs."""
ANGLES = ("curvature_1_per_m", "tip_angle_deg", "bending_angle_deg")
"""The channels that a bench may write with a sign."""


def channel_index(name: str) -> int:
    """Return the index of a channel in `CHANNELS`."""
    return CHANNELS.index(name)


def command_index(name: str) -> int:
    """Return the index of a command in `COMMANDS`."""
    return COMMANDS.index(name)
