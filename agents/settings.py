"""The training settings: one frozen dataclass is the command line of ``evergym train`` and the run folder's record."""

from __future__ import annotations

import dataclasses
import enum
import tomllib
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import tomli_w

from evergym.agents.suggest import suggest
from evergym.errors import ConfigError
from evergym.whole_file import write_whole

__all__ = [
    "Algorithm",
    "LearningRateSchedule",
    "OffPolicySettings",
    "PpoSettings",
    "TrainSettings",
    "parse_options",
    "read_settings",
    "write_settings",
]

T = TypeVar("T")


class Algorithm(enum.StrEnum):
    """The learning algorithms."""

    PPO = "ppo"
    SAC = "sac"
    TQC = "tqc"


class LearningRateSchedule(enum.StrEnum):
    """How the learning rate changes over the whole run (by global step, so a resumed run follows the same line)."""

    CONSTANT = "constant"
    LINEAR = "linear"


@dataclasses.dataclass(frozen=True)
class PpoSettings:
    """Hyper-parameters of PPO (Schulman 2017, arXiv:1707.06347)."""

    rollout_steps: int = 256
    """Steps per environment between two updates."""
    batch_size: int = 256
    """Samples in one gradient step."""
    epochs: int = 10
    """Passes over a rollout per update."""
    clip_range: float = 0.2
    """Largest change of the action probability ratio."""
    gae_lambda: float = 0.95
    """Weight of long returns in the advantage."""
    entropy_coefficient: float = 0.0
    """Reward for staying random."""
    value_coefficient: float = 0.5
    """Weight of the value loss."""
    gradient_limit: float = 0.5
    """Largest gradient norm."""
    log_std_initial: float = -0.5
    """Logarithm of the first exploration noise (the action range is -1 to 1)."""


@dataclasses.dataclass(frozen=True)
class OffPolicySettings:
    """Hyper-parameters of SAC (Haarnoja 2018, arXiv:1812.05905) and TQC (Kuznetsov 2020, arXiv:2005.04269)."""

    buffer_size: int = 300_000
    """Transitions kept for replay."""
    learning_starts: int = 5_000
    """Steps of random actions before the first update."""
    batch_size: int = 256
    """Samples in one gradient step."""
    tau: float = 0.005
    """Share of the target network replaced at every update."""
    train_interval: int = 1
    """Steps per environment between two updates."""
    gradient_steps: int = -1
    """Gradient steps per update; -1: as many as steps were taken in all environments."""
    dropped_quantiles: int = 2
    """TQC only: quantiles dropped per critic (against optimism)."""
    hindsight: bool = False
    """Relabel goals (HER, Andrychowicz 2017, arXiv:1707.01495); needs a goal environment."""


@dataclasses.dataclass(frozen=True)
class TrainSettings:
    """Train a policy in parallel processes, with checkpoints from which a killed run continues exactly."""

    env: str = "MammobotDuct-v0"
    """Environment id."""
    env_options: tuple[str, ...] = ()
    """Arguments of the environment as key=value, for example: control_step_s=0.5."""
    algorithm: Algorithm = Algorithm.PPO
    """Learning algorithm."""
    total_steps: int = 500_000
    """Environment steps in all (rounded up to a whole update)."""
    env_count: int = 8
    """Environments stepped in parallel processes (1: in this process)."""
    seed: int = 0
    """Seed of everything random."""
    learning_rate: float = 3e-4
    """Step size of the optimiser."""
    learning_rate_schedule: LearningRateSchedule = LearningRateSchedule.CONSTANT
    """Learning rate over the run."""
    discount: float = 0.99
    """Weight of the next step's value (gamma)."""
    hidden: tuple[int, ...] = (128, 128)
    """Widths of the hidden layers of policy and critic."""
    normalise_observations: bool | None = None
    """Divide observations by their running spread (None: yes for PPO, no for SAC and TQC)."""
    normalise_rewards: bool | None = None
    """Divide rewards by the running spread of the return (None: yes for PPO, no for SAC and TQC)."""
    ppo: PpoSettings = dataclasses.field(default_factory=PpoSettings)
    """PPO only."""
    off_policy: OffPolicySettings = dataclasses.field(default_factory=OffPolicySettings)
    """SAC and TQC only."""
    checkpoint_interval: int = 50_000
    """Environment steps between checkpoints; every checkpoint starts fresh episodes (see evergym.agents.training)."""
    time_budget_min: float | None = None
    """Stop at the first checkpoint after this many minutes of training, counted over all resumed parts."""
    folder: Path | None = None
    """Run folder to create (None: runs/<env>-<algorithm>-seed<seed>)."""
    resume: Path | None = None
    """Continue this run folder, with its own settings; only total_steps and time_budget_min may be given anew."""
    device: str = "cpu"
    """Torch device; only the CPU repeats a run bit for bit."""

    def __post_init__(self) -> None:
        positive = {
            "total_steps": self.total_steps,
            "env_count": self.env_count,
            "learning_rate": self.learning_rate,
            "checkpoint_interval": self.checkpoint_interval,
            "ppo.rollout_steps": self.ppo.rollout_steps,
            "ppo.batch_size": self.ppo.batch_size,
            "ppo.epochs": self.ppo.epochs,
            "off_policy.buffer_size": self.off_policy.buffer_size,
            "off_policy.batch_size": self.off_policy.batch_size,
            "off_policy.train_interval": self.off_policy.train_interval,
        }
        for name, value in positive.items():
            if not value > 0:
                raise ConfigError(f"Training setting '{name}' is {value}; it must be above 0.")
        if self.seed < 0:
            raise ConfigError(f"Training setting 'seed' is {self.seed}; it must be 0 or above.")
        if not 0.0 < self.discount <= 1.0:
            raise ConfigError(f"Training setting 'discount' is {self.discount}; it must be above 0 and at most 1.")
        if self.time_budget_min is not None and not self.time_budget_min > 0:
            raise ConfigError(f"Training setting 'time_budget_min' is {self.time_budget_min} min; it must be above 0.")
        if self.algorithm is Algorithm.PPO and self.ppo.rollout_steps * self.env_count < 2:
            raise ConfigError("PPO needs at least 2 samples per update: raise ppo.rollout_steps or env_count.")
        parse_options(self.env_options)

    def run(self) -> int:
        """Train, or continue a run; returns the exit code."""
        from evergym.agents.training import train  # torch loads here only

        train(self)
        return 0


def parse_options(options: tuple[str, ...]) -> dict[str, Any]:
    """Turn ``("control_step_s=0.5", "model=robot_a")`` into keyword arguments.

    A value is read as TOML (numbers, true, false, lists, quoted text); anything else is taken as plain text.

    Raises:
        ConfigError: An entry has no ``=``, or a key comes twice.
    """
    result: dict[str, Any] = {}
    for option in options:
        key, separator, text = option.partition("=")
        key = key.strip().replace("-", "_")
        if not separator or not key.isidentifier():
            raise ConfigError(f"Option '{option}' is not of the form key=value, for example control_step_s=0.5.")
        if key in result:
            raise ConfigError(f"Option '{key}' is given twice: {result[key]!r} and {text!r}.")
        try:
            result[key] = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            result[key] = text
    return result


def _to_plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            field.name: _to_plain(getattr(value, field.name))
            for field in dataclasses.fields(value)
            if getattr(value, field.name) is not None  # TOML has no null: a missing key means None
        }
    if isinstance(value, tuple):
        return [_to_plain(item) for item in value]
    if isinstance(value, enum.Enum):
        return value.value
    return str(value) if isinstance(value, Path) else value


def _from_plain(kind: Any, value: Any, where: str) -> Any:
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return _from_plain(next(item for item in arguments if item is not type(None)), value, where)
    if dataclasses.is_dataclass(kind) and isinstance(kind, type):
        if not isinstance(value, Mapping):
            raise ConfigError(f"'{where}' must be a table of settings, not {value!r}.")
        return _build(kind, value, where)
    try:
        if origin is tuple and isinstance(value, list):
            return tuple(_from_plain(arguments[0], item, where) for item in value)
        if isinstance(kind, type) and issubclass(kind, (enum.Enum, Path)):
            return kind(value)
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            return float(value)
    except ValueError as error:
        raise ConfigError(f"'{where}' has the value {value!r}: {error}.") from error
    if isinstance(kind, type) and type(value) is not kind:
        raise ConfigError(f"'{where}' must be of type {kind.__name__}, not {value!r}.")
    return value


def _build(kind: type[T], values: Mapping[str, Any], where: str) -> T:
    hints = typing.get_type_hints(kind)
    for key in values:
        if key not in hints:
            raise ConfigError(f"{where}: unknown key '{key}'{suggest(key, hints)}")
    return kind(**{key: _from_plain(hints[key], value, f"{where}: {key}") for key, value in values.items()})


def write_settings(settings: Any, path: Path) -> None:
    """Write a settings dataclass as TOML, atomically; keys that are None are left out."""
    write_whole(path, tomli_w.dumps(_to_plain(settings)))


def read_settings(kind: type[T], path: Path) -> T:
    """Read what `write_settings` wrote.

    Raises:
        ConfigError: The file is not TOML, has an unknown key or a value of the wrong type.
    """
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"'{path}' is not a TOML file: {error}.") from error
    return _build(kind, values, str(path))
