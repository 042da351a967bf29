"""Contact force along the robot over an episode, as a picture of place and time."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from evergym.agents.arms import make_policy
from evergym.agents.env_factory import make_env
from evergym.agents.episodes import EpisodeRecord, Step, run_episode
from evergym.agents.evaluation import derive_episode_seed
from evergym.agents.plotting.style import COLOURS, FULL_WIDTH_MM, write_figure
from evergym.agents.rollout import resolve_episode
from evergym.envs.base import MammobotEnv
from evergym.envs.rendering.pose import Pose, read_pose
from evergym.errors import RunError
from evergym.simulator import Simulator
from evergym.units import MM

__all__ = ["ForceEpisode", "draw_force", "locate_contacts", "measure_force"]

Array = NDArray[np.float64]


class ForceEpisode(NamedTuple):
    """Contact forces of an episode; SI units."""

    record: EpisodeRecord
    anatomy: str
    time: Array
    """Of the reset and every step, shape (n,)."""
    force: Array
    """Contact force on each section from the port on, shape (n, k) [N]."""
    section_length: float
    everted_length: Array
    catheter_length: Array
    section_max: Array
    """Largest force on one section, shape (n,) [N]."""
    limit: float
    """Force of a section above which a step costs [N]."""


def measure_force(
    arm: str, env: str | None, env_options: tuple[str, ...] | None, split: str, index: int, seed: int | None
) -> ForceEpisode:
    """Run an episode and keep where the robot touches; arguments as for ``evergym rollout``.

    Raises:
        RunError: the environment is not one of this package.
    """
    policy_arm, name, options = resolve_episode(arm, env, env_options)
    environment = make_env(name, options)
    base = environment.unwrapped
    if not isinstance(base, MammobotEnv):
        raise RunError(f"{type(base).__name__} has no simulator of this package, so there are no contacts to show.")
    located: list[tuple[Array, Array]] = []
    infos: list[dict[str, Any]] = []
    sections: list[float] = []

    def observe(step: Step) -> None:
        simulator = base._simulator
        assert isinstance(simulator, Simulator)  # reset() made it
        located.append(locate_contacts(read_pose(simulator)))
        sections.append(simulator.numerics.section_length_mm * MM)
        infos.append(dict(step.info))

    seed = derive_episode_seed(1_000_000, split, index) if seed is None else seed
    try:
        policy = make_policy(policy_arm, environment)
        record = run_episode(
            environment, policy, arm=policy_arm.name, split=split, index=index, seed=seed, observe=observe
        )
    finally:
        environment.close()
    time, everted, inserted, section_max = (
        np.array([float(info[key]) for info in infos])
        for key in ("time_s", "everted_length_mm", "catheter_length_mm", "wall_force_max_n")
    )
    reach = max(everted.max(), inserted.max()) * MM
    section = sections[0]
    edges = section * (np.arange(np.ceil(reach / section) + 2) - 0.5)  # a section's middle is its node
    force = np.array([np.histogram(station, edges, weights=size)[0] for station, size in located])
    limit = base.settings.wall_force_limit_n
    anatomy = str(infos[0].get("anatomy", ""))
    return ForceEpisode(record, anatomy, time, force, section, everted * MM, inserted * MM, section_max, limit)


def locate_contacts(pose: Pose) -> tuple[Array, Array]:
    """Return how far along the robot from the port its contacts are [m], and their forces [N]."""
    contacts, shape = pose.contacts, pose.shape
    gap = np.linalg.norm(contacts.position[:, None] - shape.position[None], axis=2)
    nodes = np.argmin(gap, axis=1) if len(gap) else np.zeros(0, dtype=np.int64)
    return shape.station[nodes], np.linalg.norm(contacts.force, axis=1)


def draw_force(episode: ForceEpisode, path: Path) -> Path:
    """Draw force over place and time, and the largest force on one section below it; returns the file."""

    def draw(figure: Figure, axes: list[Axes]) -> None:
        place, largest = axes
        _draw_places(figure, place, episode)
        largest.plot(episode.time, episode.section_max, color="black", linewidth=0.9)
        if episode.section_max.max() > 0.5 * episode.limit:
            largest.axhline(episode.limit, color=COLOURS[1], linestyle=(0, (3, 1.5)), linewidth=0.8, label="limit")
            largest.legend(loc="upper left")
        largest.set(xlabel="time [s]", ylabel="force [N]", title="Largest force on one section")
        largest.set_xlim(0.0, float(episode.time[-1]))
        largest.set_ylim(0.0, max(1.1 * float(episode.section_max.max()), 0.01))
        largest.grid(visible=True)

    return write_figure(path, FULL_WIDTH_MM, 105.0, 1, 2, draw)


def _draw_places(figure: Figure, axes: Axes, episode: ForceEpisode) -> None:
    count = episode.force.shape[1]
    # A step's contacts are those at its end; they fill the time since the step before.
    shown = np.ma.masked_less_equal(episode.force[1:].T, 0.0)
    top = float(episode.force.max())
    norm = PowerNorm(0.5, vmin=0.0, vmax=top if top > 0.0 else 0.1)  # light touches show beside hard ones
    edges = episode.section_length * (np.arange(count + 1) - 0.5) / MM
    mesh = axes.pcolormesh(episode.time, edges, shown, cmap="inferno_r", norm=norm, rasterized=True)
    bar = figure.colorbar(mesh, ax=axes, pad=0.01, aspect=14)
    bar.set_label("force on a section [N]\n(square root scale)")
    bar.locator = MaxNLocator(4)
    bar.update_ticks()
    bar.outline.set_linewidth(0.4)
    axes.plot(episode.time, episode.everted_length / MM, color=COLOURS[0], label="everted length")
    axes.plot(
        episode.time, episode.catheter_length / MM, color="black", linewidth=0.8, linestyle=(0, (3, 1.5)),
        label="catheter",
    )  # fmt: skip
    record = episode.record
    outcome = "reached" if record.success else f"not reached ({record.end_reason})"
    axes.set(
        ylabel="distance from the port\nalong the robot [mm]",
        title=f"Contact force, {record.arm.replace('_', ' ')} in {episode.anatomy}: target {outcome}",
        xlim=(0.0, float(episode.time[-1])),
        ylim=(0.0, edges[-1]),
    )
    axes.legend(loc="upper left")
    if top <= 0.0:
        axes.text(0.5, 0.5, "no contact in this episode", transform=axes.transAxes, ha="center", va="center")
