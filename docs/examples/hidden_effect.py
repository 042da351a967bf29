"""A robot with a hidden effect: measure it, find what the model lacks, and plan with the corrected model.

    python docs/examples/hidden_effect.py --out study
    python docs/examples/hidden_effect.py --out study --small

The robot is the shipped one, a little stiffer and slower than its data sheet. The lab's model knows nothing of the play
in the robot's tendon drive. docs/tutorial_hidden_effect.md walks through it.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np
import tyro

from evergym import Command, Model, Simulator, World, load_model
from evergym.agents.rehearsal import Trial, compare_models, describe_trials
from evergym.discrepancy import diagnose
from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.data.export import add_noise, write_dataset
from evergym.discrepancy.data.record import Recorder
from evergym.discrepancy.diagnosis import Diagnosis
from evergym.discrepancy.words import describe_gap, describe_verdict, describe_where
from evergym.effects.tendon_backlash import TendonBacklash
from evergym.errors import ConfigError
from evergym.model import Numerics, save_model
from evergym.units import KPA, MM

NOISE = {"tip_x_mm": 0.3, "tip_z_mm": 0.3, "everted_length_mm": 0.5, "pressure_measured_kpa": 0.3}
"""One standard deviation of the bench's cameras, encoder and gauge."""
SAMPLING_S = 0.2
TASKS = ("MammobotPegs-v0", "MammobotDuct-v0")


@dataclasses.dataclass(frozen=True)
class Experiment:
    """A bench run: pressure and feed are held, the tendon is pulled through way points at a steady rate."""

    name: str
    length_mm: float
    pressure_kpa: float
    pulls_mm: tuple[float, ...]
    insertion_mm_s: float = 0.0
    seconds_per_pull: float = 2.0


EXPERIMENTS = (
    Experiment("to and fro", 80.0, 20.0, (4.5, 0.0)),
    Experiment("to and fro", 80.0, 20.0, (4.5, 0.0)),
    Experiment("zigzag", 60.0, 20.0, (3.5, 2.0, 4.5, 3.0, 0.0), seconds_per_pull=1.5),
    Experiment("high pressure", 90.0, 45.0, (4.9, 2.5, 4.0)),
    Experiment("growing bent", 30.0, 45.0, (3.5, 3.5, 3.0), insertion_mm_s=2.0),
    Experiment("growing straight", 30.0, 35.0, (0.0, 0.0), insertion_mm_s=2.5),
)


def make_models(folder: Path) -> tuple[Path, Path]:
    """Write the robot's and the lab's model files; return their paths."""
    sheet = load_model("mammobot_2023")
    stiffness = 1.04 * sheet.robot.catheter_bending_stiffness_n_m2
    lag = dataclasses.replace(sheet.effects.pressure_lag, time_s=0.17)
    robot = dataclasses.replace(
        sheet,
        name="robot",
        robot=dataclasses.replace(sheet.robot, catheter_bending_stiffness_n_m2=stiffness),
        effects=dataclasses.replace(sheet.effects, pressure_lag=lag),
    )
    no_play = TendonBacklash(backlash_mm=0.0, lost_motion_mm=0.0)
    lab = dataclasses.replace(sheet, name="lab", effects=dataclasses.replace(sheet.effects, tendon_backlash=no_play))
    paths = folder / "robot.toml", folder / "lab.toml"
    for model, path in zip((robot, lab), paths, strict=True):
        save_model(model, path)
    return paths


def measure(robot: Model, experiment: Experiment, number: int) -> Run:
    """Run an experiment on the robot, in other steps and sections than a diagnosis simulates."""
    simulator = Simulator(robot, World.free(), Numerics(section_length_mm=2.2, step_s=0.025))
    simulator.reset(everted_length=experiment.length_mm * MM)
    recorder = Recorder(simulator)
    now = 0.0
    recorder.advance(Command(pressure=experiment.pressure_kpa * KPA), 0.6)
    for pull in experiment.pulls_mm:
        count = round(experiment.seconds_per_pull / SAMPLING_S)
        for part in range(1, count + 1):
            command = Command(
                insertion_velocity=experiment.insertion_mm_s * MM,
                tendon_pull=(now + (pull - now) * part / count) * MM,
                pressure=experiment.pressure_kpa * KPA,
            )
            recorder.advance(command, SAMPLING_S)
        now = pull
    return recorder.finish(f"r{number:02d}", experiment.name)


def make_bench_data(folder: Path, robot: Path, seed: int = 0) -> Path:
    """Measure the robot and write the dataset; return its folder."""
    rng = np.random.default_rng(seed)
    model = load_model(robot)
    runs = [measure(model, experiment, number) for number, experiment in enumerate(EXPERIMENTS, 1)]
    return write_dataset(folder, [add_noise(run, NOISE, rng) for run in runs], NOISE, name="bench")


@dataclasses.dataclass(frozen=True)
class Findings:
    """What the study found."""

    diagnosis: Diagnosis
    trials: dict[str, list[Trial]]
    """By task: plans made in the lab's model, and in the corrected one."""


def run_study(out: Path, episodes: int, tasks: tuple[str, ...] = TASKS, jobs: int = 1) -> Findings:
    """Measure, diagnose, and plan with both models."""
    robot, lab = make_models(out)
    diagnosis = diagnose(make_bench_data(out / "bench", robot), lab, out / "found", jobs=jobs)
    models = str(lab), str(out / "found" / "model.toml")
    trials = {task: compare_models(task, str(robot), models, episodes=episodes) for task in tasks}
    return Findings(diagnosis, trials)


def main(out: Path, episodes: int = 48, small: bool = False, jobs: int = 0) -> int:
    """Measure a robot, find what the model lacks, and plan with the corrected model.

    Args:
        out: Folder to make.
        episodes: Anatomies of each task.
        small: Pegs only, and eight of them.
        jobs: Processes for the diagnosis (0: one per core).
    """
    if out.exists():
        print(f"'{out}' is there already. Choose another folder.", file=sys.stderr)
        return 1
    out.mkdir(parents=True)
    try:
        findings = run_study(out, 8 if small else episodes, TASKS[:1] if small else TASKS, jobs)
    except ConfigError as error:
        print(error, file=sys.stderr)
        return 1
    diagnosis = findings.diagnosis
    print(describe_verdict(diagnosis), describe_where(diagnosis), describe_gap(diagnosis), sep="\n")
    for effect in diagnosis.effects:
        for interval in diagnosis.parameters[effect.name]:
            print(f"  {interval.path} = {interval.estimate:.4g} ({interval.low_90:.4g} to {interval.high_90:.4g})")
    for task, trials in findings.trials.items():
        print(f"\n{task}, held-out anatomies, carried out on the robot without looking")
        print(describe_trials(trials, ("the lab's model", "the corrected model")))
    return 0


if __name__ == "__main__":
    sys.exit(tyro.cli(main))
