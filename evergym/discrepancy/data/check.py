"""Rows that a robot of this size cannot have produced: they are set aside, not taken for a fault of the format."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.data.columns import CHANNELS, COMMANDS
from evergym.robot import RobotConfig

__all__ = ["find_impossible_rows"]

Array = NDArray[np.float64]

MARGIN_SIGMAS = 6.0
"""A measurement is impossible where it passes a limit by more than this many standard deviations."""
MARGIN_SHARE = 0.02
"""... and by this share of it: lengths on a rig are known to a percent or two (prior)."""


def find_impossible_rows(
    robot: RobotConfig,
    setup: str,
    initial_everted_length_mm: float,
    time_s: Array,
    commands: Array,
    measured: Array,
    noise: Mapping[str, float],
) -> list[tuple[int, str]]:
    """Return (index, why) of the rows of a run whose measurements the robot cannot have produced.

    Args:
        robot: With the dataset's overrides.
        setup: "full", "catheter" or "sheath".
        initial_everted_length_mm: At the first row.
        time_s: Shape (k,).
        commands: Columns `COMMANDS`, shape (k, 8).
        measured: Columns `CHANNELS`, shape (k, 9).
        noise: One standard deviation by channel.
    """
    reach, what = _compute_reach(robot, setup, initial_everted_length_mm, time_s, commands)
    found = []
    tip_noise = max((noise.get(name, 0.0) for name in CHANNELS[:3]), default=0.0)
    distance = np.sqrt(np.nansum(measured[:, :3] ** 2, axis=1))
    margin = MARGIN_SIGMAS * tip_noise + MARGIN_SHARE * reach
    everted = measured[:, CHANNELS.index("everted_length_mm")]
    everted_max = 0.5 * robot.sheath_material_length_mm
    everted_margin = MARGIN_SIGMAS * noise.get("everted_length_mm", 0.0) + MARGIN_SHARE * everted_max
    for i in range(len(time_s)):
        if distance[i] > reach[i] + margin[i]:
            found.append(
                (
                    i,
                    f"tip farther from the port than the {what} is long ({distance[i]:.1f} of {reach[i]:.1f} mm)",
                )
            )
        elif setup != "catheter" and everted[i] > everted_max + everted_margin:
            found.append(
                (i, f"everted length of {everted[i]:.1f} mm, but the sheath everts {everted_max:.1f} mm at most")
            )
        elif setup != "catheter" and everted[i] < -everted_margin:
            found.append((i, f"everted length of {everted[i]:.1f} mm, below zero"))
    return found


def _compute_reach(
    robot: RobotConfig, setup: str, initial_everted_length_mm: float, time_s: Array, commands: Array
) -> tuple[Array, str]:
    """Return the longest that the robot can be outside the port at each row [mm], shape (k,), and what limits it."""
    inserted = np.zeros(len(time_s))
    inserted[1:] = np.cumsum(commands[:-1, COMMANDS.index("insertion_mm_s")] * np.diff(time_s))
    if setup == "catheter":
        return robot.catheter_length_mm + inserted, "catheter"
    everted_max = np.full(len(time_s), 0.5 * robot.sheath_material_length_mm)
    if setup == "sheath":
        return everted_max, "sheath"
    # A catheter may be pushed out of the sheath's tip.
    return np.maximum(everted_max, initial_everted_length_mm + inserted), "sheath"
