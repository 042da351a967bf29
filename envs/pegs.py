"""``MammobotPegs-v0``: reach a point among rigid pegs."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from evergym.duct_models.peg_family import PEG_FAMILIES, generate_pegs
from evergym.duct_models.pegs import PAPER_TARGETS, PegField, paper_pegs
from evergym.envs.base import MammobotEnv
from evergym.envs.observation import PEG_TERMS, ObservationTerm
from evergym.envs.route import PegRoute
from evergym.envs.settings import EpisodeSettings, check_index, check_keys
from evergym.errors import ConfigError
from evergym.world import World

__all__ = ["MammobotPegsEnv"]

_FAMILIES = ("paper", *PEG_FAMILIES)


class MammobotPegsEnv(MammobotEnv):
    """Grow among rigid pegs until the tip is within 5 mm of a point."""

    terms: ClassVar[tuple[ObservationTerm, ...]] = PEG_TERMS
    option_names: ClassVar[tuple[str, ...]] = ("everted_length_mm", "family", "index", "pegs")

    def __init__(
        self,
        *,
        family: str = "train",
        pool_size: int = 64,
        reward: Mapping[str, float] | None = None,
        render_mode: str | None = None,
        **settings: Any,
    ) -> None:
        check_keys(
            settings, (field.name for field in dataclasses.fields(EpisodeSettings)), where="the environment's arguments"
        )
        check_keys({family: None}, _FAMILIES, where="family")
        check_index(pool_size, "pool_size", 1)
        self.family = family
        self.pool_size = pool_size
        super().__init__(EpisodeSettings(**settings), reward, render_mode)

    def _select(self, options: Mapping[str, Any]) -> tuple[World, dict[str, Any], Any]:
        """Choose the field: from the options where given, else drawn."""
        if "pegs" in options:
            field, family, index = options["pegs"], "", -1
            if not isinstance(field, PegField):
                raise ConfigError(f"options['pegs'] is a {type(field).__name__}; it must be a PegField.")
            for key in ("family", "index"):
                if key in options:
                    raise ConfigError(
                        f"options has both 'pegs' and {key!r}. Give either a field or a family and an index."
                    )
            world = World.pegs(field)
        else:
            family = options.get("family", self.family)
            check_keys({family: None}, _FAMILIES, where="options['family']")
            # The paper's field is one arrangement; its index says which of the targets.
            count = len(PAPER_TARGETS) if family == "paper" else self.pool_size
            index = options["index"] if "index" in options else int(self.np_random.integers(count))
            check_index(index, "options['index']", 0)
            field, world = _build_place(family, index)
        self.peg_field = field
        return (
            world,
            {"anatomy": field.name, "anatomy_family": family, "anatomy_index": index, "target_index": 0},
            field,
        )

    def _make_route(self, start: NDArray[np.float64]) -> PegRoute:
        """Return the way to the selected target for a tip at ``start`` [m]."""
        return PegRoute(self.peg_field, start)


@lru_cache(maxsize=128)
def _build_place(family: str, index: int) -> tuple[PegField, World]:
    """Return a peg field and its world, kept: most episodes of a training run begin in a place already seen."""
    field = paper_pegs(index) if family == "paper" else generate_pegs(family, index)
    return field, World.pegs(field)
