"""Frames without a display: duct or pegs, sheath, catheter, target and contacts, drawn off-screen by PyVista."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from evergym.duct_models.duct import Duct
from evergym.duct_models.pegs import PegField
from evergym.simulator import Simulator
from evergym.units import MM

__all__ = ["Renderer"]

SIZE = (480, 360)
"""Width and height of a frame in pixels."""
FORCE_LENGTH = 20 * MM
"""Length that a contact force of one newton is drawn with [m/N]."""

_COLOUR = {
    "background": "#ffffff",
    "wall": "#e8a0a0",
    "peg": "#8a8f98",
    "sheath": "#7db8e8",
    "catheter": "#3a3f4b",
    "target": "#2f9e44",
    "contact": "#d9480f",
}


class Renderer:
    """Draws the current state; the place is built once per episode, the robot anew for each frame.

    PyVista is imported here and not with the module: it costs a second that a training process need not pay.
    """

    def __init__(self, size: tuple[int, int] = SIZE) -> None:
        import pyvista

        self._pyvista: Any = pyvista
        self._plotter: Any = pyvista.Plotter(off_screen=True, window_size=list(size), lighting="light kit")
        self._plotter.background_color = _COLOUR["background"]
        self._scene: Any = None

    def forget_scene(self) -> None:
        """Build the place anew at the next frame, since the target may have changed."""
        self._scene = None

    def draw(self, scene: Any, target: tuple[float, float, float], simulator: Simulator) -> NDArray[np.uint8]:
        """Return the frame, shape (height, width, 3).

        Args:
            scene: The ``Duct`` or ``PegField``.
            target: The target [m].
            simulator: Gives shape and contacts.
        """
        plotter = self._plotter
        if self._scene is not scene:
            plotter.clear_actors()
            self._add_place(scene, target)
            self._scene = scene
        self._add_robot(simulator)
        plotter.render()
        frame: NDArray[np.uint8] = np.array(plotter.screenshot(return_img=True), dtype=np.uint8)
        return frame

    def close(self) -> None:
        """Free the window and its memory."""
        self._plotter.close()

    def _add_place(self, scene: Any, target: tuple[float, float, float]) -> None:
        """Add what does not move and aim the camera."""
        pyvista, plotter = self._pyvista, self._plotter
        if isinstance(scene, Duct):
            wall = pyvista.wrap(scene.mesh)
            plotter.add_mesh(wall, color=_COLOUR["wall"], opacity=0.25, smooth_shading=True, culling="front")
            bounds = np.array(wall.bounds).reshape(3, 2)
            view, up = (-1.0, 0.45, -0.25), (0.0, 1.0, 0.0)
        elif isinstance(scene, PegField):
            bounds = self._add_pegs(scene)
            view, up = (-0.35, 1.0, 0.0), (1.0, 0.0, 0.0)
        else:
            raise TypeError(f"There is no picture of a {type(scene).__name__}; draw() takes a Duct or a PegField.")
        plotter.add_mesh(pyvista.Sphere(radius=1.5 * MM, center=target), color=_COLOUR["target"])
        low, high = bounds[:, 0], bounds[:, 1]
        centre = 0.5 * (low + high)
        plotter.camera.parallel_projection = True
        plotter.camera_position = [centre + 0.5 * np.array(view), centre, up]
        across = np.cross(view, up)
        width = np.abs(across / np.linalg.norm(across)) @ (high - low)
        height = np.abs(np.array(up)) @ (high - low) + 0.3 * np.min(high - low)
        plotter.camera.parallel_scale = 0.53 * max(height, width * SIZE[1] / SIZE[0])
        plotter.reset_camera_clipping_range()

    def _add_pegs(self, field: PegField) -> NDArray[np.float64]:
        """Add the pegs and return the bounds to show [m], shape (3, 2)."""
        reach = 12 * MM
        for peg in field.pegs:
            cylinder = self._pyvista.Cylinder(center=peg[:3], direction=peg[3:6], radius=peg[6], height=2 * reach)
            self._plotter.add_mesh(cylinder, color=_COLOUR["peg"], smooth_shading=True, split_sharp_edges=True)
        way = field.way
        low = np.minimum(way.min(axis=0), (field.pegs[:, :3] - field.pegs[:, 6:]).min(axis=0)) - 3 * MM
        high = np.maximum(way.max(axis=0), (field.pegs[:, :3] + field.pegs[:, 6:]).max(axis=0)) + 3 * MM
        return np.stack(
            [np.minimum(low, -reach * np.array([0, 1, 0])), np.maximum(high, reach * np.array([0, 1, 0]))], axis=1
        )

    def _add_robot(self, simulator: Simulator) -> None:
        """Replace the robot and its contacts by their current shapes."""
        shape = simulator.shape()
        robot = simulator.model.robot
        self._add_tube("catheter", shape.position, 0.5 * robot.catheter_outer_diameter_mm * MM, 1.0)
        self._add_tube("sheath", shape.position[shape.in_sheath], 0.5 * robot.sheath_outer_diameter_mm * MM, 0.55)
        contacts = simulator.contacts()
        if len(contacts.position) == 0:
            self._plotter.remove_actor("contact", render=False)
            return
        points = np.empty((2 * len(contacts.position), 3))
        points[0::2] = contacts.position
        points[1::2] = contacts.position + FORCE_LENGTH * contacts.force
        lines = self._pyvista.line_segments_from_points(points)
        self._plotter.add_mesh(
            lines,
            name="contact",
            color=_COLOUR["contact"],
            line_width=4,
            lighting=False,
            render=False,
            reset_camera=False,
            show_scalar_bar=False,
        )

    def _add_tube(self, name: str, points: NDArray[np.float64], radius: float, opacity: float) -> None:
        """Replace the tube called ``name``; fewer than two points show nothing."""
        if len(points) < 2:
            self._plotter.remove_actor(name, render=False)
            return
        tube = self._pyvista.lines_from_points(points).tube(radius=radius, n_sides=16, capping=True)
        self._plotter.add_mesh(
            tube, name=name, color=_COLOUR[name], opacity=opacity, smooth_shading=True, render=False, reset_camera=False
        )
