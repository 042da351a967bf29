"""The demonstration: train on ducts, compare with the controllers on ducts never seen, write a report."""

from __future__ import annotations

import dataclasses
import sys
import time
from pathlib import Path

import tyro

from evergym.agents.env_factory import probe_env
from evergym.agents.evaluation import Evaluate, evaluate, summarise_folder
from evergym.agents.progress import format_duration
from evergym.agents.run_folder import RunFolder
from evergym.agents.settings import PpoSettings, TrainSettings, parse_options
from evergym.errors import EvergymError

__all__ = ["Demo", "DemoPlan", "main"]

ARMS = ("duty_cycle", "push_only", "random")


@dataclasses.dataclass(frozen=True)
class DemoPlan:
    """How much is done; times are for 2 cores."""

    training: TrainSettings
    """The training; its time budget ends it."""
    episodes: int
    """Held-out ducts per arm."""
    other_splits: tuple[str, ...] = ()
    """Out-of-distribution families."""
    other_episodes: int = 0
    """Ducts per arm of each of them."""


FULL = DemoPlan(
    training=TrainSettings(total_steps=2_000_000, checkpoint_interval=20_480, time_budget_min=11.0),
    episodes=60,
    other_splits=("wide_angle", "narrow", "deep"),
    other_episodes=10,
)
"""At most 20 minutes."""

QUICK = DemoPlan(
    training=TrainSettings(
        total_steps=200_000,
        checkpoint_interval=4_096,
        time_budget_min=1.25,
        ppo=PpoSettings(rollout_steps=128),
    ),
    episodes=12,
)
"""At most 3.5 minutes: shows that everything works; too short to learn well."""


@dataclasses.dataclass(frozen=True)
class Demo:
    """Train on MammobotDuct-v0, evaluate on held-out ducts against the duty cycle and others, write a report.

    A demonstration that was interrupted is continued.
    """

    quick: bool = False
    """A few minutes instead of twenty: shows that everything works, too short to learn well."""
    folder: Path = Path("runs")
    """Where the run folder demo or demo-quick is made (demo-2 and so on, if that is finished)."""
    workers: int = 0
    """Processes of the evaluation (0: one per core)."""

    def run(self) -> int:
        """Run all parts; returns the exit code."""
        return run_plan(
            QUICK if self.quick else FULL, self.folder, "demo-quick" if self.quick else "demo", self.workers
        )


def run_plan(plan: DemoPlan, parent: Path, name: str, workers: int) -> int:
    """Train, evaluate, report; prints where the report is.

    Args:
        plan: How much is done.
        parent: Folder of the run folder.
        name: Name of the run folder.
        workers: Processes of the evaluation (0: one per core).
    """
    begin = time.monotonic()
    settings, resumed = _choose_run(plan.training, parent, name)
    _announce(1, "prepare: compile the simulator and build a first duct")
    probe_env(plan.training.env, parse_options(plan.training.env_options))
    folder = settings.folder or settings.resume
    assert folder is not None  # _choose_run sets one of them
    if resumed and _is_trained(folder):
        _announce(2, f"train: done before, in {folder}")
    else:
        from evergym.agents.training import train  # torch loads here only

        _announce(2, f"train: {'continue in' if resumed else 'to'} {folder}")
        train(settings)
    _announce(3, "evaluate: all arms on the same ducts that training never saw")
    evaluation = Evaluate(runs=(folder,), arms=ARMS, splits=("held_out",), episodes=plan.episodes, workers=workers)
    results = evaluate(evaluation)
    if plan.other_splits:
        _announce(4, "evaluate: ducts of other kinds than those of the training")
        evaluate(dataclasses.replace(evaluation, splits=plan.other_splits, episodes=plan.other_episodes))
    _announce(5, "report")
    from evergym.agents.report import print_table, write_report

    report = write_report(results)
    print_table(summarise_folder(results))
    print(f"Done in {format_duration(time.monotonic() - begin)}. Report: {report.resolve()}")
    return 0


def _announce(number: int, what: str) -> None:
    print(f"[{number}/5] {what}", file=sys.stderr, flush=True)


def _choose_run(training: TrainSettings, parent: Path, name: str) -> tuple[TrainSettings, bool]:
    """Settings to start a new run or to continue an unfinished one, and whether it is the latter."""
    number = 1
    while True:
        folder = parent / (name if number == 1 else f"{name}-{number}")
        if not folder.exists():
            return dataclasses.replace(training, folder=folder), False
        number += 1
        if (folder / "evaluation" / "report.html").exists():
            continue
        try:
            run = RunFolder.open(folder)
            run.latest()
            same = dataclasses.replace(run.settings, folder=None) == training
        except EvergymError:
            continue  # not a run, or stopped before its first checkpoint: leave it alone
        if same:
            return TrainSettings(resume=folder), True


def _is_trained(folder: Path) -> bool:
    run = RunFolder.open(folder)
    settings, progress = run.settings, run.latest().progress
    budget = settings.time_budget_min
    return progress.step >= settings.total_steps or (budget is not None and progress.seconds >= 60.0 * budget)


def main() -> int:
    """Run ``python -m evergym.agents.demo``."""
    try:
        return tyro.cli(Demo, prog="python -m evergym.agents.demo", config=(tyro.conf.FlagCreatePairsOff,)).run()
    except EvergymError as error:
        print(f"evergym: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nInterrupted. Run the same command again to continue.", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
