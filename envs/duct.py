"""``MammobotDuct-v0``: reach a target in a mammary duct tree."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from evergym.duct_models.duct import Duct
from evergym.duct_models.family import FAMILIES
from evergym.duct_models.generate import generate_duct
from evergym.duct_models.user_mesh import load_duct
from evergym.envs.base import MammobotEnv
from evergym.envs.observation import DUCT_TERMS, ObservationTerm
from evergym.envs.route import LumenRoute
from evergym.envs.settings import EpisodeSettings, check_index, check_keys
from evergym.errors import ConfigError
from evergym.world import World

__all__ = ["MammobotDuctEnv"]


class MammobotDuctEnv(MammobotEnv):
    """Grow through a mammary duct tree until the tip is within 5 mm of a target, along the lumen."""

    terms: ClassVar[tuple[ObservationTerm, ...]] = DUCT_TERMS
    option_names: ClassVar[tuple[str, ...]] = ("duct", "everted_length_mm", "family", "index", "target")

    def __init__(
        self,
        *,
        family: str = "train",
        pool_size: int = 64,
        reward: Mapping[str, float] | None = None,
        render_mode: str | None = None,
        **settings: Any,
    ) -> None:
        names = {field.name for field in dataclasses.fields(EpisodeSettings)}
        check_keys(settings, names, where="the environment's arguments")
        check_keys({family: None}, FAMILIES, where="family")
        check_index(pool_size, "pool_size", 1)
        self.family = family
        self.pool_size = pool_size
        super().__init__(EpisodeSettings(**settings), reward, render_mode)

    def _select(self, options: Mapping[str, Any]) -> tuple[World, dict[str, Any], Any]:
        """Choose duct and target: from the options where given, else drawn."""
        if "duct" in options:
            for key in ("family", "index"):
                if key in options:
                    raise ConfigError(
                        f"options has both 'duct' and {key!r}. Give either a duct or a family and an index."
                    )
            duct, world = _place_duct(options["duct"])
            family, index = str(duct.metadata.get("family", "")), int(duct.metadata.get("index", -1))
        else:
            family = options.get("family", self.family)
            check_keys({family: None}, FAMILIES, where="options['family']")
            index = options["index"] if "index" in options else int(self.np_random.integers(self.pool_size))
            check_index(index, "options['index']", 0)
            duct, world = _build_place(family, index)
        count = len(duct.targets)
        target = options["target"] if "target" in options else int(self.np_random.integers(count))
        check_index(target, "options['target']", 0)
        if target >= count:
            raise ConfigError(f"options['target'] is {target}; duct {duct.name!r} has targets 0..{count - 1}.")
        self.duct = duct
        self.target_index = target
        anatomy = {
            "anatomy": duct.name,
            "anatomy_family": family,
            "anatomy_index": index,
            "target_index": target,
        }
        return world, anatomy, duct

    def _make_route(self, start: NDArray[np.float64]) -> LumenRoute:
        """Return the way to the selected target for a tip at ``start`` [m]."""
        return LumenRoute(self.duct.centreline, self.duct.targets[self.target_index].node, start)


@lru_cache(maxsize=128)
def _build_place(family: str, index: int) -> tuple[Duct, World]:
    """Return a generated duct and its world; kept, since an episode's start must not cost a second."""
    duct = generate_duct(family, index)
    return duct, World.duct(duct)


def _place_duct(given: Any) -> tuple[Duct, World]:
    """Return a user's duct, given as an object or as a mesh file, and its world."""
    if isinstance(given, str | Path):
        given = load_duct(given)
    if not isinstance(given, Duct):
        raise ConfigError(f"options['duct'] is a {type(given).__name__}; it must be a Duct or the path of a mesh file.")
    return given, World.duct(given)
