"""The commands ``evergym plot ...``: light to load, the work is imported when it runs."""

from __future__ import annotations

import dataclasses
import sys
from abc import ABC, abstractmethod
from pathlib import Path

import tyro

from evergym.agents.plotting.target import check_target
from evergym.errors import ConfigError, EvergymError

__all__ = ["PlotCompare", "PlotForce", "PlotGrowth", "PlotLearning", "PlotWorkspace"]


class _Plot(ABC):
    """A command that draws one figure."""

    @abstractmethod
    def draw(self) -> Path:
        """Draw the figure; returns the file."""

    def run(self) -> int:
        """Draw and name the file; returns 0, or 2 if it cannot be drawn as asked."""
        try:
            print(f"Figure: {self.draw()}")
        except EvergymError as error:
            print(f"evergym plot: {error}", file=sys.stderr)
            return 2
        return 0


@dataclasses.dataclass(frozen=True)
class PlotWorkspace(_Plot):
    """Draw where the tip gets to in free space, over tendon pull and pressure."""

    out: Path = Path("workspace.png")
    """The figure: .png, .pdf or .svg."""
    model: str = "mammobot_2023"
    """Name of a shipped model or path of a model file."""
    everted_lengths_mm: tuple[float, ...] = (20.0, 40.0, 60.0, 80.0)
    """Everted lengths, with the catheter up to the sheath's tip; the angle is drawn for the longest."""
    pressures_kpa: tuple[float, ...] = (10.0, 20.0, 30.0, 40.0, 50.0)
    """Gauge pressures, one curve each and for every length."""
    pulls: int = 21
    """Tendon pulls per curve, from none to the largest."""

    def draw(self) -> Path:
        """Simulate and draw; returns the file."""
        check_target(self.out)
        if self.pulls < 2:
            raise ConfigError(f"pulls is {self.pulls}; a curve needs at least 2.")
        if not self.everted_lengths_mm:
            raise ConfigError("There is nothing to draw: give --everted-lengths-mm, such as 20 40 60.")
        from evergym.agents.plotting.workspace import draw_workspace, measure_workspace

        lengths, pressures = tuple(sorted(set(self.everted_lengths_mm))), check_pressures(self.pressures_kpa)
        curves = measure_workspace(self.model, lengths, pressures, self.pulls)
        return draw_workspace(curves, self.out)


@dataclasses.dataclass(frozen=True)
class PlotGrowth(_Plot):
    """Draw everted length and growth rate over time in free space, at several pressures."""

    out: Path = Path("growth.png")
    """The figure: .png, .pdf or .svg."""
    model: str = "mammobot_2023"
    """Name of a shipped model or path of a model file."""
    pressures_kpa: tuple[float, ...] = (15.0, 18.0, 20.0, 25.0, 30.0, 50.0)
    """Gauge pressures, one curve each; reached before the feed starts."""
    insertion_mm_s: float = 2.0
    """Speed of the catheter; the tail is fed twice as fast."""
    duration_s: float = 30.0
    """Time from the start of the feed."""

    def draw(self) -> Path:
        """Simulate and draw; returns the file."""
        check_target(self.out)
        if not 0.0 < self.duration_s <= 600.0:
            raise ConfigError(f"duration_s is {self.duration_s} s; it must be above 0 and at most 600 s.")
        if not 0.0 < self.insertion_mm_s <= 100.0:
            raise ConfigError(f"insertion_mm_s is {self.insertion_mm_s} mm/s; it must be above 0 and at most 100 mm/s.")
        from evergym.agents.plotting.growth import draw_growth, measure_growth

        pressures = check_pressures(self.pressures_kpa)
        curves = measure_growth(self.model, pressures, self.insertion_mm_s, self.duration_s)
        return draw_growth(curves, self.out)


@dataclasses.dataclass(frozen=True)
class PlotForce(_Plot):
    """Run one episode and draw the contact force along the robot over time."""

    arm: tyro.conf.Positional[str] = "duty_cycle"
    """Controller (duty_cycle, push_only, random, or name=module:Class) or run folder of a learned policy."""
    out: Path = Path("force.png")
    """The figure: .png, .pdf or .svg."""
    env: str | None = None
    """Environment id (None: that of the run, else MammobotDuct-v0)."""
    env_options: tuple[str, ...] | None = None
    """Arguments of the environment as key=value (None: those of the run)."""
    split: str = "held_out"
    """Family of anatomies; "default" leaves the choice to the environment and its seed."""
    index: int = 0
    """Number of the anatomy in the family."""
    seed: int | None = None
    """Seed of target and noise (None: the one that `evergym evaluate` uses for this anatomy)."""

    def draw(self) -> Path:
        """Run the episode and draw; returns the file."""
        check_target(self.out)
        from evergym.agents.plotting.force import draw_force, measure_force

        episode = measure_force(self.arm, self.env, self.env_options, self.split, self.index, self.seed)
        return draw_force(episode, self.out)


@dataclasses.dataclass(frozen=True)
class PlotLearning(_Plot):
    """Draw the learning curves of runs; runs that differ only in their seed are drawn as one curve with its range."""

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Run folders."""
    out: Path = Path("learning.png")
    """The figure: .png, .pdf or .svg."""

    def draw(self) -> Path:
        """Read and draw; returns the file."""
        check_target(self.out)
        if not self.runs:
            raise ConfigError("There is nothing to draw: give run folders, such as runs/mine.")
        from evergym.agents.plotting.learning import draw_learning, read_learning

        return draw_learning(read_learning(self.runs), self.out)


@dataclasses.dataclass(frozen=True)
class PlotCompare(_Plot):
    """Draw an evaluation: targets reached, time to target and wall force of every arm on every split."""

    folder: tyro.conf.Positional[Path]
    """Evaluation folder."""
    out: Path = Path("compare.png")
    """The figure: .png, .pdf or .svg."""

    def draw(self) -> Path:
        """Read and draw; returns the file."""
        check_target(self.out)
        from evergym.agents.plotting.comparison import draw_comparison

        return draw_comparison(self.folder, self.out)


def check_pressures(pressures_kpa: tuple[float, ...]) -> tuple[float, ...]:
    """Return the pressures in rising order.

    Raises:
        ConfigError: there is none, one is given twice, or one is impossible.
    """
    if not pressures_kpa:
        raise ConfigError("There is nothing to draw: give --pressures-kpa, such as 10 30 50.")
    for pressure in pressures_kpa:
        if not 0.0 <= pressure <= 1000.0:
            raise ConfigError(f"A pressure is {pressure} kPa; it must be between 0 and 1000 kPa.")
    if len(set(pressures_kpa)) < len(pressures_kpa):
        raise ConfigError(f"A pressure is given twice: {', '.join(f'{p:g}' for p in pressures_kpa)} kPa.")
    return tuple(sorted(pressures_kpa))
