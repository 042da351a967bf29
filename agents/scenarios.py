"""The command ``evergym scenario``: the deployments of the paper's Fig. 12, timed beside the paper's computing."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import tyro
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.console import Console

from evergym.agents.deployments import DUCT, PEGS, Deployment, deploy
from evergym.agents.progress import format_duration
from evergym.whole_file import write_whole

__all__ = ["Scenario", "describe", "make_json", "write_deployment"]

PICTURES = 8
"""Pictures on the sheet."""
_PLANS = {"pegs": PEGS, "duct": DUCT}

Frame = tuple[float, NDArray[np.uint8]]


@dataclass(frozen=True)
class Scenario:
    """Run a deployment of the paper's Fig. 12 and compare its computing time with the paper's."""

    name: tyro.conf.Positional[Literal["pegs", "duct"]]
    """pegs: the slalom among four pegs. duct: into a wrong branch, back by retraction, into the right one."""
    model: str = "mammobot_2023"
    """Model, by name or file."""
    pace_mm_s: float | None = None
    """Insertion velocity [mm/s] (None: the one that makes the deployment about as long as the paper's)."""
    json: bool = False
    """Print one JSON object and nothing else."""
    out: Path | None = None
    """Folder for scenario.json, trace.csv, trace.png and pictures.png (None: none are written)."""

    def run(self) -> int:
        """Run it and print what happened; returns 0 if the target was reached, else 1."""
        plan = _PLANS[self.name]
        if self.pace_mm_s is not None:
            plan = replace(plan, pace_mm_s=self.pace_mm_s)
        frames: list[Frame] = []
        look = None if self.out is None else lambda time_s, frame: frames.append((time_s, frame))
        deployment = deploy(plan, model=self.model, look=look)
        if self.out is not None:
            write_deployment(self.out, deployment, frames, model=self.model)
        if self.json:
            print(json.dumps(make_json(deployment, model=self.model), indent=2))
        else:
            console = Console(width=120)
            for line in describe(deployment):
                console.print(line, highlight=False)
            if self.out is not None:
                console.print(f"Pictures and trace: {self.out}", highlight=False)
        return 0 if deployment.reached else 1


def make_json(deployment: Deployment, *, model: str) -> dict[str, Any]:
    """Return a deployment without its trace as plain values."""
    plan = deployment.plan
    return {
        "scenario": plan.name,
        "model": model,
        "anatomy": deployment.anatomy,
        "pace_mm_s": plan.pace_mm_s,
        "reached": deployment.reached,
        "end_reason": deployment.end_reason,
        "robot_seconds": deployment.robot_s,
        "wall_seconds": deployment.wall_s,
        "cpu_seconds": deployment.cpu_s,
        "real_time_factor": deployment.factor,
        "duty_cycles": deployment.duty_cycles,
        "wall_force_peak_n": max(row["wall_force_max_n"] for row in deployment.trace),
        "paper": {
            "robot_seconds": plan.paper_robot_s,
            "wall_seconds": plan.paper_computing_s,
            "real_time_factor": plan.paper_factor,
        },
        "events": [asdict(event) for event in deployment.events],
    }


def describe(deployment: Deployment) -> list[str]:
    """Return what happened and how long it took, line by line."""
    plan = deployment.plan
    outcome = "target reached" if deployment.reached else f"target not reached ({deployment.end_reason})"
    lines = [f"{plan.name}, {deployment.anatomy}: {outcome} after {deployment.duty_cycles} duty cycles"]
    lines += [f"  {event.time_s:7.2f} s  {event.what}" for event in deployment.events]
    rows = (
        ("this simulator", deployment.robot_s, deployment.wall_s, deployment.factor),
        ("the paper's", plan.paper_robot_s, plan.paper_computing_s, plan.paper_factor),
    )
    for name, robot, wall, factor in rows:
        computing = f"{wall:.2f} s" if wall < 60.0 else format_duration(wall)
        lines.append(f"{name:<15}{robot:6.1f} s of robot time in {computing}: {factor:.3g} times real time")
    return lines


def write_deployment(folder: Path, deployment: Deployment, frames: Sequence[Frame], *, model: str) -> None:
    """Write scenario.json, trace.csv, trace.png and pictures.png into a folder, which is made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "scenario.json", json.dumps(make_json(deployment, model=model), indent=2).encode())
    write_whole(folder / "trace.csv", pd.DataFrame(deployment.trace).to_csv(index=False).encode())
    write_whole(folder / "trace.png", _draw_trace(deployment))
    write_whole(folder / "pictures.png", _draw_pictures(deployment, frames))


def _draw_trace(deployment: Deployment) -> bytes:
    """Draw lengths, pressure and tendon pull over time, with the events."""
    trace = pd.DataFrame(deployment.trace)
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True, height_ratios=(2.0, 1.0, 1.0))
    for key, label, colour in (
        ("everted_length_mm", "everted", "#0b7285"),
        ("catheter_length_mm", "catheter", "#212529"),
        ("distance_to_go_mm", "way to go", "#2b8a3e"),
    ):
        axes[0].plot(trace.time_s, trace[key], color=colour, label=label, linewidth=1.2)
    axes[0].set_ylabel("length [mm]")
    axes[0].legend(fontsize=8, ncols=3, loc="lower left")
    axes[1].plot(trace.time_s, trace.pressure_kpa, color="#0b7285", linewidth=1.2)
    axes[1].set_ylabel("pressure [kPa]")
    axes[2].plot(trace.time_s, trace.tendon_pull_mm, color="#0b7285", linewidth=1.2)
    axes[2].set(ylabel="tendon pull [mm]", xlabel="robot time [s]")
    for number, event in enumerate(deployment.events, start=1):
        for axis in axes:
            axis.axvline(event.time_s, color="#adb5bd", linewidth=0.8, zorder=0)
        axes[0].annotate(str(number), (event.time_s, 1.0), xycoords=("data", "axes fraction"), fontsize=8)
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
    listed = [f"{number}: {event.what} ({event.time_s:.0f} s)" for number, event in enumerate(deployment.events, 1)]
    figure.suptitle("\n".join(listed), fontsize=8, x=0.02, ha="left")
    return _save(figure)


def _draw_pictures(deployment: Deployment, frames: Sequence[Frame]) -> bytes:
    """Put the pictures nearest to the events, and others in between, on a sheet."""
    events = {event.time_s: event.what for event in deployment.events}
    even = np.linspace(0.0, deployment.robot_s, max(PICTURES - len(events), 1), endpoint=False)
    chosen = sorted({_find_frame(frames, time_s) for time_s in (*events, *even)})
    columns = 4
    rows = -(-len(chosen) // columns)
    figure = Figure(figsize=(12.0, 2.7 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    for axis in grid.flat:
        axis.set_axis_off()
    for axis, number in zip(grid.flat, chosen, strict=False):
        time_s, frame = frames[number]
        axis.imshow(frame)
        names = [what for event_s, what in events.items() if _find_frame(frames, event_s) == number]
        axis.set_title("\n".join([f"{time_s:.0f} s", *names]), fontsize=8)
    return _save(figure)


def _find_frame(frames: Sequence[Frame], time_s: float) -> int:
    """Return the number of the first picture at or after a time, the last one where there is none."""
    return next((number for number, frame in enumerate(frames) if frame[0] >= time_s - 1e-9), len(frames) - 1)


def _save(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    return buffer.getvalue()
