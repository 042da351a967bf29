"""Run one episode of one arm and keep what a comparison needs; records are rows of a CSV file."""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from evergym.agents.arms import Policy

__all__ = ["EpisodeKey", "EpisodeRecord", "Step", "append_records", "read_records", "run_episode"]

EpisodeKey = tuple[str, str, int]
"""Arm, split and index of an episode."""


@dataclasses.dataclass(frozen=True)
class EpisodeRecord:
    """What is kept of one episode; NaN where the environment does not report a value."""

    arm: str
    split: str
    index: int
    """Number of the anatomy in its split."""
    seed: int
    success: bool
    time_s: float
    """Robot time at the end, so the time to the target if it was reached."""
    tip_error_mm: float
    """Distance to the target along the lumen at the end."""
    path_ratio: float
    """Travelled and remaining way over the shortest way."""
    wall_force_peak_n: float
    """Largest force on one section over the episode."""
    wall_force_p95_n: float
    """95th percentile over the steps of the largest force on one section."""
    total_reward: float = dataclasses.field(metadata={"column": "return"})
    end_reason: str = ""
    cost: float = 0.0
    """Sum over the steps."""
    step_count: int = 0
    everted_length_mm: float = math.nan
    protrusion_mm: float = math.nan
    """How far the catheter reached beyond the sheath at the end: a target can be reached by growing or by poking."""

    @property
    def key(self) -> EpisodeKey:
        """Arm, split and index."""
        return (self.arm, self.split, self.index)


@dataclasses.dataclass(frozen=True)
class Step:
    """What an observer of an episode sees; step 0 is the reset, with action None."""

    number: int
    action: Any
    observation: Any
    reward: float
    info: Mapping[str, Any]


def run_episode(
    env: gymnasium.Env[Any, Any],
    policy: Policy,
    *,
    arm: str,
    split: str,
    index: int,
    seed: int,
    observe: Callable[[Step], None] | None = None,
) -> EpisodeRecord:
    """Run one episode to its end.

    Args:
        env: The environment.
        policy: A fresh policy.
        arm: Name of the arm.
        split: Family of anatomies; "default" leaves the choice to the environment and its seed.
        index: Number of the anatomy in the family.
        seed: Seed of the reset; the same for all arms, so that they meet the same target and noise.
        observe: Called after the reset and after every step.
    """
    options = None if split == "default" else {"family": split, "index": index}
    observation, info = env.reset(seed=seed, options=options)
    env.action_space.seed(seed)  # for arms that draw from it
    if observe is not None:
        observe(Step(0, None, observation, 0.0, info))
    state: Any = None
    start = np.ones(1, dtype=bool)
    forces: list[float] = []
    total_reward = cost = 0.0
    count, ended = 0, False
    while not ended:
        action, state = policy.predict(observation, state=state, episode_start=start, deterministic=True)
        start = np.zeros(1, dtype=bool)
        observation, reward, terminated, truncated, info = env.step(action)
        count += 1
        ended = terminated or truncated
        total_reward += float(reward)
        cost += float(info.get("cost", 0.0))
        forces.append(float(info.get("wall_force_max_n", math.nan)))
        if observe is not None:
            observe(Step(count, action, observation, float(reward), info))
    return EpisodeRecord(
        arm=arm,
        split=split,
        index=index,
        seed=seed,
        success=bool(info.get("is_success", False)),
        time_s=_read(info, "time_s"),
        tip_error_mm=_read(info, "tip_error_mm"),
        path_ratio=_read(info, "path_ratio"),
        wall_force_peak_n=max(forces),
        wall_force_p95_n=float(np.percentile(forces, 95)),
        total_reward=total_reward,
        end_reason=str(info.get("end_reason", "")),
        cost=cost,
        step_count=count,
        everted_length_mm=_read(info, "everted_length_mm"),
        protrusion_mm=float(np.maximum(0.0, _read(info, "catheter_length_mm") - _read(info, "everted_length_mm"))),
    )


def _read(info: Mapping[str, Any], key: str) -> float:
    return float(info.get(key, math.nan))


_FIELDS = dataclasses.fields(EpisodeRecord)
_COLUMNS = [field.metadata.get("column", field.name) for field in _FIELDS]
_PARSERS: dict[str, Callable[[str], Any]] = {
    "str": str,
    "int": int,
    "float": float,
    "bool": {"True": True, "False": False}.__getitem__,
}


def append_records(path: Path, records: Iterable[EpisodeRecord]) -> None:
    """Append rows; the first call writes the header."""
    new = not path.is_file()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        if new:
            writer.writerow(_COLUMNS)
        writer.writerows(dataclasses.astuple(record) for record in records)


def read_records(path: Path) -> list[EpisodeRecord]:
    """Read all rows; one cut off by a kill is left out, and of rows with the same key the first counts."""
    found: dict[EpisodeKey, EpisodeRecord] = {}
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        for row in csv.reader(file):
            if len(row) != len(_FIELDS) or row == _COLUMNS:
                continue
            try:
                values = [_PARSERS[str(field.type)](text) for field, text in zip(_FIELDS, row, strict=True)]
            except (ValueError, KeyError):
                continue
            record = EpisodeRecord(*values)
            found.setdefault(record.key, record)
    return list(found.values())
