"""The arms of a comparison: controllers by name or ``module:Class``, learned policies by run folder."""

from __future__ import annotations

import dataclasses
import importlib
import pickle
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from evergym.agents.code_fingerprint import fingerprint_file
from evergym.agents.run_folder import RunFolder
from evergym.agents.suggest import suggest
from evergym.errors import ConfigError, RunError

__all__ = ["CONTROLLERS", "Arm", "Policy", "find_controller_arm", "find_run_arm", "make_policy"]

CONTROLLERS = {
    "duty_cycle": "evergym.agents.duty_cycle:DutyCycleController",
    "push_only": "evergym.agents.reference:PushOnlyPolicy",
    "random": "evergym.agents.reference:RandomPolicy",
}
"""The scripted arms; each class takes the environment and has Stable-Baselines3's ``predict``."""


class Policy(Protocol):
    """What an arm is: Stable-Baselines3's ``predict``."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Any, Any]:
        """Return the action and the next state of the policy."""


@dataclasses.dataclass(frozen=True)
class Arm:
    """One arm of a comparison; it can be sent to another process."""

    name: str
    """Name in tables and files."""
    source: str
    """``module:Class`` of a controller, or the run folder of a learned policy."""
    learned: bool = False
    """Whether it was trained."""
    fingerprint: str = ""
    """Hash of the weights of a learned policy."""


def find_controller_arm(word: str) -> Arm:
    """Make the arm of a controller, given as a known name, ``module:Class`` or ``name=module:Class``.

    Raises:
        ConfigError: No such controller, or its module is not there.
    """
    name, separator, source = word.partition("=")
    source = source if separator else word
    if source in CONTROLLERS:
        source = CONTROLLERS[source]
    elif ":" not in source:
        raise ConfigError(f"There is no controller '{source}'{suggest(source, CONTROLLERS)}")
    arm = Arm(name if separator or name in CONTROLLERS else source.rpartition(":")[2], source)
    _load_controller(arm.source)
    return arm


def find_run_arm(path: Path) -> Arm:
    """Make the arm of the latest checkpoint of a run.

    Raises:
        RunError: There is no such run, or it has no checkpoint yet.
    """
    folder = RunFolder.open(path)
    checkpoint = folder.latest()
    return Arm(folder.name, str(path), True, fingerprint_file(checkpoint.model, checkpoint.normaliser))


def make_policy(arm: Arm, env: gymnasium.Env[Any, Any]) -> Policy:
    """Make a fresh policy for one episode.

    Raises:
        RunError: The learned policy belongs to an environment with other observations or actions.
    """
    if arm.learned:
        policy = _load_policy(arm.source, arm.fingerprint)
        policy.check_spaces(env)
        return policy
    controller: Policy = _load_controller(arm.source)(env)
    return controller


def _load_controller(source: str) -> Any:
    module, _, name = source.partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except (ModuleNotFoundError, AttributeError) as error:
        raise ConfigError(f"Controller '{source}' cannot be loaded: {error}.") from error


class LearnedPolicy:
    """The latest checkpoint of a run, with the statistics that normalise its observations.

    Args:
        folder: The run.
    """

    def __init__(self, folder: RunFolder):
        import torch  # here only: controllers do without it

        from evergym.agents.training import ALGORITHMS

        torch.set_num_threads(1)  # parallelism is over episodes
        checkpoint = folder.latest()
        settings = folder.settings
        self._name, self._env = folder.path, settings.env
        # A policy that only acts needs no replay buffer.
        replaced = {"buffer_size": 1, "replay_buffer_class": None}
        try:
            self._model = ALGORITHMS[settings.algorithm].load(checkpoint.model, device="cpu", custom_objects=replaced)
            self._normaliser: Any = None
            if checkpoint.normaliser.is_file():
                self._normaliser = pickle.loads(checkpoint.normaliser.read_bytes())  # noqa: S301 (see RunFolder)
        except (ValueError, OSError, EOFError, KeyError, pickle.UnpicklingError) as error:
            raise RunError(f"Checkpoint '{checkpoint.path}' is damaged: {error}") from error

    def check_spaces(self, env: gymnasium.Env[Any, Any]) -> None:
        """Raise `RunError` if the policy was trained with other observations or actions than those of ``env``."""
        pairs = (
            ("observations", self._model.observation_space, env.observation_space),
            ("actions", self._model.action_space, env.action_space),
        )
        for name, trained, given in pairs:
            if trained != given:
                raise RunError(
                    f"The policy of run '{self._name}' was trained on '{self._env}', whose {name} are "
                    f"{_describe(trained)}; here they are {_describe(given)}. Evaluate it on its own environment."
                )

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Any, Any]:
        """Return the action for a raw observation of one environment."""
        if self._normaliser is not None:
            observation = self._normaliser.normalize_obs(observation)
        return self._model.predict(observation, state, episode_start, deterministic)


@lru_cache(maxsize=8)
def _load_policy(path: str, fingerprint: str) -> LearnedPolicy:
    policy = LearnedPolicy(RunFolder.open(Path(path)))
    if find_run_arm(Path(path)).fingerprint != fingerprint:
        raise RunError(f"Run '{path}' got a new checkpoint while it was evaluated. Wait until its training has ended.")
    return policy


def _describe(space: spaces.Space[Any]) -> str:
    return f"{type(space).__name__}{list(space.shape)}" if space.shape else str(space)
