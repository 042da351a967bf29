"""An environment of one's own: reach a point in free space, with everything else as in the peg task.

Importing this module registers "Reach-v0"; so does "reach_env:Reach-v0" as an id, where this file can be imported.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium
import numpy as np

from evergym.duct_models.pegs import PegField
from evergym.envs.pegs import MammobotPegsEnv
from evergym.errors import ConfigError
from evergym.units import MM
from evergym.world import World


class ReachEnv(MammobotPegsEnv):
    """Grow in free space until the tip is within 5 mm of a point.

    Action, observation, reward, end and info are those of ``MammobotPegsEnv``; without pegs, the nearest one is far.

    ## Options of ``reset``

    ``target_mm``: x, y, z of the point, else one is drawn that lies 50 to 70 mm ahead and up to 10 mm beside.
    ``everted_length_mm``. Unknown keys raise ``ConfigError``.

    ## Versions

    - v0: first version.
    """

    option_names: ClassVar[tuple[str, ...]] = ("everted_length_mm", "target_mm")

    def _select(self, options: Mapping[str, Any]) -> tuple[World, dict[str, Any], Any]:
        """Choose the point, and lay a field without pegs around it."""
        if "target_mm" in options:
            target = np.array(options["target_mm"], dtype=float)
            if target.shape != (3,) or not np.isfinite(target).all():
                raise ConfigError(f"options['target_mm'] is {options['target_mm']!r}; it must be three numbers in mm.")
        else:
            # self.np_random only: any other source of chance would break the seed.
            ahead, beside, angle = self.np_random.uniform((50.0, 0.0, 0.0), (70.0, 10.0, 2.0 * math.pi))
            target = np.array([beside * math.cos(angle), beside * math.sin(angle), ahead])
        self.peg_field = PegField(pegs=np.empty((0, 7)), target=target * MM, name="free space")
        anatomy = {"anatomy": "free space", "anatomy_family": "", "anatomy_index": -1, "target_index": 0}
        return World.peg_field(self.peg_field), anatomy, self.peg_field


gymnasium.register(id="Reach-v0", entry_point="reach_env:ReachEnv")
