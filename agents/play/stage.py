"""The place and the robot in it on the page's 3-D canvas."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from evergym.agents.play.episode import Frame
from evergym.agents.play.tubes import sweep_rolled_tip, sweep_round_tip, tube_faces
from evergym.duct_models.duct import Duct
from evergym.duct_models.pegs import PegField
from evergym.units import MM

__all__ = ["COLOURS", "PIN_CLEARANCE", "Stage", "find_pin_head"]

Array = NDArray[np.float64]

SCALE = 100.0
"""Canvas units per metre: a unit is a centimetre, which suits the canvas's near plane and camera speed."""
FORCE_LENGTH = 25.0 * MM
"""Length that a contact force of one newton is drawn with [m/N]."""
CONTACT_LENGTH = 2.0 * MM
"""Length that is added to it, so that a light touch is seen as well [m]."""
SIDE_LENGTH = 4.0 * MM
"""Length of the arrow that shows the tendon's side [m]."""
PEG_REACH = 6.0 * MM
"""How far pegs are drawn above and below the port [m]; they have no ends."""

TARGET_RADIUS = 1.6 * MM
"""Of the ball that marks the target [m]."""
PIN_CLEARANCE = 2.5 * MM
"""How far from the wall the head of the target's pin is at least [m]."""

COLOURS = {
    "wall": (226, 121, 128),
    "peg": (140, 150, 166),
    "sheath": (77, 171, 247),
    "catheter": (73, 80, 87),
    "tendon": (245, 159, 0),
    "target": (47, 158, 68),
    "contact": (224, 49, 49),
}
"""The colours of what is on the stage; the legend uses them too."""


class Stage:
    """What is on the canvas.

    Args:
        server: The page's server.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._scene = server.scene
        self._scene.set_up_direction("+y")
        self._scene.world_axes.visible = False
        self._scene.add_light_ambient("/light/all_round", intensity=1.6)
        for name, towards, intensity in (("key", (-1.0, 1.2, -0.6), 2.2), ("fill", (0.4, -0.6, -1.0), 0.8)):
            self._scene.add_light_directional(f"/light/{name}", intensity=intensity, position=towards)
        self._faces = tube_faces()
        self._robot: dict[str, Any] = {}

    def place(self, scene: Duct | PegField, target: tuple[float, float, float], way: Array, frame: Frame) -> None:
        """Build a place with the robot in it, and point the cameras at it."""
        for name in ("/place", "/robot"):
            self._scene.remove_by_name(name)
        if isinstance(scene, Duct):
            bounds = np.asarray(scene.mesh.bounds)
            # The half that faces the viewer is left out: it would hide the translucent sheath behind its depth.
            self._add_wall(scene, "/place/wall", side="back", opacity=0.65)
            view, up = np.array((-1.0, 0.4, -0.45)), (0.0, 1.0, 0.0)
        else:
            bounds = self._add_pegs(scene, way)
            view, up = np.array((-0.55, 1.0, -0.35)), (0.0, 1.0, 0.0)
        self._add_target(scene, target, way)
        self._add_robot(frame)
        self._aim(bounds, view, up)
        self.show(frame)

    def show(self, frame: Frame) -> None:
        """Move the robot; call it within ``server.atomic()`` to have all of it move at once."""
        pose, values = frame.pose, frame.values
        everted, inserted = values["everted_length_mm"] * MM, values["catheter_length_mm"] * MM
        thin = pose.catheter_radius
        robot = self._robot
        robot["sheath"].vertices = _single(sweep_rolled_tip(pose.shape, everted, pose.sheath_radius, thin))
        robot["catheter"].vertices = _single(sweep_round_tip(pose.shape, inserted, thin))
        robot["tendon"].vertices = _single(sweep_round_tip(pose.shape, inserted, thin, offset=thin, thickness=0.22))
        tip = pose.shape.position[-1]
        side = np.array([values[f"tendon_side_{axis}"] for axis in "xyz"])
        foot = tip + pose.sheath_radius * side
        robot["side"].points = _single(np.stack([foot, foot + SIDE_LENGTH * side])[None])
        self._show_contacts(frame)

    def _show_contacts(self, frame: Frame) -> None:
        """Draw forces as they act on the wall: outwards from where the robot's surface touches it."""
        contacts = frame.pose.contacts
        size = np.linalg.norm(contacts.force, axis=1, keepdims=True)
        felt = size[:, 0] > 1e-4
        outwards = -contacts.force[felt] / size[felt]
        foot = contacts.position[felt] + frame.pose.sheath_radius * outwards
        end = foot + (CONTACT_LENGTH + FORCE_LENGTH * size[felt]) * outwards
        handle = self._robot["contact"]
        handle.visible = bool(felt.any())
        if felt.any():
            handle.points = _single(np.stack([foot, end], axis=1))

    def _add_wall(self, duct: Duct, name: str, **how: Any) -> None:
        vertices = _single(np.asarray(duct.mesh.vertices))
        self._scene.add_mesh_simple(
            name,
            vertices,
            np.asarray(duct.mesh.faces),
            color=COLOURS["wall"],
            cast_shadow=False,
            receive_shadow=False,
            **how,
        )

    def _add_pegs(self, field: PegField, way: Array) -> Array:
        """Add pegs on a floor; return the bounds to show [m], shape (2, 3)."""
        quarter = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)  # cylinders stand along the canvas's z, pegs along y
        for number, peg in enumerate(field.pegs):
            self._scene.add_cylinder(
                f"/place/peg_{number}",
                radius=float(peg[6]) * SCALE,
                height=2.0 * PEG_REACH * SCALE,
                color=COLOURS["peg"],
                opacity=0.55,
                wxyz=quarter,
                position=(float(peg[0]) * SCALE, 0.0, float(peg[2]) * SCALE),
                cast_shadow=False,
            )
        feet = field.pegs[:, :3] * (1.0, 0.0, 1.0)
        reach = np.outer(field.pegs[:, 6], (1.0, 0.0, 1.0)) + np.array((0.0, PEG_REACH, 0.0))
        corners = np.concatenate([way, feet - reach, feet + reach])
        return np.stack([corners.min(axis=0), corners.max(axis=0)])

    def _add_target(self, scene: Duct | PegField, target: tuple[float, float, float], way: Array) -> None:
        """Add a ball; in a duct with a pin, since a wall in front of it would tint the ball beyond recognition."""
        foot = np.array(target)
        head = find_pin_head(scene, foot) if isinstance(scene, Duct) else foot
        how: dict[str, Any] = {"color": COLOURS["target"], "cast_shadow": False, "receive_shadow": False}
        self._scene.add_icosphere("/place/target", radius=TARGET_RADIUS * SCALE, position=foot * SCALE, **how)
        if head[1] > foot[1]:
            pin = _single(np.stack([foot, head])[None])
            self._scene.add_line_segments("/place/pin", pin, colors=COLOURS["target"], thickness=0.05)
            self._scene.add_icosphere("/place/pin_head", radius=TARGET_RADIUS * SCALE, position=head * SCALE, **how)
        self._scene.add_label(
            "/place/target_label", "target", position=head * SCALE + np.array((0.0, 0.25, 0.0)), anchor="bottom-center"
        )
        self._scene.add_label("/place/port_label", "port", position=(0.0, -0.35, 0.0), anchor="top-center")
        line = np.stack([way[:-1], way[1:]], axis=1)
        self._scene.add_line_segments("/place/way", _single(line), colors=COLOURS["target"], thickness=0.04)

    def _add_robot(self, frame: Frame) -> None:
        """Add the robot's parts, still without their shapes: `show` gives them these."""
        still = _single(sweep_round_tip(frame.pose.shape, 1 * MM, 0.1 * MM))
        how: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}
        for name, opacity in (("catheter", None), ("tendon", None), ("sheath", 0.55)):
            self._robot[name] = self._scene.add_mesh_simple(
                f"/robot/{name}", still, self._faces, color=COLOURS[name], opacity=opacity, **how
            )
        nowhere = np.zeros((1, 2, 3), dtype=np.float32)
        for name, colour in (("side", "tendon"), ("contact", "contact")):
            self._robot[name] = self._scene.add_arrows(
                f"/robot/{name}",
                nowhere,
                COLOURS[colour],
                shaft_radius=0.25 * MM * SCALE,
                head_radius=0.7 * MM * SCALE,
                head_length=1.2 * MM * SCALE,
            )

    def _aim(self, bounds: Array, view: Array, up: tuple[float, float, float]) -> None:
        """Look from the side ``view`` at all of ``bounds`` [m], shape (2, 3); also the pages that are open already."""
        centre = bounds.mean(axis=0) * SCALE
        distance = 1.6 * float(np.linalg.norm(bounds[1] - bounds[0])) * SCALE
        eye = centre + distance * view / np.linalg.norm(view)
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.up, camera.fov = tuple(eye), tuple(centre), up, np.radians(45.0)
        for client in self._server.get_clients().values():
            client.camera.position, client.camera.look_at = eye, centre
            client.camera.fov = np.radians(45.0)


def find_pin_head(duct: Duct, target: Array) -> Array:
    """Return the lowest place straight above the target that is clear of the duct's wall [m], shape (3,)."""
    line = duct.centreline
    heads = target + np.outer(np.arange(1.0, 60.0) * MM, (0.0, 1.0, 0.0))
    room = np.linalg.norm(heads[:, None] - np.asarray(line.position)[None], axis=2) - np.asarray(line.radius)
    clear = room.min(axis=1) >= PIN_CLEARANCE
    head: Array = heads[int(np.argmax(clear))] if clear.any() else heads[-1]
    return head


def _single(points: Array) -> NDArray[np.float32]:
    """Return points [m] in canvas units and single precision."""
    return (points * SCALE).astype(np.float32)
