"""A user's own effect: Python code between the commands and the robot, or between the robot and the instruments."""

from __future__ import annotations

import dataclasses
import importlib.util
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evergym.config import ParameterInfo
from evergym.discrepancy.data.dataset import Run
from evergym.effects.catalogue import Effects
from evergym.errors import ConfigError
from evergym.simulator import Command, Reading

__all__ = ["Hook", "PassiveHook", "UserEffect", "load_user_effects"]

Array = NDArray[np.float64]


class Hook(Protocol):
    """An effect at work in one simulated run."""

    def reset(self, run: Run) -> None:
        """Forget everything: a run begins."""

    def transform_command(self, time: float, dt: float, command: Command, reading: Reading) -> Command:
        """Return what the drives do for ``dt`` [s] from ``time`` [s] on when told ``command`` (SI)."""

    def transform_channels(self, time: float, channels: Array) -> Array:
        """Return what the instruments read instead of ``channels``, shape (9,), in the channels' units."""


class PassiveHook:
    """A hook that changes nothing: derive from it and override what your effect does."""

    def reset(self, run: Run) -> None:
        """Forget everything: a run begins."""
        del run

    def transform_command(self, time: float, dt: float, command: Command, reading: Reading) -> Command:
        """Return the command as it is."""
        del time, dt, reading
        return command

    def transform_channels(self, time: float, channels: Array) -> Array:
        """Return the channels as they are."""
        del time
        return channels


@dataclass(frozen=True)
class UserEffect:
    """An effect that joins the candidates of a diagnosis without touching the package.

    Attributes:
        name: Its name in results; not one of the catalogue.
        hook: Makes the effect at work from the parameters as keyword arguments: a class such as a `PassiveHook`.
        parameters: Unit, limits (``low`` and ``high``: both needed) and meaning of each parameter.
        off: Value of each parameter at which the effect does nothing.
        typical: Value of each parameter at which the effect is clearly visible.
    """

    name: str
    hook: Callable[..., Hook]
    parameters: Mapping[str, ParameterInfo]
    off: Mapping[str, float]
    typical: Mapping[str, float]

    def create_hook(self, values: Mapping[str, float]) -> Hook:
        """Return the effect at these parameter values."""
        return self.hook(**values)


def load_user_effects(path: str | Path) -> tuple[UserEffect, ...]:
    """Return the effects in the list ``EFFECTS`` of a Python file, which is run.

    Raises:
        ConfigError: the file is missing, fails, has no such list, or an effect in it is incomplete.
    """
    path = Path(path)
    if not path.is_file():
        raise ConfigError(f"File '{path}' with your own effects does not exist. Check the path.")
    name = f"evergym_user_effects_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ConfigError(f"{path} is no Python file. Give a .py file that defines EFFECTS.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # so that its classes can be pickled to other processes
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise ConfigError(f"{path} fails when it is run: {type(error).__name__}: {error}.") from error
    effects = getattr(module, "EFFECTS", None)
    if not isinstance(effects, list | tuple) or not effects:
        raise ConfigError(f"{path} defines no list EFFECTS. Add: EFFECTS = [MyEffect()]")
    names: set[str] = set()
    for effect in effects:
        _check(effect, path)
        if effect.name in names:
            raise ConfigError(f"{path}: two effects are named '{effect.name}'. Give each a name of its own.")
        if effect.name in {field.name for field in dataclasses.fields(Effects)}:
            raise ConfigError(f"{path}: '{effect.name}' is an effect of the catalogue already. Choose another name.")
        names.add(effect.name)
    return tuple(effects)


def _check(effect: object, path: Path) -> None:
    if not isinstance(effect, UserEffect):
        raise ConfigError(f"{path}: EFFECTS holds a {type(effect).__name__}, but must hold UserEffect objects.")
    if not str(effect.name).isidentifier():
        raise ConfigError(f"{path}: an effect is named '{effect.name}'. Use letters, digits and underscores only.")
    if not effect.parameters:
        raise ConfigError(f"{path}: the effect '{effect.name}' has no parameters, so nothing of it can be fitted.")
    for name, info in effect.parameters.items():
        place = f"{path}: parameter '{name}' of the effect '{effect.name}'"
        if not isinstance(info, ParameterInfo):
            raise ConfigError(f"{place} is a {type(info).__name__}, but must be a ParameterInfo.")
        if info.low is None or info.high is None or not -math.inf < info.low < info.high < math.inf:
            raise ConfigError(f"{place} needs finite limits: low below high.")
        for kind, values in (("off", effect.off), ("typical", effect.typical)):
            value = values.get(name)
            if not isinstance(value, int | float) or not info.allows(float(value)):
                raise ConfigError(f"{place} needs a value '{kind}', {info.describe_limits()}: got {value!r}.")
    if all(effect.off[name] == effect.typical[name] for name in effect.parameters):
        raise ConfigError(f"{path}: the effect '{effect.name}' does at its typical values what it does when off.")
    try:
        effect.create_hook(effect.typical)
    except Exception as error:
        raise ConfigError(
            f"{path}: the hook of '{effect.name}' cannot be made with {', '.join(effect.parameters)}: "
            f"{type(error).__name__}: {error}."
        ) from error
