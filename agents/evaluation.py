"""Evaluation: all arms on the same anatomies and seeds, in parallel, resumable, with a summary and a report."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import os
from collections.abc import Sequence
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import tyro

from evergym.agents.arms import Arm, find_controller_arm, find_run_arm, make_policy
from evergym.agents.code_fingerprint import fingerprint_code
from evergym.agents.env_factory import ignore_interrupts, make_env, prepare_workers, probe_env, resolve_env_id
from evergym.agents.episodes import EpisodeRecord, append_records, read_records, run_episode
from evergym.agents.progress import ProgressReport
from evergym.agents.run_folder import RunFolder
from evergym.agents.settings import parse_options, read_settings, write_settings
from evergym.agents.suggest import suggest
from evergym.agents.summary import Summary, summarise, write_summary
from evergym.errors import ConfigError, RunError

__all__ = ["Evaluate", "Evaluation", "derive_episode_seed", "evaluate", "open_evaluation", "summarise_folder"]

DEFAULT_SPLITS = ("held_out", "wide_angle", "narrow", "deep")


@dataclasses.dataclass(frozen=True)
class Evaluate:
    """Compare learned policies and controllers on the same anatomies and write a report."""

    runs: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Run folders of learned policies (several training seeds are also summarised together)."""
    arms: tuple[str, ...] = ("duty_cycle", "push_only", "random")
    """Controllers beside them: duty_cycle, push_only, random, or your own as name=module:Class."""
    reference: str = "duty_cycle"
    """Arm that all others are compared with."""
    env: str | None = None
    """Environment id (None: that of the runs)."""
    env_options: tuple[str, ...] | None = None
    """Arguments of the environment as key=value (None: those of the runs)."""
    splits: tuple[str, ...] = DEFAULT_SPLITS
    """Families of anatomies; "default" leaves the choice to the environment and its seed."""
    episodes: int = 100
    """Anatomies per split."""
    seed: int = 1_000_000
    """Seed of targets and noise."""
    workers: int = 0
    """Processes (0: one per core)."""
    folder: Path | None = None
    """Folder of the results (None: evaluation/ in the first run, else runs/evaluation-<env>); one that holds a part of
    the same evaluation is completed."""
    report: bool = True
    """Write report.html, with pictures of some episodes."""

    def run(self) -> int:
        """Evaluate and write the report; returns the exit code."""
        from evergym.agents.report import print_table, write_report

        folder = evaluate(self)
        print_table(summarise_folder(folder))
        if self.report:
            print(f"Report: {write_report(folder)}")
        return 0


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """What an evaluation folder was made with (evaluation.toml); it is completed only by the same."""

    env: str
    env_options: tuple[str, ...]
    seed: int
    reference: str
    code: str
    arms: tuple[Arm, ...]


def derive_episode_seed(seed: int, split: str, index: int) -> int:
    """Seed of an episode: the same for all arms, different for all splits and indices."""
    entropy = [seed, index, *split.encode()]
    return int(np.random.SeedSequence(entropy).generate_state(1)[0] >> 1)


def evaluate(settings: Evaluate) -> Path:
    """Run all episodes that are not there yet.

    Returns:
        The folder with evaluation.toml, episodes.csv and summary.json.

    Raises:
        ConfigError: An unknown environment, split or controller.
        RunError: A run is missing or of another environment, or the folder holds another evaluation.
    """
    if settings.episodes < 1:
        raise ConfigError(f"An evaluation needs at least 1 episode per split; got episodes = {settings.episodes}.")
    plan = _plan(settings)
    folder = settings.folder or _name_folder(settings, plan)
    _open_folder(folder, plan)
    table = folder / "episodes.csv"
    done = {record.key for record in read_records(table)}
    _mend(table)
    jobs: list[_Job] = []
    for index in range(settings.episodes):
        for split in dict.fromkeys(settings.splits):
            arms = tuple(arm for arm in plan.arms if (arm.name, split, index) not in done)
            seed = derive_episode_seed(plan.seed, split, index)
            if arms:
                jobs.append(_Job(arms, split, index, seed, plan.env, plan.env_options))
    total = settings.episodes * len(dict.fromkeys(settings.splits)) * len(plan.arms)
    try:
        _run_jobs(jobs, table, total, settings.workers)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("Run the same command again to complete the evaluation.") from None
    write_summary(summarise_folder(folder), folder / "summary.json")
    return folder


def open_evaluation(folder: Path) -> tuple[Evaluation, list[EpisodeRecord]]:
    """Read what an evaluation was made with, and its episodes in the order of arms, splits and indices.

    Raises:
        RunError: The folder holds no evaluation, or none of its episodes is finished.
    """
    if not (folder / "evaluation.toml").is_file():
        raise RunError(f"'{folder}' is not an evaluation folder: it has no evaluation.toml.")
    plan = read_settings(Evaluation, folder / "evaluation.toml")
    order = {arm.name: number for number, arm in enumerate(plan.arms)}
    records = read_records(folder / "episodes.csv")
    if not records:
        raise RunError(f"Evaluation '{folder}' has no finished episode yet; run it again to complete it.")
    splits = {split: number for number, split in enumerate(DEFAULT_SPLITS)}
    records.sort(key=lambda r: (splits.get(r.split, len(splits)), r.split, order[r.arm], r.index))
    return plan, records


def summarise_folder(folder: Path) -> Summary:
    """Summarise the episodes of an evaluation folder."""
    plan, records = open_evaluation(folder)
    return summarise(records, plan.reference, [arm.name for arm in plan.arms if arm.learned])


def _plan(settings: Evaluate) -> Evaluation:
    runs = [RunFolder.open(path) for path in settings.runs]
    env, options = settings.env, settings.env_options
    for run in runs:
        trained = run.settings
        if env is None:
            env = trained.env
        if options is None:
            options = trained.env_options
        if resolve_env_id(trained.env) != resolve_env_id(env):
            raise RunError(f"Run '{run.path}' was trained on '{trained.env}' and cannot be evaluated on '{env}'.")
    env = env or "MammobotDuct-v0"
    options = options or ()
    arms = tuple([find_run_arm(path) for path in settings.runs] + [find_controller_arm(word) for word in settings.arms])
    names = [arm.name for arm in arms]
    if not arms:
        raise ConfigError("There is nothing to evaluate: give a run folder or --arms.")
    if len(set(names)) < len(names):
        raise ConfigError(f"Two arms have the same name: {', '.join(names)}. Name controllers as name=module:Class.")
    reference = settings.reference
    if reference not in names:
        if reference != Evaluate.reference:  # asked for by name
            raise ConfigError(f"The reference '{reference}' is not among the arms{suggest(reference, names)}")
        reference = names[0]
    probe_env(env, parse_options(options))
    return Evaluation(resolve_env_id(env), options, settings.seed, reference, fingerprint_code(), arms)


def _name_folder(settings: Evaluate, plan: Evaluation) -> Path:
    if settings.runs:
        return settings.runs[0] / "evaluation"
    return Path("runs") / f"evaluation-{plan.env.rpartition(':')[2]}"


def _open_folder(folder: Path, plan: Evaluation) -> None:
    stored_path = folder / "evaluation.toml"
    if not folder.exists():
        try:
            folder.mkdir(parents=True)
        except OSError as error:
            raise RunError(f"Evaluation folder '{folder}' cannot be made: {error}.") from error
        write_settings(plan, stored_path)
        return
    if not stored_path.is_file():
        raise RunError(f"'{folder}' exists and is not an evaluation; it is not overwritten. Choose another --folder.")
    stored = read_settings(Evaluation, stored_path)
    for field in dataclasses.fields(Evaluation):
        before, now = getattr(stored, field.name), getattr(plan, field.name)
        if before != now:
            what = (
                "the code of evergym has changed" if field.name == "code" else f"{field.name} was {before}, now {now}"
            )
            raise RunError(
                f"Evaluation folder '{folder}' holds other episodes that must not be mixed with these: {what}. "
                "Choose another --folder, or delete this one."
            )


def _mend(table: Path) -> None:
    """End a line that a kill has cut off, so that the next row does not join it."""
    if table.is_file() and not table.read_bytes().endswith(b"\n"):
        with table.open("a", encoding="utf-8") as file:
            file.write("\n")


@dataclasses.dataclass(frozen=True)
class _Job:
    """All arms on one anatomy: in one process, so that the anatomy is built once."""

    arms: tuple[Arm, ...]
    split: str
    index: int
    seed: int
    env: str
    env_options: tuple[str, ...]


def _run_jobs(jobs: Sequence[_Job], table: Path, total: int, workers: int) -> None:
    done = total - sum(len(job.arms) for job in jobs)
    successes = {arm.name: [0, 0] for job in jobs for arm in job.arms}
    with ProgressReport("Evaluation", total, done, "episodes") as report:
        for records in _map_jobs(jobs, workers):
            append_records(table, records)
            done += len(records)
            for record in records:
                successes[record.arm][0] += record.success
                successes[record.arm][1] += 1
            note = ", ".join(f"{name} {k}/{n}" for name, (k, n) in successes.items())
            report.update(done, note)


def _map_jobs(jobs: Sequence[_Job], workers: int) -> Any:
    """Yield the records of each job as it ends."""
    count = min(workers or os.cpu_count() or 1, max(len(jobs), 1))
    if count == 1:
        yield from map(_run_job, jobs)
        return
    learned = any(arm.learned for job in jobs for arm in job.arms)
    context = prepare_workers("evergym.agents.evaluation", *(["evergym.agents.training"] if learned else []))
    with concurrent.futures.ProcessPoolExecutor(count, context, ignore_interrupts) as pool:
        futures = [pool.submit(_run_job, job) for job in jobs]
        try:
            for future in concurrent.futures.as_completed(futures):
                yield future.result()
        except BrokenProcessPool as error:
            raise RunError(
                "A process of the evaluation ended unexpectedly (killed, or out of memory). Finished episodes are "
                "kept: run the same command again to complete it, with fewer --workers if memory was short."
            ) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _run_job(job: _Job) -> list[EpisodeRecord]:
    env = _get_env(job.env, job.env_options)
    records = []
    for arm in job.arms:
        policy = make_policy(arm, env)
        records.append(run_episode(env, policy, arm=arm.name, split=job.split, index=job.index, seed=job.seed))
    return records


@lru_cache(maxsize=1)
def _get_env(name: str, options: tuple[str, ...]) -> gymnasium.Env[Any, Any]:
    """The environment of this process, kept from job to job."""
    return make_env(name, parse_options(options))
