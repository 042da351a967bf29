"""Make environments by id, for one process or many, with clear errors for mistyped ids and arguments."""

from __future__ import annotations

import inspect
import multiprocessing
import os
import signal
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import gymnasium

from evergym.agents.suggest import suggest
from evergym.errors import ConfigError

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

__all__ = ["ignore_interrupts", "make_env", "make_env_batch", "prepare_workers", "probe_env", "resolve_env_id"]

START_METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
"""Never plain fork: torch and numba hold threads and locks that a forked child inherits in an undefined state."""


def resolve_env_id(name: str) -> str:
    """Return the id in the form that also works in a fresh process (``evergym:...`` for our own).

    Raises:
        ConfigError: No such environment; the nearest id is suggested.
    """
    import evergym  # registers the ids

    if ":" in name:
        module, _, _ = name.partition(":")
        if module != "evergym":
            return name
        name = name.removeprefix("evergym:")
    if name in evergym.ENTRY_POINTS:
        return f"evergym:{name}"
    if name in gymnasium.registry:
        return name
    # Gymnasium's own fit neither robot nor controllers: nobody who mistypes one of ours means those.
    raise ConfigError(f"There is no environment '{name}'{suggest(name, evergym.ENTRY_POINTS)}")


def make_env(name: str, options: Mapping[str, Any] | None = None) -> gymnasium.Env[Any, Any]:
    """Make one environment.

    Args:
        name: Environment id, with or without a module prefix.
        options: Keyword arguments of the environment.

    Raises:
        ConfigError: Unknown id or argument, or a module that cannot be imported.
    """
    env_id = resolve_env_id(name)
    try:
        return gymnasium.make(env_id, disable_env_checker=True, **(options or {}))
    except (gymnasium.error.Error, ModuleNotFoundError) as error:
        raise ConfigError(f"Environment '{name}' cannot be made: {error}") from error
    except TypeError as error:
        raise _explain_arguments(env_id, options or {}, error) from error


def _explain_arguments(env_id: str, options: Mapping[str, Any], error: TypeError) -> Exception:
    """Turn "unexpected keyword argument" into a suggestion; other type errors stay what they are."""
    entry_point: Any = gymnasium.registry[env_id.rpartition(":")[2]].entry_point
    if isinstance(entry_point, str):
        entry_point = gymnasium.envs.registration.load_env_creator(entry_point)
    if not callable(entry_point):
        return error
    known = [name for name in inspect.signature(entry_point).parameters if name not in ("self", "kwargs")]
    for key in options:
        if key not in known:
            return ConfigError(f"Environment '{env_id}' has no argument '{key}'{suggest(key, known)}")
    return error


def prepare_workers(*preload: str) -> multiprocessing.context.BaseContext:
    """Set up the start of worker processes: one thread each, and modules that all of them share.

    Args:
        preload: Modules that the server process imports once, so that workers start in milliseconds.
    """
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(variable, "1")  # parallelism is over environments
    context = multiprocessing.get_context(START_METHOD)
    if START_METHOD == "forkserver":
        context.set_forkserver_preload(["__main__", *preload])
    return context


def ignore_interrupts() -> None:
    """Leave Ctrl-C to the main process, which closes its workers in order."""
    if multiprocessing.parent_process() is not None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def probe_env(name: str, options: Mapping[str, Any]) -> None:
    """Make an environment in this process and step it once, before workers do the same.

    A wrong argument is then reported as such and not as a dead worker, and the kernels are compiled once for all
    workers (they find them on disk) instead of once in each, at the same time.
    """
    env = make_env(name, options)
    try:
        env.reset(seed=0)
        env.step(env.action_space.sample())
    finally:
        env.close()


class _EnvMaker:
    """A picklable constructor for a worker process."""

    def __init__(self, name: str, options: Mapping[str, Any]):
        self.name, self.options = name, dict(options)

    def __call__(self) -> gymnasium.Env[Any, Any]:
        ignore_interrupts()
        return make_env(self.name, self.options)


def make_env_batch(name: str, options: Mapping[str, Any], count: int) -> VecEnv:
    """Make environments for training, each in a process of its own (one alone stays in this process).

    One is probed here first, see `probe_env`.
    """
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecMonitor

    resolved = resolve_env_id(name)
    makers: list[Callable[[], gymnasium.Env[Any, Any]]] = [_EnvMaker(resolved, options)] * count
    if count == 1:
        return VecMonitor(DummyVecEnv(makers))
    probe_env(resolved, options)
    prepare_workers("stable_baselines3.common.env_util", "evergym.agents.env_factory")
    return VecMonitor(SubprocVecEnv(makers, start_method=START_METHOD))
