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
from evergym.envs.settings import EpisodeSettings, PictureSettings, check_choice, check_index, check_keys
from evergym.errors import ConfigError, GeometryError
from evergym.units import MM
from evergym.world import World

__all__ = ["MammobotPegsEnv"]

_FAMILIES = ("paper", *PEG_FAMILIES)


class MammobotPegsEnv(MammobotEnv):
    """Grow among rigid vertical pegs until the tip is within 5 mm of a point.

    Action, reward, end and info are those of ``MammobotDuctEnv``, with the distance in space as tip error, the
    shortest clear way among the pegs as way to go, and without walls to perforate (pegs are rigid).

    ## Observation

    ``Box(-1, 1, (size,), float32)``; a component is its value over its scale, clipped to -1..1. The world's origin is
    the port, +z the direction of insertion, gravity along -y, and the pegs stand along y. The tip frame's axes are
    the tendon side (to which pulling bends the tip), the binormal and the tip direction. ``hide_map``,
    ``localisation_noise_mm`` and ``observation="state+image"`` are as in ``MammobotDuctEnv``.

    | index | name | scale | unit | meaning |
    |---|---|---|---|---|
    | 0 | `insertion_velocity` | 2.9 | mm/s | commanded insertion velocity of the catheter |
    | 1 | `everted_length` | 100 | mm | everted length |
    | 2 | `protrusion` | 20 | mm | inserted length of the catheter minus everted length |
    | 3 | `slack` | 20 | mm | fed tail not yet everted |
    | 4-5 | `roll` | 1 | - | sine and cosine of the catheter's roll at the base |
    | 6 | `tendon_pull` | 4.9 | mm | tendon pull |
    | 7 | `pressure` | 50 | kPa | gauge pressure in the sheath |
    | 8 | `growth_rate` | 2.9 | mm/s | rate of the everted length |
    | 9 | `tendon_tension` | 20 | N | tension of the tendon at the base |
    | 10 | `tail_tension` | 1 | N | tension of the tail at the base |
    | 11 | `buckled` | 1 | - | 1 if the sheath has buckled |
    | 12-14 | `tip_position` | 100 | mm | tip position, world frame |
    | 15-17 | `tip_direction` | 1 | - | direction of growth at the tip, world frame |
    | 18-20 | `tendon_side` | 1 | - | side to which pulling bends the tip, world frame |
    | 21-35 | `way_ahead` | 25 | mm | points of the way 3, 6, 10, 15, 20 mm ahead, tip frame |
    | 36-40 | `width_ahead` | 10 | mm | distance to the nearest peg's surface at these points |
    | 41-43 | `nearest_peg` | 25 | mm | vector from the tip to the nearest peg's axis, tip frame |
    | 44-46 | `target` | 100 | mm | vector from the tip to the target, tip frame |
    | 47 | `distance_to_go` | 100 | mm | way to go to the target |
    | 48 | `peg_clearance` | 10 | mm | distance from the tip to the nearest peg's surface |
    | 49-51 | `tip_force` | 0.5 | N | contact force on the tip, tip frame |
    | 52 | `wall_force_max` | 0.5 | N | largest wall force on one section |
    | 53 | `wall_force_sum` | 2 | N | sum of the wall forces |
    | 54 | `contact_count` | 20 | - | number of sections in contact |
    | 55 | `time_left` | 1 | - | fraction of the time limit that is left |

    ## Arguments of ``gymnasium.make``

    As in ``MammobotDuctEnv``; ``family`` is "train", "held_out", "dense" or "paper" (the arrangement of the paper's
    Fig. 12).

    ## Options of ``reset``

    ``family``, ``index`` (with "paper": which of its targets, 0..2), ``everted_length_mm``; or ``pegs``: a
    ``PegField`` instead of family and index. Unknown keys raise ``ConfigError``.

    ## Versions

    - v0: first version.
    """

    terms: ClassVar[tuple[ObservationTerm, ...]] = PEG_TERMS
    has_wall: ClassVar[bool] = False
    option_names: ClassVar[tuple[str, ...]] = ("everted_length_mm", "family", "index", "pegs")

    def __init__(
        self,
        *,
        family: str = "train",
        pool_size: int = 64,
        reward: Mapping[str, float] | None = None,
        render_mode: str | None = None,
        view: str = "outside",
        width: int | None = None,
        height: int | None = None,
        **settings: Any,
    ) -> None:
        check_keys(
            settings, (field.name for field in dataclasses.fields(EpisodeSettings)), where="the environment's arguments"
        )
        check_choice(family, _FAMILIES, "family")
        check_index(pool_size, "pool_size", 1)
        self.family = family
        self.pool_size = pool_size
        picture = PictureSettings(view=view, width=width, height=height)
        super().__init__(EpisodeSettings(**settings), reward, render_mode, picture)

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
            world = World.peg_field(field)
        else:
            family = options.get("family", self.family)
            check_choice(family, _FAMILIES, "options['family']")
            # The paper's field is one arrangement; its index says which of the targets.
            count = len(PAPER_TARGETS) if family == "paper" else self.pool_size
            index = options["index"] if "index" in options else int(self.np_random.integers(count))
            check_index(index, "options['index']", 0)
            field, world = _build_place(family, index)
        diameter, room = self.model.robot.sheath_outer_diameter_mm * MM, field.robot_diameter + 2.0 * field.clearance
        if diameter > room:
            raise GeometryError(
                f"Peg field {field.name!r} has room for robots up to {room / MM:.2f} mm along its way; this "
                f"one's outer diameter is {diameter / MM:.2f} mm. Choose a smaller sheath or give a field made for it."
            )
        self.peg_field = field
        return (
            world,
            {"anatomy": field.name, "anatomy_family": family, "anatomy_index": index, "target_index": 0},
            field,
        )

    def _start_path(self) -> NDArray[np.float64]:
        """Return the way to the selected target [m], shape (k, 3), along which the robot is laid at the start."""
        return self.peg_field.way

    def _make_route(self, start: NDArray[np.float64]) -> PegRoute:
        """Return the way to the selected target for a tip at ``start`` [m]."""
        return PegRoute(self.peg_field, start)


@lru_cache(maxsize=128)
def _build_place(family: str, index: int) -> tuple[PegField, World]:
    """Return a peg field and its world, kept: most episodes of a training run begin in a place already seen."""
    field = paper_pegs(index) if family == "paper" else generate_pegs(family, index)
    return field, World.peg_field(field)
