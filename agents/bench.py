"""``evergym bench``: speed in CPU time, with the accuracy it was reached at, in one run.

The duty-cycle controller drives the robot down held-out ducts until 50 mm are everted (and among pegs to the target);
the commands that it gave are then replayed by the simulator at the default resolution, against the clock, and at a
resolution four times finer in sections and in time. A command record is open loop, so both see the same drive, and the
change of the tip is that of the numerics. CPU time is the process's own; quote ratios, and compare on one machine in
one run.
"""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from evergym.agents.bench_scripts import Script, record_duct, record_free, record_pegs
from evergym.equilibrium import add_contacts
from evergym.errors import ConfigError
from evergym.jit import njit
from evergym.model import Model, Numerics, load_model
from evergym.simulator import Simulator
from evergym.state import Array, Parameters, Scalar, State, Workspace

__all__ = ["Bench", "Replay", "replay"]

REFINEMENT = 4
"""How much finer the reference is, in sections and in time."""


@dataclass(frozen=True)
class Replay:
    """One replay of a script.

    Attributes:
        seconds: CPU time in `Simulator.advance` [s].
        kernel: CPU time of the compiled step alone, measured with the same states [s].
        contact: CPU time of its contact queries [s].
        reading: CPU time of reading the state out in Python [s].
        robot_seconds: Simulated time [s].
        tip: Tip after each command [m], shape (n, 3).
        contacts: Sections in contact after each command, shape (n,).
        sections: Sections after each command, shape (n,).
        everted: Everted length at the end [m].
        substeps: Implicit steps.
        iterations: Newton iterations.
    """

    seconds: float
    contact: float
    reading: float
    robot_seconds: float
    tip: Array
    contacts: Array
    sections: Array
    everted: float
    substeps: int
    iterations: int


@njit
def _repeat_contacts(parameters: Parameters, state: State, ws: Workspace, dt: float, count: int) -> None:
    for _ in range(count):
        add_contacts(parameters, state, ws, state.position, state.frame, dt)


def replay(script: Script, model: Model, numerics: Numerics, *, time_parts: bool = False) -> Replay:
    """Run a script's commands at some resolution, timing the simulator only."""
    simulator = Simulator(model, script.world, numerics)
    simulator.advance(script.commands[0], script.duration)  # compile, or load from the cache
    simulator.reset(everted_length=script.everted_length)
    tip, contacts, sections = [], [], []
    seconds = contact = reading_seconds = 0.0
    state = simulator.state
    _repeat_contacts(simulator.parameters, state, simulator.workspace, 0.1, 1)
    for command in script.commands:
        before = state.scalar[[Scalar.ITERATIONS, Scalar.SUBSTEPS]].copy()
        start = time.process_time()
        reading = simulator.advance(command, script.duration)
        seconds += time.process_time() - start
        tip.append(reading.tip_position)
        contacts.append(reading.contact_count)
        sections.append(int(state.links[0]))
        if time_parts:
            # An evaluation of all contacts per iteration and one to begin each step; repeated, to be above the clock's
            # grain.
            count = int((state.scalar[[Scalar.ITERATIONS, Scalar.SUBSTEPS]] - before).sum())
            start = time.process_time()
            _repeat_contacts(simulator.parameters, state, simulator.workspace, 0.1, 10 * count)
            contact += 0.1 * (time.process_time() - start)
            start = time.process_time()
            for _ in range(10):
                _ = simulator.reading
            reading_seconds += 0.1 * (time.process_time() - start)
    return Replay(
        seconds=seconds,
        contact=contact,
        reading=reading_seconds,
        robot_seconds=script.duration * len(script.commands),
        tip=np.array(tip),
        contacts=np.array(contacts, float),
        sections=np.array(sections, float),
        everted=reading.everted_length,
        substeps=int(state.scalar[Scalar.SUBSTEPS]),
        iterations=int(state.scalar[Scalar.ITERATIONS]),
    )


@dataclass(frozen=True)
class Bench:
    """Measure the simulator's speed and accuracy."""

    json: bool = False
    """Print one JSON object and nothing else."""
    ducts: int = 5
    """Held-out ducts to run (and as many peg fields)."""
    model: str = "mammobot_2023"
    """Shipped model or model file."""
    section_length_mm: float = Numerics().section_length_mm
    """Distance between sections [mm]."""
    step_s: float = Numerics().step_s
    """Longest implicit step [s]."""
    repeats: int = 3
    """Replays against the clock; the fastest counts, as the machine's other work only adds."""

    def run(self) -> int:
        """Run the benchmark and print it; returns the exit code."""
        if self.ducts < 1 or self.repeats < 1:
            raise ConfigError(f"ducts and repeats must be at least 1; got {self.ducts} and {self.repeats}.")
        result = self.measure()
        print(json.dumps(result, indent=2) if self.json else _describe(result))
        return 0

    def measure(self) -> dict[str, Any]:
        """Return the benchmark's figures."""
        model = load_model(self.model)
        numerics = Numerics(section_length_mm=self.section_length_mm, step_s=self.step_s)
        ducts = [record_duct(self.model, rank) for rank in range(self.ducts)]
        pegs = [record_pegs(self.model, index) for index in range(self.ducts)]
        free = [record_free(model)]
        return {
            "duct": self._measure_task(ducts, model, numerics),
            "pegs": self._measure_task(pegs, model, numerics),
            "free": self._measure_task(free, model, numerics),
            "scaling": self._measure_scaling(ducts[0], model, numerics),
        }

    def _measure_task(self, scripts: list[Script], model: Model, numerics: Numerics) -> dict[str, Any]:
        """Return the figures of one task over all its scripts."""
        fine = replace(
            numerics,
            section_length_mm=numerics.section_length_mm / REFINEMENT,
            step_s=numerics.step_s / REFINEMENT,
        )
        cpu = robot = env_cpu = contact = wrapper = env_steps = 0.0
        rows: list[dict[str, Any]] = []
        for script in scripts:
            runs = [replay(script, model, numerics, time_parts=i == 0) for i in range(self.repeats)]
            best = min(runs, key=lambda run: run.seconds)
            change = np.linalg.norm(replay(script, model, fine).tip - best.tip, axis=1)
            cpu += best.seconds
            contact += runs[0].contact * best.seconds / runs[0].seconds
            wrapper += runs[0].reading * best.seconds / runs[0].seconds
            robot += best.robot_seconds
            env_cpu += script.env_seconds
            env_steps += script.env_steps
            rows.append(
                {
                    "name": script.name,
                    "real_time_factor": best.robot_seconds / best.seconds,
                    "contacts_mean": float(best.contacts.mean()),
                    "everted_mm": best.everted * 1e3,
                    "tip_change_mm": float(change.max()) * 1e3,
                    "tip_change_final_mm": float(change[-1]) * 1e3,
                    "sections_final": int(best.sections[-1]),
                    "newton_iterations_per_step": best.iterations / best.substeps,
                }
            )
        result: dict[str, Any] = {
            "real_time_factor": robot / cpu,
            "sections": int(max(row["sections_final"] for row in rows)),
            "step_s": script.duration / math.ceil(script.duration / numerics.step_s - 1e-9),
            "contacts_mean": float(np.mean([row["contacts_mean"] for row in rows])),
            "tip_change_mm": max(row["tip_change_mm"] for row in rows),
            "runs": rows,
        }
        kernel_per_step = (cpu - wrapper) / robot * script.duration
        # In free space there is no task: a step is a command of the simulator, and Python its reading.
        per_step = env_cpu / env_steps if env_steps else cpu / robot * script.duration
        python = max(1.0 - kernel_per_step / per_step, 0.0)
        touch = min(contact / cpu, 1.0) * (1.0 - python)
        result["env_steps_per_cpu_s"] = 1.0 / per_step
        result["share"] = {"solver": 1.0 - python - touch, "contact": touch, "python": python}
        return result

    def _measure_scaling(self, script: Script, model: Model, numerics: Numerics) -> list[dict[str, float]]:
        """Return the CPU time per implicit step against the number of sections, on one duct."""
        rows = []
        for factor in (0.5, 1.0, 2.0, 4.0):
            finer = replace(numerics, section_length_mm=numerics.section_length_mm / factor)
            run = min((replay(script, model, finer) for _ in range(self.repeats)), key=lambda run: run.seconds)
            micro = run.seconds * 1e6
            rows.append(
                {
                    "sections": float(run.sections.mean()),
                    "cpu_us_per_step": micro / run.substeps,
                    "cpu_us_per_iteration": micro / (run.iterations + run.substeps),
                }
            )
        return rows


def _describe(result: dict[str, Any]) -> str:
    """Return the figures as a table for people."""
    lines = [f"{'':6}{'x real time':>12}{'env steps/s':>13}{'sections':>10}{'contacts':>10}{'tip change':>13}"]
    for name in ("duct", "pegs", "free"):
        row = result[name]
        steps = f"{row['env_steps_per_cpu_s']:.0f}"
        lines.append(
            f"{name:6}{row['real_time_factor']:>12.0f}{steps:>13}{row['sections']:>10}{row['contacts_mean']:>10.1f}"
            f"{row['tip_change_mm']:>10.3f} mm"
        )
    x = np.log([row["sections"] for row in result["scaling"]])
    y = np.log([row["cpu_us_per_step"] for row in result["scaling"]])
    lines.append(f"cost per step grows as sections^{np.polyfit(x, y, 1)[0]:.2f}")
    return "\n".join(lines)
