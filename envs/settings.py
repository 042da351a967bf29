"""The settings that every environment shares, checked once; messages name the argument, its value and its limit."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from evergym.errors import ConfigError

__all__ = ["EpisodeSettings", "PictureSettings", "RewardSettings", "check_choice", "check_index", "check_keys"]


@dataclass(frozen=True, kw_only=True)
class EpisodeSettings:
    """How an episode runs and when it ends.

    Attributes:
        model: Name of a shipped model or path of a model file.
        control_step_s: Robot time between two actions [s].
        time_limit_s: Robot time after which an episode is truncated [s], at least 300.
        everted_length_mm: Everted length at the start of an episode [mm].
        localisation_noise_mm: Standard deviation of the noise on the observed tip position, per axis [mm].
        hide_map: Whether the map's terms of the observation are zero.
        model_randomisation: Fraction of each model parameter's uncertainty drawn at reset; 0 keeps the model as it is.
        success_distance_mm: Tip error below which the target counts as reached [mm]; the task's definition.
        wall_force_limit_n: Wall force of one section above which a step costs 1 [N].
        perforation_depth_mm: Penetration of the wall above which it counts as perforated [mm].
        observation: "state", or "state+image" for a dictionary with the endoscope's picture beside the state.
    """

    model: str = "mammobot_2023"
    control_step_s: float = 0.25
    time_limit_s: float = 300.0
    everted_length_mm: float = 10.0
    localisation_noise_mm: float = 0.0
    hide_map: bool = False
    model_randomisation: float = 0.0
    success_distance_mm: float = 5.0
    # Prior: no published limit for a duct wall was found. Half a newton is 1.4 times the sheath's thrust p A at 50 kPa.
    wall_force_limit_n: float = 0.5
    # Prior: no published depth was found. Two millimetres is more than a robot radius.
    perforation_depth_mm: float = 2.0
    observation: str = "state"

    def __post_init__(self) -> None:
        _check_number("control_step_s", self.control_step_s, above=0.0, unit="s")
        _check_number("time_limit_s", self.time_limit_s, at_least=300.0, unit="s")
        _check_number("everted_length_mm", self.everted_length_mm, above=0.0, unit="mm")
        _check_number("localisation_noise_mm", self.localisation_noise_mm, at_least=0.0, unit="mm")
        _check_number("model_randomisation", self.model_randomisation, at_least=0.0, unit="")
        _check_number("success_distance_mm", self.success_distance_mm, above=0.0, unit="mm")
        _check_number("wall_force_limit_n", self.wall_force_limit_n, above=0.0, unit="N")
        _check_number("perforation_depth_mm", self.perforation_depth_mm, above=0.0, unit="mm")
        check_choice(self.observation, ("state", "state+image"), "observation")


@dataclass(frozen=True, kw_only=True)
class PictureSettings:
    """What ``render()`` shows.

    Attributes:
        view: "outside", "endoscope" or "map".
        width: Width of the picture in pixels; None: 480, or 240 for the endoscope.
        height: Height of the picture in pixels; None: 360, or 240 for the endoscope.
    """

    view: str = "outside"
    width: int | None = None
    height: int | None = None

    def __post_init__(self) -> None:
        check_choice(self.view, ("outside", "endoscope", "map"), "view")
        for name in ("width", "height"):
            value = getattr(self, name)
            if value is not None:
                check_index(value, name, 16)
                if value > 8192:
                    raise ConfigError(f"{name} is {value} pixels; it must be at most 8192.")


@dataclass(frozen=True, kw_only=True)
class RewardSettings:
    """Weights of the reward terms. They are a choice of this project, not measurements.

    Attributes:
        progress_per_mm: Reward per millimetre of way that is no longer to go [1/mm].
        discount: The gamma of the shaping ``gamma phi(s') - phi(s)``; 1 makes the sum over an episode telescope.
        success: Reward for reaching the target.
        failure: Penalty for a burst sheath or a perforated wall.
        wall_force_per_n_s: Penalty per newton and second of the largest wall force [1/(N s)].
        time_per_s: Penalty per second of robot time [1/s].
    """

    progress_per_mm: float = 0.1
    discount: float = 1.0
    success: float = 5.0
    failure: float = 5.0
    wall_force_per_n_s: float = 0.02
    time_per_s: float = 0.005

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            _check_number(f"reward[{field.name!r}]", getattr(self, field.name), at_least=0.0, unit="")
        if self.discount > 1.0:
            raise ConfigError(f"reward['discount'] is {self.discount}; it must lie in 0..1.")

    @classmethod
    def from_mapping(cls, weights: Mapping[str, float] | None) -> RewardSettings:
        """Return the settings with ``weights`` in place of the defaults.

        Raises:
            ConfigError: If a key is unknown (the nearest name is suggested) or a weight is impossible.
        """
        weights = weights or {}
        check_keys(weights, (field.name for field in dataclasses.fields(cls)), where="reward")
        return cls(**weights)


def check_keys(given: Mapping[str, Any], known: Iterable[str], *, where: str) -> None:
    """Raise ``ConfigError`` for the first key of ``given`` that is not ``known``, with the nearest name."""
    names = sorted(known)
    for key in given:
        if key not in names:
            nearest = difflib.get_close_matches(str(key), names, n=1, cutoff=0.0)
            hint = f" Did you mean {nearest[0]!r}?" if nearest else ""
            raise ConfigError(f"Unknown key {key!r} in {where}.{hint} Known keys: {', '.join(names)}.")


def check_choice(value: Any, known: Iterable[str], name: str) -> None:
    """Raise ``ConfigError`` unless ``value`` is one of the ``known`` words, with the nearest of them."""
    words = sorted(known)
    if value not in words:
        nearest = difflib.get_close_matches(str(value), words, n=1)
        hint = f" Did you mean {nearest[0]!r}?" if nearest else ""
        raise ConfigError(f"{name} is {value!r}; it must be one of {', '.join(words)}.{hint}")


def check_index(value: Any, name: str, least: int) -> None:
    """Raise ``ConfigError`` unless ``value`` is an integer of at least ``least``."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise ConfigError(f"{name} is {value!r}; it must be an integer of at least {least}.")


def _check_number(name: str, value: float, *, above: float = -math.inf, at_least: float = -math.inf, unit: str) -> None:
    """Raise ``ConfigError`` unless ``value`` is a finite number within its limit."""
    suffix = f" {unit}" if unit else ""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ConfigError(f"{name} is {value!r}; it must be a finite number{suffix and f' in{suffix}'}.")
    if value <= above:
        raise ConfigError(f"{name} is {value}{suffix}; it must be above {above:g}{suffix}.")
    if value < at_least:
        raise ConfigError(f"{name} is {value}{suffix}; it must be at least {at_least:g}{suffix}.")
