"""What surrounds the robot: nothing, a duct's wall, or pegs; and gravity."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evergym.duct_models.field import WallField
from evergym.state import WorldParameters

if TYPE_CHECKING:
    from evergym.duct_models.duct import Duct
    from evergym.duct_models.pegs import PegField

__all__ = ["GRAVITY", "World"]

GRAVITY = (0.0, -9.81, 0.0)
"""Gravity across the insertion [m/s^2], as on the bench."""


def _create_empty_field() -> WallField:
    return WallField(np.zeros((3, 3, 3)), np.zeros(3), np.ones(1))


@dataclass(frozen=True)
class World:
    """A robot's surroundings; the port is at the origin and faces +z unless ``port_frame`` says otherwise.

    Attributes:
        wall: Signed distance to the wall of a duct, or None.
        pegs: Rigid pegs, shape (k, 7), as `evergym.duct_models.pegs.PegField.pegs`.
        gravity: [m/s^2], shape (3,).
        port_frame: Columns x, y and insertion direction of the port, shape (3, 3).
    """

    wall: WallField | None = None
    pegs: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7)))
    gravity: NDArray[np.float64] = field(default_factory=lambda: np.array(GRAVITY))
    port_frame: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))

    @classmethod
    def free(cls, gravity: ArrayLike = GRAVITY, port_frame: ArrayLike | None = None) -> World:
        """Return free space."""
        frame = np.eye(3) if port_frame is None else np.array(port_frame, dtype=np.float64)
        return cls(gravity=np.array(gravity, dtype=np.float64), port_frame=frame)

    @classmethod
    def duct(cls, duct: Duct, gravity: ArrayLike = GRAVITY) -> World:
        """Return the inside of a duct."""
        return cls(wall=duct.field, gravity=np.array(gravity, dtype=np.float64))

    @classmethod
    def peg_field(cls, pegs: PegField, gravity: ArrayLike = GRAVITY) -> World:
        """Return a field of rigid pegs."""
        return cls(pegs=np.ascontiguousarray(pegs.pegs, dtype=np.float64), gravity=np.array(gravity, dtype=np.float64))

    def compile(self) -> WorldParameters:
        """Return the kernels' view of the world."""
        return WorldParameters(
            wall=self.wall if self.wall is not None else _create_empty_field(),
            has_wall=self.wall is not None,
            pegs=np.ascontiguousarray(self.pegs, dtype=np.float64),
            gravity=np.ascontiguousarray(self.gravity, dtype=np.float64),
            port_frame=np.ascontiguousarray(self.port_frame, dtype=np.float64),
        )
