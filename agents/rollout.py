"""Run one episode of one arm: a table of its steps, its summary, and pictures on request."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from rich.text import Text

from evergym.agents.arms import Arm, find_controller_arm, find_run_arm, make_policy
from evergym.agents.env_factory import make_env, resolve_env_id
from evergym.agents.episodes import EpisodeRecord, Step, run_episode
from evergym.agents.evaluation import derive_episode_seed
from evergym.agents.figures import make_sheet
from evergym.agents.run_folder import RunFolder
from evergym.agents.settings import parse_options
from evergym.errors import ConfigError, RunError

__all__ = ["Rollout", "resolve_episode"]

_COLUMNS = (  # (info key, heading, digits)
    ("time_s", "time [s]", 1),
    ("everted_length_mm", "everted [mm]", 1),
    ("catheter_length_mm", "catheter [mm]", 1),
    ("pressure_kpa", "pressure [kPa]", 1),
    ("tendon_pull_mm", "pull [mm]", 2),
    ("distance_to_go_mm", "to go [mm]", 1),
    ("tip_error_mm", "tip error [mm]", 1),
    ("wall_force_max_n", "wall force [N]", 3),
)


@dataclasses.dataclass(frozen=True)
class Rollout:
    """Run one episode and show it."""

    arm: str = "duty_cycle"
    """Controller (duty_cycle, push_only, random, or name=module:Class) or run folder of a learned policy."""
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
    rows: int = 25
    """Rows of the table of steps (0: no table)."""
    gif: Path | None = None
    """Write a film to this file."""
    png: Path | None = None
    """Write a sheet of 8 pictures to this file."""

    def run(self) -> int:
        """Run the episode and print it; returns the exit code."""
        for path in (self.gif, self.png):
            if path is not None and path.exists():
                raise RunError(f"'{path}' exists already and is not overwritten. Choose another file.")
        if self.index < 0 or self.rows < 0:
            raise ConfigError(f"index and rows must be 0 or above; got {self.index} and {self.rows}.")
        arm, name, options = resolve_episode(self.arm, self.env, self.env_options)
        pictures = self.gif is not None or self.png is not None
        env = make_env(name, {**options, "render_mode": "rgb_array"} if pictures else options)
        try:
            steps, frames, record = self._run(arm, env, pictures)
        finally:
            env.close()
        self._print(steps, record)
        if self.gif is not None:
            _write_gif(frames, self.gif, int(env.metadata.get("render_fps", 4)))
            print(f"Film: {self.gif}")
        if self.png is not None:
            _write_sheet(frames, self.png)
            print(f"Pictures: {self.png}")
        return 0

    def _run(
        self, arm: Arm, env: gymnasium.Env[Any, Any], pictures: bool
    ) -> tuple[list[Step], list[NDArray[np.uint8]], EpisodeRecord]:
        steps: list[Step] = []
        frames: list[NDArray[np.uint8]] = []

        def observe(step: Step) -> None:
            steps.append(step)
            if pictures:
                frame: Any = env.render()
                frames.append(frame)

        seed = derive_episode_seed(1_000_000, self.split, self.index) if self.seed is None else self.seed
        policy = make_policy(arm, env)
        record = run_episode(env, policy, arm=arm.name, split=self.split, index=self.index, seed=seed, observe=observe)
        return steps, frames, record

    def _print(self, steps: list[Step], record: EpisodeRecord) -> None:
        console = Console(width=150)
        if self.rows:
            console.print(_make_step_table(steps, self.rows))
        outcome = "reached the target" if record.success else f"did not reach the target ({record.end_reason or 'end'})"
        console.print(
            f"{record.arm} {outcome} on {record.split} {record.index}, seed {record.seed}: {record.time_s:.1f} s, "
            f"{record.step_count} steps, tip error {record.tip_error_mm:.1f} mm, path ratio {record.path_ratio:.2f}, "
            f"wall force peak {record.wall_force_peak_n:.3f} N (95 %: {record.wall_force_p95_n:.3f} N), "
            f"return {record.total_reward:.2f}, cost {record.cost:g}",
            highlight=False,
        )


def resolve_episode(word: str, env: str | None, env_options: tuple[str, ...] | None) -> tuple[Arm, str, dict[str, Any]]:
    """Return the arm, the environment's id and its arguments for one episode.

    Args:
        word: Controller or run folder, as in `Rollout`.
        env: Environment id; None: that of the run, else MammobotDuct-v0.
        env_options: Arguments as key=value; None: those of the run.

    Raises:
        ConfigError: no such controller or environment.
        RunError: no such run.
    """
    if Path(word).is_dir():
        arm = find_run_arm(Path(word))
        trained = RunFolder.open(Path(word)).settings
        env = env or trained.env
        env_options = trained.env_options if env_options is None else env_options
    elif "/" in word and ":" not in word:
        arm = find_run_arm(Path(word))  # says that the folder is missing
    else:
        arm = find_controller_arm(word)
    return arm, resolve_env_id(env or "MammobotDuct-v0"), parse_options(env_options or ())


def _make_step_table(steps: list[Step], rows: int) -> Table:
    table = Table(title=f"{min(rows, len(steps))} of {len(steps) - 1} steps")
    table.add_column("step", justify="right")
    columns = [column for column in _COLUMNS if column[0] in steps[0].info]
    for _, heading, _ in columns:
        table.add_column(Text(heading), justify="right")  # as a plain string rich would take [mm] for a style
    table.add_column("action")
    table.add_column("reward", justify="right")
    for number in sorted({round(value) for value in np.linspace(0, len(steps) - 1, rows)}):
        step = steps[number]
        action = "" if step.action is None else " ".join(f"{value:+.2f}" for value in np.ravel(step.action))
        values = [f"{_read(step.info, key):.{digits}f}" for key, _, digits in columns]
        table.add_row(str(step.number), *values, action, f"{step.reward:+.3f}")
    return table


def _read(info: Mapping[str, Any], key: str) -> float:
    return float(info.get(key, math.nan))


def _write_gif(frames: list[NDArray[np.uint8]], path: Path, fps: int) -> None:
    from PIL import Image

    stride = max(1, len(frames) // 200)  # a film of a long episode is a time lapse
    images = [Image.fromarray(frame) for frame in frames[::stride]]
    path.parent.mkdir(parents=True, exist_ok=True)
    images[0].save(path, format="GIF", save_all=True, append_images=images[1:], duration=1000 // max(fps, 10), loop=0)


def _write_sheet(frames: list[NDArray[np.uint8]], path: Path) -> None:
    from PIL import Image

    chosen = sorted({round(value) for value in np.linspace(0, len(frames) - 1, 8)})
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(make_sheet([frames[number] for number in chosen])).save(path, format="PNG")
