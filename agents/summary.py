"""From episode records to a summary: every arm with intervals, and every arm against the reference arm."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from evergym.agents.episodes import EpisodeRecord
from evergym.agents.statistics import (
    Comparison,
    Estimate,
    compare_paired,
    compute_wilson,
    resample_iqm,
    resample_mean,
)
from evergym.whole_file import write_whole

__all__ = ["METRICS", "ArmSummary", "Metric", "PairSummary", "SplitSummary", "Summary", "summarise", "write_summary"]


class Metric(NamedTuple):
    """A number per episode; ``reached_only``: it means something only where the target was reached."""

    name: str
    label: str
    reached_only: bool
    digits: int


METRICS = (
    Metric("time_s", "time to target [s]", True, 0),
    Metric("tip_error_mm", "tip error at the end [mm]", False, 1),
    Metric("path_ratio", "path ratio", True, 2),
    Metric("protrusion_mm", "catheter beyond sheath at the end [mm]", False, 1),
    Metric("wall_force_peak_n", "peak wall force [N]", False, 3),
    Metric("wall_force_p95_n", "95th-percentile wall force [N]", False, 3),
)


class ArmSummary(NamedTuple):
    """One arm on one split."""

    arm: str
    episode_count: int
    success: Estimate
    metrics: dict[str, Estimate]
    end_reasons: dict[str, int]


class PairSummary(NamedTuple):
    """One arm against the reference arm on the episodes both have; differences are arm minus reference."""

    arm: str
    reference: str
    episode_count: int
    success: Comparison
    metrics: dict[str, Estimate]


class SplitSummary(NamedTuple):
    """All arms on one split."""

    split: str
    arms: tuple[ArmSummary, ...]
    pairs: tuple[PairSummary, ...]


class Summary(NamedTuple):
    """All splits, and the learned arms together if there are several training seeds."""

    reference: str
    splits: tuple[SplitSummary, ...]
    training_seeds: dict[str, Estimate]
    """Interquartile mean over the learned arms of their success rates: per split, and "all splits"."""


def summarise(records: Sequence[EpisodeRecord], reference: str, learned: Sequence[str] = ()) -> Summary:
    """Summarise records; arms and splits keep the order of their first appearance.

    Args:
        records: All episodes.
        reference: Arm that the others are compared with.
        learned: Arms that are training seeds of one method.
    """
    splits = tuple(dict.fromkeys(record.split for record in records))
    summaries = tuple(_summarise_split(split, [r for r in records if r.split == split], reference) for split in splits)
    seeds: dict[str, Estimate] = {}
    if len(learned) >= 2:
        rates = {
            summary.split: [arm.success.value for arm in summary.arms if arm.arm in learned] for summary in summaries
        }
        complete = {split: values for split, values in rates.items() if len(values) == len(learned)}
        seeds = {split: resample_iqm(np.array(values)[:, None]) for split, values in complete.items()}
        if len(complete) > 1:
            seeds["all splits"] = resample_iqm(np.column_stack(list(complete.values())))
    return Summary(reference, summaries, seeds)


def _summarise_split(split: str, records: Sequence[EpisodeRecord], reference: str) -> SplitSummary:
    names = tuple(dict.fromkeys(record.arm for record in records))
    by_arm = {name: {r.index: r for r in records if r.arm == name} for name in names}
    arms = tuple(_summarise_arm(name, list(by_arm[name].values())) for name in names)
    pairs = tuple(
        pair
        for name in names
        if name != reference and reference in by_arm
        for pair in [_summarise_pair(name, reference, by_arm[name], by_arm[reference])]
        if pair is not None
    )
    return SplitSummary(split, arms, pairs)


def _summarise_arm(name: str, records: Sequence[EpisodeRecord]) -> ArmSummary:
    metrics = {
        metric.name: resample_mean([_value(r, metric) for r in records if r.success or not metric.reached_only])
        for metric in METRICS
    }
    success = compute_wilson(sum(record.success for record in records), len(records))
    return ArmSummary(name, len(records), success, metrics, dict(Counter(record.end_reason for record in records)))


def _summarise_pair(
    name: str, reference: str, first: dict[int, EpisodeRecord], second: dict[int, EpisodeRecord]
) -> PairSummary | None:
    shared = sorted(first.keys() & second.keys())
    if not shared:
        return None
    pairs = [(first[index], second[index]) for index in shared]
    metrics = {
        metric.name: resample_mean(
            [
                _value(a, metric) - _value(b, metric)
                for a, b in pairs
                if (a.success and b.success) or not metric.reached_only
            ]
        )
        for metric in METRICS
    }
    success = compare_paired([a.success for a, _ in pairs], [b.success for _, b in pairs])
    return PairSummary(name, reference, len(pairs), success, metrics)


def _value(record: EpisodeRecord, metric: Metric) -> float:
    return float(getattr(record, metric.name))


def write_summary(summary: Summary, path: Path) -> None:
    """Write a summary as JSON, atomically; NaN becomes null."""
    write_whole(path, json.dumps(_to_plain(summary), indent=2, allow_nan=False) + "\n")


def _to_plain(value: Any) -> Any:
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return {key: _to_plain(item) for key, item in value._asdict().items()}
    if isinstance(value, tuple):
        return [_to_plain(item) for item in value]
    if isinstance(value, dict):
        return {key: _to_plain(item) for key, item in value.items()}
    return None if isinstance(value, float) and math.isnan(value) else value
