"""The bench's instruments: which channels are measured, how noisily, and the files that come out of it."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.random import Generator
from numpy.typing import NDArray

from evergym.discrepancy.blind.plan import PlannedRun
from evergym.discrepancy.data.columns import CHANNELS, COMMANDS, channel_index

__all__ = ["Bench", "draw_bench", "format_dataset", "measure_run", "write_dataset"]

Array = NDArray[np.float64]

WHITE, AUTOREGRESSIVE, OFFSET = 0.75, 0.55, 0.35
"""Shares of the noise: their squares add up to one within 2 %."""


@dataclass(frozen=True)
class Bench:
    """The instruments of a campaign.

    Attributes:
        sigma: One standard deviation of every measured channel, all kinds of noise together.
        memory: Correlation of the AR(1) noise from one row to the next.
        stride: A measurement in every so many rows.
        dropout: Share of the measurements that fail.
    """

    sigma: dict[str, float]
    memory: float
    stride: int
    dropout: float


def draw_bench(generator: Generator) -> Bench:
    """Draw the instruments: a camera, a length scale, and what else a lab may have."""
    tip = round(generator.uniform(0.2, 0.45), 2)
    angle = round(generator.uniform(0.5, 1.0), 2)
    chance = generator.uniform(size=5)
    sigma = {"tip_x_mm": tip, "tip_z_mm": tip, "everted_length_mm": round(generator.uniform(0.3, 0.6), 2)}
    if chance[0] < 0.85:
        sigma["tip_y_mm"] = tip
    if chance[1] < 0.7:
        sigma["tip_angle_deg"] = angle
    else:
        sigma["curvature_1_per_m"] = round(angle * math.pi / 180.0 / 0.095, 3)
    if chance[2] < 0.75:
        sigma["pressure_measured_kpa"] = round(generator.uniform(0.15, 0.4), 2)
    if chance[3] < 0.25:
        sigma["growth_speed_mm_s"] = round(generator.uniform(0.2, 0.4), 2)
    if chance[4] < 0.2:
        sigma["bending_angle_deg"] = round(generator.uniform(0.4, 0.8), 2)
    return Bench(
        sigma={name: sigma[name] for name in CHANNELS if name in sigma},
        memory=round(generator.uniform(0.4, 0.8), 2),
        stride=int(generator.choice([1, 1, 2])),
        dropout=round(generator.uniform(0.0, 0.04), 3),
    )


def measure_run(generator: Generator, bench: Bench, plan: PlannedRun, signal: Array) -> Array:
    """Return noisy measurements of a noise-free signal, NaN where nothing was measured, shape (k, 9)."""
    count = len(signal)
    measured = np.full_like(signal, np.nan)
    taken = np.arange(count) % bench.stride == 0
    for name, sigma in bench.sigma.items():
        index = channel_index(name)
        white = generator.normal(size=count)
        shock = generator.normal(size=count) * math.sqrt(1.0 - bench.memory**2)
        coloured = np.empty(count)
        coloured[0] = generator.normal()
        for i in range(1, count):
            coloured[i] = bench.memory * coloured[i - 1] + shock[i]
        noise = sigma * (WHITE * white + AUTOREGRESSIVE * coloured + OFFSET * generator.normal())
        failed = generator.uniform(size=count) < bench.dropout
        measured[:, index] = np.where(taken & ~failed, signal[:, index] + noise, np.nan)
    if plan.setup == "catheter":
        for name in ("everted_length_mm", "growth_speed_mm_s", "pressure_measured_kpa"):
            measured[:, channel_index(name)] = np.nan
    return measured


def format_dataset(
    name: str, plans: Sequence[PlannedRun], measured: Sequence[Array], bench: Bench, overrides: Mapping[str, float]
) -> dict[str, str]:
    """Return the texts of a dataset's files by their names."""
    content: dict[str, Any] = {
        "schema": 1,
        "name": name,
        "description": "bench campaign",
        "ignore": [],
        "noise": dict(bench.sigma),
    }
    if overrides:
        content["robot"] = dict(overrides)
    files: dict[str, str] = {}
    content["run"] = []
    for plan in plans:
        if plan.pegs:
            files[plan.peg_file] = plan.format_pegs()
        content["run"].append(
            {
                "id": plan.id,
                "setup": plan.setup,
                "gravity_mps2": list(plan.gravity),
                "experiment": plan.experiment,
                "environment": plan.environment,
                "initial_everted_length_mm": plan.initial_everted_length_mm,
            }
        )
    files["dataset.toml"] = tomli_w.dumps(content)
    files["samples.csv"] = _format_samples(plans, measured, bench)
    return files


def _format_samples(plans: Sequence[PlannedRun], measured: Sequence[Array], bench: Bench) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["run", "time_s", *COMMANDS, *bench.sigma])
    channels = [channel_index(name) for name in bench.sigma]
    for plan, values in zip(plans, measured, strict=True):
        last = np.full(len(COMMANDS), np.inf)
        for time, command, row in zip(plan.time_s, plan.commands, values[:, channels], strict=True):
            # A command is logged when it changes; the two feeds together, since a tail without a command is coupled.
            changed = command != last
            changed[:2] |= changed[:2].any()
            sent = [repr(float(value)) if new else "" for value, new in zip(command, changed, strict=True)]
            read = ["" if math.isnan(value) else f"{value:.4f}" for value in row]
            writer.writerow([plan.id, f"{time:g}", *sent, *read])
            last = command
    return text.getvalue()


def write_dataset(folder: Path, files: Mapping[str, str]) -> None:
    """Write a dataset's files into a new folder."""
    folder.mkdir(parents=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
