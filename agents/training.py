"""Training with Stable-Baselines3 such that a run killed at any time continues to the same weights, bit for bit.

A run is a sequence of *segments*, and a checkpoint lies between two of them. How a segment goes depends on nothing but
the checkpoint before it:

- policy, critic, optimiser, counters and (SAC, TQC) the replay buffer are in the checkpoint, as are the statistics
  that normalise observations and rewards;
- every random generator (Python, numpy, torch, the action space, each environment) is seeded at the start of the
  segment from the run's seed and the segment's number, so no generator state needs to be kept;
- every environment is reset at the start of the segment, in the uninterrupted run as well, so no environment state
  needs to be kept. Episodes under way are cut there as by a time limit: PPO bootstraps their value, replayed
  transitions are not marked as final. One segment should therefore hold several episodes of each environment;
- a segment ends between two updates, at the first one at which `checkpoint_interval` steps have been taken;
- schedules depend on the global step and on `total_steps`.

What a killed run did after its last checkpoint is trained again. The promise holds on the CPU, on the same machine
(another processor may round differently), with the same versions and the same code of evergym; resuming tells what
has changed. Raising `total_steps` of a finished run continues it, but its last segment was cut at the old end, so it
is not the run that would have had the higher number from the start.
"""

from __future__ import annotations

import dataclasses
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from sb3_contrib import TQC
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.utils import LinearSchedule, set_random_seed
from stable_baselines3.common.vec_env import VecEnv, VecNormalize
from stable_baselines3.her.her_replay_buffer import HerReplayBuffer

from evergym.agents.env_factory import make_env_batch, resolve_env_id
from evergym.agents.learning_curve import CurveWriter
from evergym.agents.progress import ProgressReport, format_duration
from evergym.agents.run_folder import Checkpoint, Progress, RunFolder, find_changed_versions
from evergym.agents.settings import Algorithm, LearningRateSchedule, TrainSettings, parse_options, write_settings
from evergym.errors import ConfigError, RunError

__all__ = ["ALGORITHMS", "derive_seed", "train"]

ALGORITHMS: dict[Algorithm, type[PPO | SAC | TQC]] = {Algorithm.PPO: PPO, Algorithm.SAC: SAC, Algorithm.TQC: TQC}
"""The class of each algorithm."""

_PROGRESS_INTERVAL = 0.5  # [s] between updates of the progress display


def derive_seed(seed: int, segment: int) -> int:
    """Seed of a segment: below 2**31, as environment i gets this plus i and torch and numpy need 32 bits."""
    return int(np.random.SeedSequence(seed, spawn_key=(segment,)).generate_state(1)[0] >> 1)


def train(settings: TrainSettings) -> RunFolder:
    """Train a new run, or continue one if ``settings.resume`` names it.

    Returns:
        The run folder, whose latest checkpoint is the result.

    Raises:
        RunError: The folder exists already, or the one to resume does not, or its checkpoint is of another environment.
        ConfigError: An impossible setting or an unknown environment.
    """
    torch.set_num_threads(1)  # small networks are faster on one thread, and their sums have one order
    if settings.resume is not None:
        folder = RunFolder.open(settings.resume)
        settings = _merge_settings(settings, folder)
        checkpoint: Checkpoint | None = folder.latest()
    else:
        resolve_env_id(settings.env)  # before a folder is made for nothing
        path = settings.folder or _name_folder(settings)
        settings = dataclasses.replace(settings, folder=path)
        checkpoint = None
        if path.exists():
            folder = RunFolder.create(path, settings)  # says why not
    environments: VecEnv | None = None
    try:
        environments = make_env_batch(settings.env, parse_options(settings.env_options), settings.env_count)
        model = _make_model(settings, environments) if checkpoint is None else _load(settings, environments, checkpoint)
        if checkpoint is None:
            folder = RunFolder.create(path, settings)
        _learn(settings, folder, model, checkpoint)
    except (EOFError, ConnectionError) as error:
        raise RunError(
            "A process with an environment ended unexpectedly; its own message is above. "
            f"Continue with: evergym train --resume {settings.folder}"
        ) from error
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"Continue with: evergym train --resume {settings.folder}") from None
    finally:
        if environments is not None:
            _close(environments)
    return folder


def _name_folder(settings: TrainSettings) -> Path:
    name = settings.env.rpartition(":")[2]
    return Path("runs") / f"{name}-{settings.algorithm.value}-seed{settings.seed}"


def _merge_settings(given: TrainSettings, folder: RunFolder) -> TrainSettings:
    """The stored settings with what may be given anew; anything else that was given must agree with them."""
    stored, default = folder.settings, TrainSettings()
    changes: dict[str, Any] = {}
    for field in dataclasses.fields(TrainSettings):
        name = field.name
        value = getattr(given, name)
        if name in ("resume", "folder") or value in (getattr(default, name), getattr(stored, name)):
            continue
        if name not in ("total_steps", "time_budget_min"):
            raise ConfigError(
                f"Run '{folder.path}' was started with {name} = {getattr(stored, name)!r}, not {value!r}. A resumed "
                "run keeps its settings: leave the option out, or start a new run with --folder."
            )
        changes[name] = value
    merged = dataclasses.replace(stored, folder=folder.path, **changes)
    progress = folder.latest().progress
    if progress.step >= merged.total_steps:
        raise RunError(
            f"Run '{folder.path}' is finished: {progress.step:,} of {merged.total_steps:,} steps. To train it further, "
            "give a larger --total-steps."
        )
    if merged.time_budget_min is not None and progress.seconds >= 60.0 * merged.time_budget_min:
        raise RunError(
            f"Run '{folder.path}' has used its time budget: {progress.seconds / 60:.1f} of {merged.time_budget_min:g} "
            "min. To train it further, give a larger --time-budget-min."
        )
    changed = find_changed_versions(folder)
    if changed:
        print(
            f"Note: the continued run is not exactly the same, as this changed: {', '.join(changed)}.",
            file=sys.stderr,
        )
    if changes:
        write_settings(merged, folder.path / "settings.toml")
    return merged


def _normalise(settings: TrainSettings, environments: VecEnv, checkpoint: Checkpoint | None) -> VecEnv:
    on_policy = settings.algorithm is Algorithm.PPO
    observations = on_policy if settings.normalise_observations is None else settings.normalise_observations
    rewards = on_policy if settings.normalise_rewards is None else settings.normalise_rewards
    if not (observations or rewards):
        return environments
    if checkpoint is None:
        return VecNormalize(environments, norm_obs=observations, norm_reward=rewards, gamma=settings.discount)
    return VecNormalize.load(str(checkpoint.normaliser), environments)


def _make_model(settings: TrainSettings, environments: VecEnv) -> BaseAlgorithm:
    if settings.algorithm is not Algorithm.PPO and not isinstance(environments.action_space, spaces.Box):
        raise ConfigError(
            f"{settings.algorithm.name} needs continuous actions; '{settings.env}' has other ones. Use ppo."
        )
    if settings.algorithm is Algorithm.PPO:
        ppo = settings.ppo
        arguments: dict[str, Any] = {
            "n_steps": ppo.rollout_steps,
            "batch_size": min(ppo.batch_size, ppo.rollout_steps * settings.env_count),
            "n_epochs": ppo.epochs,
            "clip_range": ppo.clip_range,
            "gae_lambda": ppo.gae_lambda,
            "ent_coef": ppo.entropy_coefficient,
            "vf_coef": ppo.value_coefficient,
            "max_grad_norm": ppo.gradient_limit,
            "policy_kwargs": {"net_arch": list(settings.hidden), "log_std_init": ppo.log_std_initial},
        }
    else:
        replay = settings.off_policy
        arguments = {
            "buffer_size": replay.buffer_size,
            "learning_starts": replay.learning_starts,
            "batch_size": replay.batch_size,
            "tau": replay.tau,
            "train_freq": replay.train_interval,
            "gradient_steps": replay.gradient_steps,
            "policy_kwargs": {"net_arch": list(settings.hidden)},
        }
        if settings.algorithm is Algorithm.TQC:
            arguments["top_quantiles_to_drop_per_net"] = replay.dropped_quantiles
        if replay.hindsight:
            space = environments.observation_space
            if not isinstance(space, spaces.Dict) or "desired_goal" not in space.spaces:
                raise ConfigError(
                    f"off_policy.hindsight needs a goal environment; '{settings.env}' has no desired_goal."
                )
            arguments["replay_buffer_class"] = HerReplayBuffer
    rate: Any = settings.learning_rate
    if settings.learning_rate_schedule is LearningRateSchedule.LINEAR:
        rate = LinearSchedule(settings.learning_rate, 0.0, 1.0)
    dictionary = isinstance(environments.observation_space, spaces.Dict)
    return ALGORITHMS[settings.algorithm](
        policy="MultiInputPolicy" if dictionary else "MlpPolicy",
        env=_normalise(settings, environments, None),
        learning_rate=rate,
        gamma=settings.discount,
        seed=settings.seed,
        device=settings.device,
        **arguments,
    )


def _load(settings: TrainSettings, environments: VecEnv, checkpoint: Checkpoint) -> BaseAlgorithm:
    stored = checkpoint.progress.environment
    if stored != settings.env:
        raise RunError(
            f"Checkpoint '{checkpoint.path}' is of environment '{stored}', the settings of '{settings.env}'."
        )
    try:
        env = _normalise(settings, environments, checkpoint)
        model = ALGORITHMS[settings.algorithm].load(checkpoint.model, env=env, device=settings.device)
        if isinstance(model, OffPolicyAlgorithm):
            model.load_replay_buffer(checkpoint.replay, truncate_last_traj=False)
    except (ValueError, AssertionError, OSError, EOFError) as error:
        raise RunError(
            f"Checkpoint '{checkpoint.path}' does not fit environment '{stored}' or is damaged: {error}"
        ) from error
    return model


def _start_segment(model: BaseAlgorithm, seed: int) -> None:
    """Seed every generator and reset every environment: the segment depends on nothing before but the checkpoint."""
    environments = model.env
    assert environments is not None
    environments.seed(seed)
    observation = environments.reset()
    if isinstance(model, OffPolicyAlgorithm) and isinstance(model.replay_buffer, HerReplayBuffer):
        model.replay_buffer.truncate_last_trajectory()
    # SB3 has no public way to reset within learn(); these are the three attributes its own _setup_learn() sets.
    model._last_obs = observation  # type: ignore[assignment]
    model._last_episode_starts = np.ones((environments.num_envs,), dtype=bool)
    if model._vec_normalize_env is not None:
        model._last_original_obs = model._vec_normalize_env.get_original_obs()
    model.action_space.seed(seed)
    set_random_seed(seed)


class _BudgetUsed(Exception):
    """Ends learn() right after a checkpoint."""


class _SegmentCallback(BaseCallback):
    """Cuts the training into segments, writes checkpoints and the learning curve, and shows the progress."""

    def __init__(self, settings: TrainSettings, folder: RunFolder, start: Progress, report: ProgressReport):
        super().__init__()
        self._settings, self._folder, self._report = settings, folder, report
        self._segment, self._segment_step, self._seconds_before = start.segment, start.step, start.seconds
        self._begin = self._shown = time.monotonic()
        self._curve = CurveWriter(folder.curve, start.step)
        self._note = ""

    @property
    def seconds(self) -> float:
        """Wall time of training over all parts [s]."""
        return self._seconds_before + time.monotonic() - self._begin

    def _on_rollout_start(self) -> None:
        # SB3 calls this between two updates, before the first step of a rollout: the one place where a segment can end.
        if self.num_timesteps - self._segment_step >= self._settings.checkpoint_interval:
            self.save()
            budget = self._settings.time_budget_min
            if budget is not None and self.seconds >= 60.0 * budget:
                raise _BudgetUsed
            _start_segment(self.model, derive_seed(self._settings.seed, self._segment))
        elif self.num_timesteps - self._curve.last_step >= self._settings.checkpoint_interval / 10:
            self._write_curve()

    def _on_step(self) -> bool:
        self._curve.collect(self.locals["infos"])
        if time.monotonic() - self._shown > _PROGRESS_INTERVAL:
            self._shown = time.monotonic()
            self._report.update(self.num_timesteps, self._note)
        return True

    def _write_curve(self) -> None:
        point = self._curve.write(self.num_timesteps, self.seconds)
        if point.episodes:
            success = "" if np.isnan(point.success_rate) else f", success {100 * point.success_rate:.0f} %"
            self._note = f"return {point.return_mean:.3g}{success}"

    def save(self) -> None:
        """Write a checkpoint; the next segment follows it."""
        self._write_curve()
        self._segment += 1
        self._segment_step = self.num_timesteps
        environment = self._settings.env
        self._folder.save(Progress(self.num_timesteps, self._segment, self.seconds, environment), self._write)
        self._report.update(self.num_timesteps, self._note)

    def _write(self, checkpoint: Checkpoint) -> None:
        model = self.model
        model.save(checkpoint.model)
        if model._vec_normalize_env is not None:
            model._vec_normalize_env.save(str(checkpoint.normaliser))
        if isinstance(model, OffPolicyAlgorithm):
            model.save_replay_buffer(checkpoint.replay)


def _learn(settings: TrainSettings, folder: RunFolder, model: BaseAlgorithm, checkpoint: Checkpoint | None) -> None:
    start = checkpoint.progress if checkpoint is not None else Progress(0, 0, 0.0, settings.env)
    model.set_logger(configure(str(folder.tensorboard), ["tensorboard"]))
    budget = None if settings.time_budget_min is None else 60.0 * settings.time_budget_min - start.seconds
    with ProgressReport("Training", settings.total_steps, start.step, time_budget=budget) as report:
        callback = _SegmentCallback(settings, folder, start, report)
        model.num_timesteps = start.step
        _start_segment(model, derive_seed(settings.seed, start.segment))
        interval = 1 if settings.algorithm is Algorithm.PPO else 10  # rollouts or episodes between TensorBoard points
        try:
            model.learn(settings.total_steps - start.step, callback, interval, reset_num_timesteps=False)
            callback.save()
            ending = "finished"
        except _BudgetUsed:
            ending = "stopped, its time budget used"
        finally:
            model.logger.close()
    steps = model.num_timesteps
    print(f"Run {folder.path} {ending}: {steps:,} steps in {format_duration(callback.seconds)}.", file=sys.stderr)


def _close(environments: VecEnv) -> None:
    try:
        environments.close()
    except (EOFError, ConnectionError):
        return  # a worker that has died is closed already, and the reason was reported
