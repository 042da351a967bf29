"""The paper's measured figures as a dataset: quasi-static tables, and growth over time.

Source: Wu et al., RA-L 8(2):1005-1012, 2023, doi 10.1109/LRA.2023.3234823 (CC BY 4.0), digitised in
`evergym.experiments`. What the paper does not say is assumed, and written into the dataset's description.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from evergym.discrepancy.data.columns import CHANNELS, COMMANDS
from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.data.export import write_dataset
from evergym.errors import ConfigError
from evergym.experiments.paper import AMBIENT_PRESSURE, read_table
from evergym.units import GRAM_FORCE, KPA

__all__ = ["PAPER_FIGURES", "export_paper", "make_paper_runs"]

HOLD_S = 2.0
"""Time for which each point of a table is held [s]: 13 time constants of the pressure, 50 periods of the catheter."""
GAP_S = 0.5
"""From a reading to the next command [s]."""
LENGTH_MM = 95.0  # paper, Table I and Figs. 7, 10, 11
UNLOADED_ANGLE_DEG = 12.0
"""Angle of the unloaded, unpulled robot, which the authors subtract from their readings (paper, Sec. IV)."""
ANGLE_NOISE_DEG = 1.0 / math.sqrt(12.0)
"""The authors read the tip's angle to one degree."""
DROOP_NOISE_DEG = 0.5 / math.sqrt(12.0)
"""Fig. 9 is read to half a degree."""
SHORTEST_SHEATH_MM = 2.0
"""The shortest that the simulator's sheath can be; the paper's growth starts at 0 mm."""
GRAVITY = 9.81
UNLOADED_GRAVITY = (-GRAVITY, 0.0, 0.0)
REMOVED_TENDON_PULL_MM = -5.0
"""So slack that no load on a catheter of 95 mm tightens the tendon: 90 degrees lengthen its way by 1.2 mm."""

DESCRIPTION = """\
Figures 6 to 11 of Wu et al., RA-L 8(2):1005-1012, 2023, doi 10.1109/LRA.2023.3234823 (CC BY 4.0), digitised.
Angles are signed, positive towards the tendon's side (+x); the 12 degrees of the unloaded, unpulled robot that the \
authors subtract are added again.
Assumed, because the paper does not say: the bend plane is vertical, loads are dead weights, and without a load the \
tendon's side is up, so gravity points along the load, else towards -x; the feed of Fig. 8 is that of the tail, and \
its lengths are grown from the 2 mm that the simulator's shortest sheath has. The removed tendon of Fig. 6 is one \
slackened by 5 mm.
Left out: Fig. 8b and c, which follow from Fig. 8a, and the first point of each curve of Fig. 8a, which is zero."""


def export_paper(folder: str | Path, figures: Sequence[str] | None = None, overwrite: bool = False) -> Path:
    """Write the paper's figures as a dataset.

    Args:
        folder: Is made where it is missing.
        figures: Some of `PAPER_FIGURES`; None: all.
        overwrite: Write over a dataset that is there already.

    Raises:
        ConfigError: an unknown figure, or a dataset that is there already.
    """
    length_noise = float(np.sqrt(np.mean(read_table("fig8a").query("uncertainty_mm > 0").uncertainty_mm ** 2)))
    noise = {
        "everted_length_mm": length_noise,
        "tip_angle_deg": ANGLE_NOISE_DEG,
        "bending_angle_deg": DROOP_NOISE_DEG,
    }
    return write_dataset(
        folder, make_paper_runs(figures), noise, name="mammobot-2023", description=DESCRIPTION, overwrite=overwrite
    )


def make_paper_runs(figures: Sequence[str] | None = None) -> tuple[Run, ...]:
    """Return the runs of some of `PAPER_FIGURES`; None: of all.

    Raises:
        ConfigError: an unknown figure.
    """
    chosen = PAPER_FIGURES if figures is None else tuple(figures)
    for name in chosen:
        if name not in _MAKERS:
            raise ConfigError(f"There is no figure '{name}' in the paper's data. Choose from {', '.join(_MAKERS)}.")
    return tuple(run for name in chosen for run in _MAKERS[name]())


def _make_fig6() -> Iterable[Run]:
    table = read_table("fig6")
    for direction, axis, sign in (("toward", "x", 1.0), ("opposite", "x", -1.0), ("90deg", "y", -1.0)):
        rows = table[table.load_direction == direction]
        key = f"load_{axis}_n"
        points = [{key: sign * load * GRAM_FORCE, "tendon_pull_mm": REMOVED_TENDON_PULL_MM} for load in rows.load_g]
        angles = rows.measured_angle_deg + UNLOADED_ANGLE_DEG
        gravity = (sign * GRAVITY, 0.0, 0.0) if axis == "x" else (0.0, -GRAVITY, 0.0)
        yield _make_table(f"fig6-{direction}", "fig6", "catheter", gravity, points, "tip_angle_deg", angles)


def _make_fig7() -> Iterable[Run]:
    for number, (_, rows) in enumerate(read_table("fig7").groupby("series"), start=1):
        points = [{"tendon_pull_mm": pull} for pull in rows.tendon_mm]
        angles = rows.angle_deg + UNLOADED_ANGLE_DEG
        yield _make_table(f"fig7-{number}", "fig7", "catheter", UNLOADED_GRAVITY, points, "tip_angle_deg", angles)


def _make_fig8() -> Iterable[Run]:
    for _, rows in read_table("fig8a").groupby(["feed_label", "pressure_kpa_abs"]):
        label, pressure = str(rows.feed_label.iloc[0]).lower(), int(rows.pressure_kpa_abs.iloc[0])
        time = rows.time_s.to_numpy(dtype=np.float64)
        commands = _rest(len(time))
        commands[:, COMMANDS.index("tail_feed_mm_s")] = rows.feed_mm_s
        commands[:, COMMANDS.index("pressure_kpa")] = _to_gauge(pressure)
        measured = np.full((len(time), len(CHANNELS)), np.nan)
        measured[1:, CHANNELS.index("everted_length_mm")] = rows.length_mm[1:] + SHORTEST_SHEATH_MM
        name = f"fig8-{label}-{pressure}"
        yield _make_run(name, "fig8", "sheath", (0.0, -GRAVITY, 0.0), SHORTEST_SHEATH_MM, time, commands, measured)


def _make_fig9() -> Iterable[Run]:
    rows = read_table("fig9")
    points = [{"pressure_kpa": _to_gauge(pressure)} for pressure in rows.pressure_kpa_abs]
    # From the highest pressure down: a sheath without pressure has nothing to stand up with again.
    yield _make_table(
        "fig9", "fig9", "sheath", (GRAVITY, 0.0, 0.0), points[::-1], "bending_angle_deg", rows.measured_angle_deg[::-1]
    )


def _make_fig10() -> Iterable[Run]:
    rows = read_table("fig10")
    points = [{"pressure_kpa": _to_gauge(pressure), "tendon_pull_mm": 4.9} for pressure in rows.pressure_kpa_abs]
    angles = rows.measured_angle_deg + UNLOADED_ANGLE_DEG
    yield _make_table("fig10", "fig10", "full", UNLOADED_GRAVITY, points, "tip_angle_deg", angles)


def _make_fig11() -> Iterable[Run]:
    for _, rows in read_table("fig11").groupby(["panel", "load_g"]):
        panel, load = rows.panel.iloc[0], int(rows.load_g.iloc[0])
        sign = 1.0 if rows.load_direction.iloc[0] == "toward" else -1.0
        points = [
            {
                "pressure_kpa": _to_gauge(pressure),
                "tendon_pull_mm": float(rows.tendon_pull_mm.iloc[0]),
                "load_x_n": sign * load * GRAM_FORCE,
            }
            for pressure in rows.pressure_kpa_abs
        ]
        angles = rows.measured_angle_deg + UNLOADED_ANGLE_DEG
        gravity = (sign * GRAVITY, 0.0, 0.0)
        name, experiment = f"fig11{panel}-{load}g", f"fig11{panel}"
        yield _make_table(name, experiment, "full", gravity, points, "tip_angle_deg", angles)


_MAKERS = {
    "fig6": _make_fig6,
    "fig7": _make_fig7,
    "fig8": _make_fig8,
    "fig9": _make_fig9,
    "fig10": _make_fig10,
    "fig11": _make_fig11,
}
PAPER_FIGURES = tuple(_MAKERS)
"""Figures with measurements of the real robot."""


def _to_gauge(pressure_kpa_abs: float) -> float:
    return float(pressure_kpa_abs) - AMBIENT_PRESSURE / KPA


def _rest(count: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    commands = np.zeros((count, len(COMMANDS)))
    commands[:, COMMANDS.index("tail_feed_mm_s")] = np.nan
    return commands


def _make_table(
    name: str,
    experiment: str,
    setup: str,
    gravity: tuple[float, float, float],
    points: Sequence[Mapping[str, float]],
    channel: str,
    values: Iterable[float],
) -> Run:
    """Return a run that holds each point and then reads one channel."""
    commands = _rest(2 * len(points))
    measured = np.full((2 * len(points), len(CHANNELS)), np.nan)
    time = np.empty(2 * len(points))
    for i, (point, value) in enumerate(zip(points, values, strict=True)):
        time[2 * i] = i * (HOLD_S + GAP_S)
        time[2 * i + 1] = time[2 * i] + HOLD_S
        for key, command in point.items():
            commands[2 * i : 2 * i + 2, COMMANDS.index(key)] = command
        measured[2 * i + 1, CHANNELS.index(channel)] = value
    return _make_run(name, experiment, setup, gravity, LENGTH_MM, time, commands, measured)


def _make_run(
    name: str,
    experiment: str,
    setup: str,
    gravity: tuple[float, float, float],
    length_mm: float,
    time: np.ndarray[tuple[int], np.dtype[np.float64]],
    commands: np.ndarray[tuple[int, int], np.dtype[np.float64]],
    measured: np.ndarray[tuple[int, int], np.dtype[np.float64]],
) -> Run:
    for array in (time, commands, measured):
        array.flags.writeable = False
    return Run(
        id=name,
        setup=setup,
        gravity=gravity,
        experiment=experiment,
        environment="free",
        initial_everted_length_mm=length_mm,
        time_s=time,
        commands=commands,
        measured=measured,
        signed_angles=True,
    )
