"""``evergym tune``: find the duty cycle's parameters by a seeded random search on training anatomies."""

from __future__ import annotations

import dataclasses
import enum
import math
import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

import evergym
from evergym.agents.duty_cycle import DutyCycleController, DutyCycleSettings
from evergym.agents.env_factory import make_env
from evergym.agents.episodes import EpisodeRecord, run_episode
from evergym.agents.evaluation import derive_episode_seed
from evergym.agents.progress import ProgressReport
from evergym.agents.statistics import compute_wilson
from evergym.config import build, dump_toml, to_mapping
from evergym.errors import ConfigError

__all__ = ["RANGES", "Trial", "Tune", "TuneTask", "compute_score", "propose"]

FAMILY = "train"
"""The only family that tuning may see."""
FINALISTS = 4
"""Candidates that are tried again on anatomies that did not choose them, the defaults among them."""
TIME_WEIGHT = FORCE_WEIGHT = 0.1
"""What the whole time limit, or a wall force at its limit throughout, costs in success rate. A choice: both only decide
between candidates that succeed about as often."""

RANGES: dict[str, tuple[float, float]] = {
    "insertion_mm_s": (1.0, 2.9),
    "look_ahead_mm": (5.0, 16.0),
    "lever_mm": (10.0, 60.0),
    "reaction_s": (0.2, 2.0),
    "astray_mm": (1.5, 8.0),
    "back_out_mm": (2.0, 12.0),
}
"""Where each parameter is looked for. Step and pressures stay as the robot was driven, the force limit as it is safe: a
longer step would be faster only by arriving with the catheter instead of the sheath."""


class TuneTask(enum.StrEnum):
    """The tasks that have tuned parameters."""

    DUCT = "duct"
    PEGS = "pegs"


ENV_IDS = {TuneTask.DUCT: "MammobotDuct-v0", TuneTask.PEGS: "MammobotPegs-v0"}


class Trial(NamedTuple):
    """A candidate and how it did."""

    name: str
    settings: DutyCycleSettings
    episode_count: int
    success_count: int
    time_s: float
    """Mean robot time of all episodes."""
    wall_force_p95_n: float
    """Mean of the episodes' 95th percentiles."""
    score: float


@dataclasses.dataclass(frozen=True)
class Tune:
    """Tune the duty cycle's parameters on training anatomies and write them to a file.

    A random search, its second half around the best found so far. The robot's parameters are drawn from their
    uncertainty, so that nothing is tuned to one exact robot. The best candidates and the
    defaults are tried again on training anatomies that did not choose them; the best of those is written.
    """

    task: TuneTask = TuneTask.DUCT
    """Ducts or pegs."""
    candidates: int = 40
    """Parameter sets to try, the defaults included."""
    episodes: int = 24
    """Training anatomies for each."""
    seed: int = 0
    """Seed of the candidates, targets, noise and robots."""
    model_randomisation: float = 1.0
    """Share of the robot's uncertainty that is drawn at each episode."""
    localisation_noise_mm: float = 0.0
    """Noise of the tip's position."""
    file: Path | None = None
    """Where to write (None: the file that the controller reads, which is replaced)."""

    def run(self) -> int:
        """Search, print the table and write the file; returns the exit code."""
        for name, least in (("candidates", 1), ("episodes", 1)):
            if getattr(self, name) < least:
                raise ConfigError(f"Tuning needs {name} of at least {least}; got {name} = {getattr(self, name)}.")
        file = self.file or Path(__file__).parent / "tuned" / f"duty_cycle_{self.task}.toml"
        if not file.parent.is_dir():
            raise ConfigError(f"Folder '{file.parent}' does not exist. Create it, or choose another file.")
        trials, finals = self._search()
        _print_table(f"{self.task}: {len(trials)} candidates on {self.episodes} training anatomies", trials[:8])
        _print_table(f"The best of them and the defaults on {self.episodes} others", finals)
        file.write_text(self._describe(finals) + dump_toml(finals[0].settings), encoding="utf-8")
        print(f"Written: {file}")
        return 0

    def _search(self) -> tuple[list[Trial], list[Trial]]:
        """Return all trials and those of the finalists on other anatomies, both from the best on."""
        env = make_env(
            ENV_IDS[self.task],
            {"model_randomisation": self.model_randomisation, "localisation_noise_mm": self.localisation_noise_mm},
        )
        generator = np.random.default_rng(self.seed)
        trials: list[Trial] = []
        finals: list[Trial] = []
        first, others = range(self.episodes), range(self.episodes, 2 * self.episodes)
        total = (self.candidates + min(FINALISTS, self.candidates)) * self.episodes
        with ProgressReport(f"Tuning {self.task}", total, unit="episodes") as progress:
            for number in range(self.candidates):
                settings = propose(trials, number, self.candidates, generator)
                trials.append(self._try(env, f"{number}" if number else "defaults", settings, first))
                progress.update((number + 1) * self.episodes, f"best score {max(t.score for t in trials):.3f}")
            defaults = trials[0]
            trials.sort(key=lambda trial: -trial.score)
            chosen = [trial for trial in trials if trial is not defaults][: FINALISTS - 1]
            for trial in [*chosen, defaults]:
                finals.append(self._try(env, trial.name, trial.settings, others))
                progress.update((self.candidates + len(finals)) * self.episodes)
        env.close()
        finals.sort(key=lambda trial: -trial.score)
        return trials, finals

    def _try(self, env: gymnasium.Env[Any, Any], name: str, settings: DutyCycleSettings, indices: range) -> Trial:
        """Run one candidate on some training anatomies, with the same targets, noise and robots for all candidates."""
        controller = DutyCycleController(env, settings)
        records = [
            run_episode(
                env,
                controller,
                arm=name,
                split=FAMILY,
                index=index,
                seed=derive_episode_seed(self.seed, FAMILY, index),
            )
            for index in indices
        ]
        return _summarise(name, settings, records, env.unwrapped.settings)  # type: ignore[attr-defined]

    def _describe(self, finals: Sequence[Trial]) -> str:
        """Return the comment at the head of the file: how it was made, and how good it is."""
        best = finals[0]
        defaults = next(trial for trial in finals if trial.name == "defaults")
        options = " ".join(
            f"--{field.name.replace('_', '-')} {getattr(self, field.name)}"
            for field in dataclasses.fields(self)
            if field.name != "file"
        )
        return (
            f"# Made by: evergym tune {options}\n"
            f"# with evergym {evergym.__version__}, on family '{FAMILY}' only. On {best.episode_count} anatomies of it "
            "that did not choose it:\n"
            f"# candidate {best.name}: {_describe_trial(best)}\n"
            f"# the defaults: {_describe_trial(defaults)}\n"
        )


def propose(trials: Sequence[Trial], number: int, total: int, generator: np.random.Generator) -> DutyCycleSettings:
    """Return the next candidate.

    Args:
        trials: Those so far.
        number: Number of the candidate; 0: the defaults.
        total: Number of candidates of the search. The first half is drawn from all of ``RANGES``, the second half
            around the best trial, ever closer.
        generator: Source of randomness.
    """
    if number == 0:
        return DutyCycleSettings()
    share = number / total
    best = max(trials, key=lambda trial: trial.score).settings
    values = to_mapping(best)
    for key, (low, high) in RANGES.items():
        width = math.log(high / low)
        if share < 0.5:
            value = low * math.exp(width * generator.random())
        else:
            value = values[key] * math.exp(0.3 * (1.0 - share) * width * generator.standard_normal())
        values[key] = float(f"{min(max(value, low), high):.2g}")  # a third digit would be noise
    return build(DutyCycleSettings, values, f"candidate {number}")


def compute_score(success_rate: float, time_share: float, force_share: float) -> float:
    """Return the score: the success rate, less a little for time and wall force (both as shares of their limits)."""
    return success_rate - TIME_WEIGHT * time_share - FORCE_WEIGHT * min(force_share, 1.0)


def _summarise(name: str, settings: DutyCycleSettings, records: Sequence[EpisodeRecord], limits: Any) -> Trial:
    success_count = sum(record.success for record in records)
    time = statistics.fmean(record.time_s for record in records)
    force = statistics.fmean(record.wall_force_p95_n for record in records)
    score = compute_score(success_count / len(records), time / limits.time_limit_s, force / limits.wall_force_limit_n)
    return Trial(name, settings, len(records), success_count, time, force, score)


def _describe_trial(trial: Trial) -> str:
    interval = compute_wilson(trial.success_count, trial.episode_count)
    return (
        f"{trial.success_count} reached ({100 * interval.low:.0f}-{100 * interval.high:.0f} %), {trial.time_s:.1f} s, "
        f"{trial.wall_force_p95_n:.3f} N, score {trial.score:.4f}"
    )


def _rows(trials: Sequence[Trial]) -> Iterator[list[str]]:
    for trial in trials:
        numbers = [f"{getattr(trial.settings, key):g}" for key in RANGES]
        yield [
            trial.name,
            f"{trial.success_count}/{trial.episode_count}",
            f"{trial.time_s:.1f}",
            f"{trial.wall_force_p95_n:.3f}",
            f"{trial.score:.4f}",
            *numbers,
        ]


def _print_table(title: str, trials: Sequence[Trial]) -> None:
    table = Table(title=title)
    for column in ("candidate", "reached", "time [s]", "wall force [N]", "score", *RANGES):
        table.add_column(Text(column))  # as a plain string rich would take [s] for a style
    for row in _rows(trials):
        table.add_row(*row)
    Console(width=150).print(table)
