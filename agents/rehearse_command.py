"""The command ``evergym rehearse``: plan in models, carry the plans out on a robot that is not watched."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import tyro

from evergym.errors import ConfigError

__all__ = ["Rehearse"]


@dataclasses.dataclass(frozen=True)
class Rehearse:
    """Plan in several models, carry the plans out on a robot that is not watched, and compare how well it gets there.

    Every plan is a controller's episode in the model's environment; on the robot the drives repeat it without looking.
    """

    models: tyro.conf.Positional[tuple[str, ...]]
    """Model files to plan with, or names of shipped ones; the last is compared with the first."""
    robot: str
    """Model file that stands for the robot."""
    env: str = "MammobotDuct-v0"
    """Environment id."""
    env_options: tuple[str, ...] = ()
    """Further arguments of the environment as key=value."""
    controller: str = "duty_cycle"
    """What drives in the rehearsals."""
    split: str = "held_out"
    """Family of anatomies."""
    episodes: int = 40
    """Anatomies."""
    seed: int = 1_000_000
    """Seed of targets and noise."""

    def run(self) -> int:
        """Rehearse, carry out and print the comparison; returns the exit code.

        Raises:
            ConfigError: an unknown environment, controller or model.
        """
        if self.episodes < 1 or not self.models:
            raise ConfigError(f"A comparison needs models and at least 1 episode; got episodes = {self.episodes}.")
        from evergym.agents.progress import ProgressReport
        from evergym.agents.rehearsal import compare_models, describe_trials
        from evergym.agents.settings import parse_options

        total = self.episodes * len(self.models)
        with ProgressReport("Rehearsals", total, unit="episodes") as progress:
            trials = compare_models(
                self.env,
                self.robot,
                self.models,
                episodes=self.episodes,
                controller=self.controller,
                split=self.split,
                seed=self.seed,
                options=parse_options(self.env_options),
                on_episode=lambda done: progress.update(done, ""),
            )
        print(describe_trials(trials, [_shorten(model) for model in self.models]))
        return 0


def _shorten(model: str) -> str:
    """Return a model file by its folder and name: several may be called model.toml."""
    path = Path(model)
    return "/".join(path.parts[-2:]) if path.suffix else model
