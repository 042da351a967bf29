"""What a picture needs of a robot: its shape and its contacts, read from a simulator or kept from an episode."""

from __future__ import annotations

from typing import NamedTuple

from evergym.simulator import Contacts, Shape, Simulator
from evergym.units import MM

__all__ = ["Pose", "read_pose"]


class Pose(NamedTuple):
    """A robot as pictures show it; it can be stored and drawn long after the simulator has moved on."""

    shape: Shape
    contacts: Contacts
    sheath_radius: float
    """Outer radius [m]."""
    catheter_radius: float
    """Outer radius [m]."""


def read_pose(robot: Simulator | Pose) -> Pose:
    """Return the pose of a simulator now; a pose is returned as it is."""
    if isinstance(robot, Pose):
        return robot
    data = robot.model.robot
    return Pose(
        shape=robot.shape(),
        contacts=robot.contacts(),
        sheath_radius=0.5 * data.sheath_outer_diameter_mm * MM,
        catheter_radius=0.5 * data.catheter_outer_diameter_mm * MM,
    )
