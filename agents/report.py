"""The report of an evaluation: one HTML file that holds everything it shows."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import tyro
from rich.console import Console
from rich.table import Table
from rich.text import Text

from evergym.agents.arms import Arm, make_policy
from evergym.agents.env_factory import make_env
from evergym.agents.episodes import EpisodeRecord, Step, run_episode
from evergym.agents.evaluation import Evaluation, open_evaluation, summarise_folder
from evergym.agents.figures import (
    assign_colours,
    draw_curves,
    draw_reached_over_time,
    draw_success,
    draw_wall_force,
    encode_frame,
)
from evergym.agents.learning_curve import read_curve
from evergym.agents.progress import ProgressReport
from evergym.agents.run_folder import RunFolder, collect_versions
from evergym.agents.settings import parse_options
from evergym.agents.statistics import Estimate
from evergym.agents.summary import METRICS, ArmSummary, PairSummary, SplitSummary, Summary
from evergym.whole_file import write_whole

__all__ = ["Report", "print_table", "write_report"]

PICTURE_COUNT = 5
"""Frames per episode."""


@dataclasses.dataclass(frozen=True)
class Report:
    """Write the report of an evaluation again, from its episodes."""

    folder: tyro.conf.Positional[Path]
    """Evaluation folder."""
    pictures: bool = True
    """Run some episodes again to show pictures of them."""

    def run(self) -> int:
        """Write the report; returns the exit code."""
        print_table(summarise_folder(self.folder))
        print(f"Report: {write_report(self.folder, pictures=self.pictures)}")
        return 0


@dataclasses.dataclass(frozen=True)
class Case:
    """One anatomy on which arms are shown side by side."""

    title: str
    strips: tuple[tuple[str, str, tuple[tuple[str, str], ...]], ...]
    """Arm, outcome, and (caption, image) of each frame."""


def write_report(folder: Path, *, pictures: bool = True) -> Path:
    """Write ``report.html`` into an evaluation folder.

    Args:
        folder: The evaluation.
        pictures: Whether to run a few episodes again and show them.

    Raises:
        RunError: The folder holds no evaluation, or no finished episode.
    """
    plan, records = open_evaluation(folder)
    summary = summarise_folder(folder)
    main = summary.splits[0].split
    colours = assign_colours([arm.name for arm in plan.arms])
    first_split = [record for record in records if record.split == main]
    runs = {arm.name: RunFolder.open(Path(arm.source)) for arm in plan.arms if arm.learned}
    curves = {name: points for name, run in runs.items() if (points := read_curve(run.curve))}
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("evergym.agents"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
    )
    environment.filters["percent"] = format_percent
    environment.filters["points"] = format_points
    environment.filters["estimate"] = format_estimate
    environment.filters["p_value"] = format_p_value
    html = environment.get_template("report.html").render(
        plan=plan,
        summary=summary,
        main=main,
        metrics=METRICS,
        headline=describe_result(plan, summary.splits[0]),
        details=[describe_pair(pair) for pair in summary.splits[0].pairs],
        success_figure=draw_success(summary, colours),
        time_figure=draw_reached_over_time(first_split, colours),
        force_figure=draw_wall_force(first_split, colours),
        curve_figure=draw_curves(curves) if curves else "",
        cases=_show_cases(plan, first_split) if pictures else (),
        settings={name: (run.path / "settings.toml").read_text(encoding="utf-8") for name, run in runs.items()},
        training={name: run.latest().progress for name, run in runs.items()},
        versions=collect_versions(),
    )
    target = folder / "report.html"
    write_whole(target, html)
    return target


def describe_result(plan: Evaluation, split: SplitSummary) -> str:
    """The result in words for someone who knows no statistics: the first arm on the first split."""
    shown = split.arms[0]
    place = "anatomies it had never seen" if plan.arms[0].learned and split.split != "train" else "anatomies"
    text = (
        f"On {shown.episode_count} {place} ({split.split}), {_name(plan.arms[0])} reached the target "
        f"{round(shown.success.value * shown.episode_count)} times"
    )
    pair = next((pair for pair in split.pairs if pair.arm == shown.arm), None)
    if pair is None:
        return f"{text} ({format_percent(shown.success)})."
    reference = next(arm for arm in split.arms if arm.arm == pair.reference)
    times = round(reference.success.value * reference.episode_count)
    comparison = pair.success
    if comparison.p_value >= 0.05:
        verdict = "a difference that can well be chance"
    elif comparison.difference.value > 0:
        verdict = "so it is better, by more than chance explains"
    else:
        verdict = "so it is worse, by more than chance explains"
    return f"{text}, {pair.reference} {times} times: {verdict}."


def describe_pair(pair: PairSummary) -> str:
    """Wins and losses of an arm against the reference."""
    comparison = pair.success
    return (
        f"{pair.arm} reached {comparison.first_only} targets that {pair.reference} missed, and missed "
        f"{comparison.second_only} that {pair.reference} reached."
    )


def _name(arm: Arm) -> str:
    return f"the learned policy ({arm.name})" if arm.learned else arm.name


def format_percent(estimate: Estimate) -> str:
    """``84 % (76 to 90)``."""
    if math.isnan(estimate.value):
        return "-"
    text = f"{100 * estimate.value:.0f} %"
    return text if math.isnan(estimate.low) else f"{text} ({100 * estimate.low:.0f} to {100 * estimate.high:.0f})"


def format_points(estimate: Estimate) -> str:
    """``+12 (+3 to +21)`` percentage points."""
    return format_estimate(Estimate(*(100.0 * value for value in estimate)), 0, sign=True)


def format_estimate(estimate: Estimate, digits: int, sign: bool = False) -> str:
    """``12.3 (11.0 to 13.9)``; with ``sign`` for differences."""
    if math.isnan(estimate.value):
        return "-"
    form = f"{'+' if sign else ''}.{digits}f"
    text = f"{estimate.value:{form}}"
    return text if math.isnan(estimate.low) else f"{text} ({estimate.low:{form}} to {estimate.high:{form}})"


def format_p_value(value: float) -> str:
    """``0.032``, or ``< 0.001``."""
    return "< 0.001" if value < 0.001 else f"{value:.3f}"


def print_table(summary: Summary) -> None:
    """Print the comparison in the terminal."""
    for split in summary.splits:
        table = Table(title=f"{split.split}: {split.arms[0].episode_count} anatomies (mean and 95 % interval)")
        table.add_column("arm")
        table.add_column("reached")
        table.add_column(f"only it / only {summary.reference}, p")
        for metric in METRICS:
            table.add_column(Text(metric.label))  # as a plain string rich would take [mm] for a style
        pairs = {pair.arm: pair.success for pair in split.pairs}
        for arm in split.arms:
            pair = pairs.get(arm.arm)
            against = f"{pair.first_only} / {pair.second_only}, {format_p_value(pair.p_value)}" if pair else "-"
            table.add_row(arm.arm, format_percent(arm.success), against, *_format_metrics(arm))
        Console(width=150).print(table)
    for split_name, estimate in summary.training_seeds.items():
        print(f"Success over training seeds (interquartile mean), {split_name}: {format_percent(estimate)}")


def _format_metrics(arm: ArmSummary) -> list[str]:
    return [format_estimate(arm.metrics[metric.name], metric.digits) for metric in METRICS]


def _select_cases(plan: Evaluation, records: Sequence[EpisodeRecord]) -> list[tuple[str, int, list[EpisodeRecord]]]:
    """Choose anatomies by fixed rules, so that nobody picks the pretty ones: the first of each kind of outcome."""
    shown, reference = plan.arms[0].name, plan.reference
    by_index: dict[int, dict[str, EpisodeRecord]] = {}
    for record in records:
        by_index.setdefault(record.index, {})[record.arm] = record
    kinds = (
        (f"The first anatomy that both {shown} and {reference} reached", True, True),
        (f"The first that {shown} reached and {reference} missed", True, False),
        (f"The first that {shown} missed and {reference} reached", False, True),
        ("The first that both missed", False, False),
    )
    cases = []
    for title, own, other in kinds:
        for index, arms in sorted(by_index.items()):
            if shown in arms and reference in arms and (arms[shown].success, arms[reference].success) == (own, other):
                cases.append((title, index, [arms[name] for name in dict.fromkeys((shown, reference))]))
                break
    return cases


def _show_cases(plan: Evaluation, records: Sequence[EpisodeRecord]) -> tuple[Case, ...]:
    selected = _select_cases(plan, records)
    arms = {arm.name: arm for arm in plan.arms}
    env = make_env(plan.env, {**parse_options(plan.env_options), "render_mode": "rgb_array"})
    cases: list[Case] = []
    try:
        with ProgressReport("Pictures", sum(len(case[2]) for case in selected), unit="episodes") as report:
            done = 0
            for title, index, shown in selected:
                strips = []
                for record in shown:
                    frames = _take_pictures(env, arms[record.arm], record)
                    outcome = f"{record.end_reason or 'end'}, {record.tip_error_mm:.1f} mm from the target"
                    strips.append((record.arm, outcome, frames))
                    done += 1
                    report.update(done)
                cases.append(Case(f"{title} (number {index})", tuple(strips)))
    finally:
        env.close()
    return tuple(cases)


def _take_pictures(env: Any, arm: Arm, record: EpisodeRecord) -> tuple[tuple[str, str], ...]:
    """Run a recorded episode again and draw it at evenly spaced steps."""
    last = record.step_count
    wanted = {round(last * number / (PICTURE_COUNT - 1)) for number in range(PICTURE_COUNT)}
    frames: list[tuple[str, str]] = []

    def observe(step: Step) -> None:
        if step.number in wanted:
            caption = f"{step.info['time_s']:.0f} s" if "time_s" in step.info else f"step {step.number}"
            frames.append((caption, encode_frame(env.render())))

    policy = make_policy(arm, env)
    again = run_episode(
        env, policy, arm=arm.name, split=record.split, index=record.index, seed=record.seed, observe=observe
    )
    if (again.success, again.step_count) != (record.success, record.step_count):
        frames.append(("The episode went differently when it was run again: the arm is not deterministic.", ""))
    return tuple(frames)
