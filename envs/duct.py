"""``MammobotDuct-v0``: reach a target in a mammary duct tree."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from evergym.duct_models.duct import Duct, generate_duct
from evergym.duct_models.family import FAMILIES
from evergym.duct_models.importer import load_duct
from evergym.envs.base import MammobotEnv
from evergym.envs.observation import DUCT_TERMS, ObservationTerm
from evergym.envs.route import LumenRoute
from evergym.envs.settings import EpisodeSettings, PictureSettings, check_choice, check_index, check_keys
from evergym.errors import ConfigError, GeometryError
from evergym.units import MM
from evergym.world import World

__all__ = ["MammobotDuctEnv"]


class MammobotDuctEnv(MammobotEnv):
    """Grow through a mammary duct tree until the tip is within 5 mm of a target, measured along the lumen.

    ## Action

    ``Box(-1, 1, (4,), float32)``, held for one control step. Values out of range are clipped; one that is not finite
    raises ``ValueError``. The limits are those of the robot in the model file; in brackets: of the default model.

    | index | name | -1 | 0 | 1 | limits |
    |---|---|---|---|---|---|
    | 0 | insertion velocity | -v | 0 | v | v = half the tail feed limit (2.9 mm/s); negative withdraws |
    | 1 | catheter roll rate | -45 deg/s | 0 | 45 deg/s | 45 deg/s is a prior |
    | 2 | tendon pull set point | 0 | half | all | largest pull (4.9 mm), followed at up to 2 mm/s (prior) |
    | 3 | pressure set point | 0 | half | all | pressure limit (50 kPa gauge), followed at up to 50 kPa/s (prior) |

    The tail is fed twice as fast as the catheter is inserted, so a negative insertion also retracts the tail. An
    interlock holds a catheter that is 10 mm ahead of the sheath's tip and feeds the tail on: the sheath, not a bare
    catheter, is to arrive.

    ## Observation

    ``Box(-1, 1, (size,), float32)``; a component is its value over its scale, clipped to -1..1. The world's origin is
    the port, +z the direction of insertion, gravity along -y. The tip frame's axes are the tendon side (to which
    pulling bends the tip), the binormal and the tip direction.

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
    | 36-40 | `width_ahead` | 10 | mm | lumen radius at these points |
    | 41-43 | `centreline_offset` | 10 | mm | vector from the tip to the centreline, tip frame |
    | 44-46 | `target` | 100 | mm | vector from the tip to the target, tip frame |
    | 47 | `distance_to_go` | 100 | mm | way to go to the target |
    | 48 | `astray` | 1 | - | 1 if the tip is in a branch off the way to the target |
    | 49-51 | `tip_force` | 0.5 | N | contact force on the tip, tip frame |
    | 52 | `wall_force_max` | 0.5 | N | largest wall force on one section |
    | 53 | `wall_force_sum` | 2 | N | sum of the wall forces |
    | 54 | `contact_count` | 20 | - | number of sections in contact |
    | 55 | `time_left` | 1 | - | fraction of the time limit that is left |

    With ``hide_map`` the map's terms are zero: `way_ahead`, `width_ahead`, `centreline_offset`, `target`,
    `distance_to_go`, `astray`. With ``localisation_noise_mm`` the terms that need the tip pose see it with Gaussian
    noise on the position, and on the directions as if they were found from two points 10 mm apart; reward and success
    use the true pose.

    With ``observation="state+image"``: a dictionary of ``state``, the vector above, and ``endoscope``, ``Box(0, 255,
    (64, 64, 3), uint8)``: what a camera at the tip sees of wall or pegs, its lamp's light falling off with distance.
    It looks along the tip direction over 100 degrees (prior), the tendon side up. A green ball, lit by itself, marks
    the target where nothing hides it; with ``hide_map`` there is none. The camera is where the tip is: localisation
    noise does not move it.

    ## Reward

    The sum of ``info["reward/<term>"]``. The weights are arguments, see ``RewardSettings``.

    | term | value | default |
    |---|---|---|
    | `progress` | weight x (way to go before - discount x way to go after), along the lumen | 0.1 per mm, discount 1 |
    | `success` | once, on reaching the target | 5 |
    | `failure` | once, on a burst or perforation | -5 |
    | `wall_force` | -weight x largest wall force on one section x control step | 0.02 per N s |
    | `time` | -weight x control step | 0.005 per s |

    ## Start and end

    The robot starts along the way, 10 mm everted, the catheter level with the sheath, without pressure or pull. The
    duct is drawn from the first ``pool_size`` of its family and the target from the duct's. Terminated: `reached`
    (tip error at most 5 mm), `burst`, `perforated` (penetration above ``perforation_depth_mm``, a prior). Truncated:
    `time`, `diverged` (the simulator found no solution even with an eighth of the step). ``info["end_reason"]`` has
    the word, and is empty until the end.

    The tip error is the distance in the unrolled duct, hypot(way to go along the lumen, distance from the
    centreline), so a neighbouring branch behind a wall is as far as the way back to the bifurcation and out again.

    ## Info

    `is_success`, `end_reason`; `cost` = `cost_wall_force` (1 if the wall force of a section is above
    ``wall_force_limit_n``, a prior) + `cost_burst` + `cost_buckling`; `tip_error_mm`, `distance_to_go_mm`,
    `wall_force_n` (sum), `wall_force_max_n` (one section), `tip_force_n`, `contact_count`, `penetration_mm`, `time_s`,
    `everted_length_mm`, `catheter_length_mm`, `pressure_kpa`, `tendon_pull_mm`; `path_ratio` = (way of the tip so far
    + way to go) / way to go at the start; `anatomy`, `anatomy_family`, `anatomy_index`, `target_index`;
    `reward/<term>`.

    ## Arguments of ``gymnasium.make``

    - ``family`` ("train"), ``pool_size`` (64): family of ducts, and how many of its indices episodes are drawn from.
    - ``reward`` (None): weights by name, such as ``{"success": 10.0}``.
    - ``render_mode`` (None): or "rgb_array"; ``view`` ("outside"): what ``render()`` shows, "outside", "endoscope" or
      "map"; ``width``, ``height`` (None: 480 x 360, endoscope 240 x 240): of its picture, in pixels.
    - the fields of ``EpisodeSettings``: ``model``, ``control_step_s`` (0.25), ``time_limit_s`` (300),
      ``everted_length_mm`` (10), ``localisation_noise_mm`` (0), ``hide_map`` (False), ``model_randomisation`` (0; 1
      draws each model parameter from its uncertainty at every reset), ``success_distance_mm`` (5),
      ``wall_force_limit_n``, ``perforation_depth_mm``, ``observation`` ("state"; or "state+image").

    ## Options of ``reset``

    ``family``, ``index``, ``target`` (number of the duct's target), ``everted_length_mm``; or ``duct``: a ``Duct`` or
    the path of a mesh in millimetres (or of a ``duct.toml`` that names one and places it) instead of family and
    index. Unknown keys raise ``ConfigError``.

    ## Versions

    - v0: first version.
    """

    terms: ClassVar[tuple[ObservationTerm, ...]] = DUCT_TERMS
    option_names: ClassVar[tuple[str, ...]] = ("duct", "everted_length_mm", "family", "index", "target")

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
        names = {field.name for field in dataclasses.fields(EpisodeSettings)}
        check_keys(settings, names, where="the environment's arguments")
        check_choice(family, FAMILIES, "family")
        check_index(pool_size, "pool_size", 1)
        self.family = family
        self.pool_size = pool_size
        picture = PictureSettings(view=view, width=width, height=height)
        super().__init__(EpisodeSettings(**settings), reward, render_mode, picture)

    def _select(self, options: Mapping[str, Any]) -> tuple[World, dict[str, Any], Any]:
        """Choose duct and target: from the options where given, else drawn."""
        if "duct" in options:
            for key in ("family", "index"):
                if key in options:
                    raise ConfigError(
                        f"options has both 'duct' and {key!r}. Give either a duct or a family and an index."
                    )
            duct, world = self._place_duct(options["duct"])
            family, index = str(duct.metadata.get("family", "")), int(duct.metadata.get("index", -1))
        else:
            family = options.get("family", self.family)
            check_choice(family, FAMILIES, "options['family']")
            index = options["index"] if "index" in options else int(self.np_random.integers(self.pool_size))
            check_index(index, "options['index']", 0)
            duct, world = _build_place(family, index)
        count = len(duct.targets)
        target = options["target"] if "target" in options else int(self.np_random.integers(count))
        check_index(target, "options['target']", 0)
        if target >= count:
            raise ConfigError(f"options['target'] is {target}; duct {duct.name!r} has targets 0..{count - 1}.")
        _check_fit(duct, target, self.model.robot.sheath_outer_diameter_mm * MM)
        self.duct = duct
        self.target_index = target
        anatomy = {
            "anatomy": duct.name,
            "anatomy_family": family,
            "anatomy_index": index,
            "target_index": target,
        }
        return world, anatomy, duct

    def _place_duct(self, given: Any) -> tuple[Duct, World]:
        """Return a user's duct, given as an object or as a file, and its world."""
        if isinstance(given, str | Path):
            path = Path(given)
            modified = path.stat().st_mtime_ns if path.exists() else 0
            return _load_place(path, modified, self.model.robot.sheath_outer_diameter_mm * MM)
        if not isinstance(given, Duct):
            raise ConfigError(
                f"options['duct'] is a {type(given).__name__}; it must be a Duct or the path of a mesh file."
            )
        if self._world is not None and given is self.duct:
            return given, self._world
        return given, World.duct(given)

    def _start_path(self) -> NDArray[np.float64]:
        """Return the way to the selected target [m], shape (k, 3), along which the robot is laid at the start."""
        line = self.duct.centreline
        return line.position[line.path_to(self.duct.targets[self.target_index].node)]

    def _make_route(self, start: NDArray[np.float64]) -> LumenRoute:
        """Return the way to the selected target for a tip at ``start`` [m]."""
        return LumenRoute(self.duct.centreline, self.duct.targets[self.target_index].node, start)


@lru_cache(maxsize=128)
def _build_place(family: str, index: int) -> tuple[Duct, World]:
    """Return a generated duct and its world; kept, since an episode's start must not cost a second."""
    duct = generate_duct(family, index)
    return duct, World.duct(duct)


@lru_cache(maxsize=4)
def _load_place(path: Path, modified: int, robot_diameter: float) -> tuple[Duct, World]:
    """Return a user's duct and its world; ``modified`` is the file's time, so that an edited file is read again."""
    del modified
    duct = load_duct(path, robot_outer_diameter=robot_diameter)
    return duct, World.duct(duct)


def _check_fit(duct: Duct, target: int, robot_diameter: float) -> None:
    """Raise ``GeometryError`` where the way to a target is narrower than the robot."""
    way = duct.centreline.path_to(duct.targets[target].node)
    narrowest = int(way[np.argmin(duct.centreline.radius[way])])
    lumen_diameter = 2.0 * float(duct.centreline.radius[narrowest])
    if lumen_diameter < robot_diameter:
        raise GeometryError(
            f"The robot does not fit duct {duct.name!r} at station {duct.centreline.station[narrowest] / MM:.1f} mm: "
            f"its outer diameter is {robot_diameter / MM:.2f} mm, the lumen is {lumen_diameter / MM:.2f} mm. Choose a "
            "smaller sheath, another target or a wider duct."
        )
