"""Environments and simulator for MAMMOBOT, a tendon-steered catheter in a sheath that grows by eversion.

``import evergym`` registers the environments with gymnasium and stays light: the simulator (numba) and the learning
libraries (torch) load when they are first used.
"""

from __future__ import annotations

import importlib
import importlib.metadata
from typing import TYPE_CHECKING, Any

import gymnasium

if TYPE_CHECKING:
    from evergym.model import Model, load_model
    from evergym.simulator import Command, Simulator
    from evergym.world import World

__all__ = ["ENTRY_POINTS", "Command", "Model", "Simulator", "World", "load_model"]

try:
    __version__ = importlib.metadata.version("evergym")
except importlib.metadata.PackageNotFoundError:  # run from a checkout that is only on the path
    __version__ = "0+unknown"

ENTRY_POINTS = {
    "MammobotDuct-v0": "evergym.envs.duct:MammobotDuctEnv",
    "MammobotPegs-v0": "evergym.envs.pegs:MammobotPegsEnv",
    "MammobotDuctGoal-v0": "evergym.envs.goal:MammobotDuctGoalEnv",
    "MammobotPegsGoal-v0": "evergym.envs.goal:MammobotPegsGoalEnv",
}
"""The registered environments. None has ``max_episode_steps``: the control step is an argument, so the environments
end an episode by robot time themselves."""

_LAZY = {
    "Command": "evergym.simulator",
    "Model": "evergym.model",
    "Simulator": "evergym.simulator",
    "World": "evergym.world",
    "load_model": "evergym.model",
}

for _id, _entry_point in ENTRY_POINTS.items():
    gymnasium.register(id=_id, entry_point=_entry_point)


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'evergym' has no attribute {name!r}")
    value = getattr(importlib.import_module(_LAZY[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
