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

Array = NDArray[np.float64]

SIZE = (480, 360)
"""Width and height of a frame in pixels."""
FORCE_LENGTH = 20 * MM
"""Length that a contact force of one newton is drawn with [m/N]."""
CONTACT_LENGTH = 1 * MM
"""Length that is added to it, so that a light touch is seen as well [m]."""
PEG_REACH = 6 * MM
"""How far pegs are drawn above and below the port [m]; they have no ends."""

_COLOUR = {
    "background": "#ffffff",
    "wall": "#e07a7a",
    "peg": "#9aa3b0",
    "sheath": "#4dabf7",
    "catheter": "#2b3038",
    "target": "#2f9e44",
    "way": "#2f9e44",
    "contact": "#e8590c",
}
_SIDES = 16
_ANGLE = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)


class Renderer:
    """Draws the current state; the place is built once per episode, the robot anew for each frame.

    PyVista is imported here and not with the module: it costs a second that a training process need not pay.
    """

    def __init__(self, size: tuple[int, int] = SIZE) -> None:
        import pyvista
        from vtkmodules.vtkCommonCore import vtkLogger

        # Without a display VTK tries X before EGL and warns of it, although all is well.
        verbosity = vtkLogger.GetCurrentVerbosityCutoff()
        vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
        plotter: Any = pyvista.Plotter(off_screen=True, window_size=list(size), lighting="none")
        # Several lights and multisampling would double the time on a machine without a GPU.
        plotter.add_light(pyvista.Light(light_type="headlight"))
        plotter.render_window.SetMultiSamples(0)
        plotter.background_color = _COLOUR["background"]
        plotter.render()
        vtkLogger.SetStderrVerbosity(verbosity)
        self._pyvista: Any = pyvista
        self._plotter = plotter
        self._aspect = size[0] / size[1]
        self._scene: Any = None
        self._target: tuple[float, float, float] | None = None
        self._meshes: dict[str, Any] = {}

    def draw(self, scene: Any, target: tuple[float, float, float], simulator: Simulator) -> NDArray[np.uint8]:
        """Return the frame, shape (height, width, 3).

        Args:
            scene: The ``Duct`` or ``PegField``.
            target: The target [m].
            simulator: Gives shape and contacts.
        """
        if self._scene is not scene or self._target != target:
            self._plotter.clear_actors()
            self._meshes.clear()
            self._add_place(scene, target)
            self._scene, self._target = scene, target
        self._update_robot(simulator)
        self._plotter.renderer.ResetCameraClippingRange()
        self._plotter.render()
        frame: NDArray[np.uint8] = np.array(self._plotter.screenshot(return_img=True), dtype=np.uint8)
        return frame

    def close(self) -> None:
        """Free the window and its memory."""
        self._plotter.close()

    def _add_place(self, scene: Any, target: tuple[float, float, float]) -> None:
        """Add what does not move and aim the camera."""
        if isinstance(scene, Duct):
            wall = self._pyvista.wrap(scene.mesh)
            # Front faces culled: the near half of the wall is left out, the far half is the background of the robot.
            self._add(wall, "wall", opacity=0.35, culling="front")
            self._aim(np.array(wall.bounds).reshape(3, 2), view=(-1.0, 0.35, -0.25), up=(0.0, 1.0, 0.0))
        elif isinstance(scene, PegField):
            self._aim(self._add_pegs(scene), view=(-0.5, 1.0, -0.1), up=(1.0, 0.0, 0.0))
        else:
            raise TypeError(f"There is no picture of a {type(scene).__name__}; draw() takes a Duct or a PegField.")
        self._add(self._pyvista.Sphere(radius=1.5 * MM, center=target), "target")

    def _add_pegs(self, field: PegField) -> Array:
        """Add the pegs and the way among them; return the bounds to show [m], shape (3, 2)."""
        for peg in field.pegs:
            cylinder = self._pyvista.Cylinder(
                center=peg[:3], direction=peg[3:6], radius=peg[6], height=2.0 * PEG_REACH, resolution=48
            )
            self._add(cylinder, "peg", split_sharp_edges=True, opacity=0.65)
        self._add(self._pyvista.lines_from_points(field.way), "way", line_width=1, lighting=False)
        margin = np.array((3 * MM, PEG_REACH, 3 * MM))
        feet = field.pegs[:, :3] * (1.0, 0.0, 1.0)
        reach = np.outer(field.pegs[:, 6], (1.0, 0.0, 1.0))
        corners = np.concatenate([field.way - margin, field.way + margin, feet - reach, feet + reach])
        return np.stack([corners.min(axis=0), corners.max(axis=0)], axis=1)

    def _add(self, mesh: Any, colour: str, **how: Any) -> None:
        """Add a mesh in one of the colours."""
        settings = {"smooth_shading": True, "reset_camera": False, "render": False, "ambient": 0.25, **how}
        self._plotter.add_mesh(mesh, color=_COLOUR[colour], **settings)

    def _aim(self, bounds: Array, view: tuple[float, float, float], up: tuple[float, float, float]) -> None:
        """Look from the side ``view`` at all of ``bounds`` [m], shape (3, 2), without perspective."""
        forward = -np.array(view) / np.linalg.norm(view)
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        above = np.cross(right, forward)
        half = 0.5 * (bounds[:, 1] - bounds[:, 0])
        centre = bounds.mean(axis=1)
        camera = self._plotter.camera
        camera.parallel_projection = True
        self._plotter.camera_position = [centre - 0.5 * forward, centre, up]
        camera.parallel_scale = 1.05 * max(np.abs(above) @ half, np.abs(right) @ half / self._aspect)

    def _update_robot(self, simulator: Simulator) -> None:
        """Give the robot and its contacts their current shapes."""
        shape = simulator.shape()
        robot = simulator.model.robot
        self._update("catheter", *_sweep_tube(shape.position, 0.5 * robot.catheter_outer_diameter_mm * MM))
        points = shape.position[shape.in_sheath]
        self._update("sheath", *_sweep_tube(points, 0.5 * robot.sheath_outer_diameter_mm * MM), opacity=0.45)
        contacts = simulator.contacts()
        size = np.linalg.norm(contacts.force, axis=1, keepdims=True)
        # A force is drawn as it acts on the wall: outwards from where the robot's surface touches it.
        outwards = -contacts.force / np.maximum(size, 1e-12)
        foot = contacts.position + 0.5 * robot.sheath_outer_diameter_mm * MM * outwards
        ends = np.concatenate([foot, foot + (CONTACT_LENGTH + FORCE_LENGTH * size) * outwards])
        count = len(contacts.position)
        lines = np.stack([np.full(count, 2), np.arange(count), np.arange(count) + count], axis=1)
        self._update("contact", ends, lines.ravel(), line_width=4, lighting=False)

    def _update(self, name: str, points: Array, cells: NDArray[np.int64], **how: Any) -> None:
        """Replace the points and cells of a moving mesh, which is added to the picture when first seen."""
        mesh = self._meshes.get(name)
        if mesh is None:
            mesh = self._meshes[name] = self._pyvista.PolyData()
        if len(points) == 0:
            mesh.points, mesh.lines = np.zeros((1, 3)), np.empty(0, dtype=np.int64)
            return
        if name == "contact":
            mesh.points, mesh.lines = points, cells
            mesh.verts = np.empty(0, dtype=np.int64)
        else:
            mesh.points, mesh.faces = points, cells
        if name not in self._plotter.actors:
            settings = {"smooth_shading": True, "reset_camera": False, "render": False, "ambient": 0.25, **how}
            self._plotter.add_mesh(mesh, name=name, color=_COLOUR[name], **settings)


def _sweep_tube(points: Array, radius: float) -> tuple[Array, NDArray[np.int64]]:
    """Return vertices and faces (as PyVista lays them out) of a tube along ``points`` [m], open at its ends."""
    count = len(points)
    if count < 2:
        return np.empty((0, 3)), np.empty(0, dtype=np.int64)
    tangent = np.gradient(points, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    # The frame of least twist: each normal is the last one made perpendicular to the next tangent.
    normal = np.empty_like(points)
    last = np.array((1.0, 0.0, 0.0)) if abs(tangent[0, 0]) < 0.9 else np.array((0.0, 1.0, 0.0))
    for index in range(count):
        last = last - (last @ tangent[index]) * tangent[index]
        last = last / np.linalg.norm(last)
        normal[index] = last
    binormal = np.cross(tangent, normal)
    ring = np.cos(_ANGLE)[None, :, None] * normal[:, None, :] + np.sin(_ANGLE)[None, :, None] * binormal[:, None, :]
    vertices = (points[:, None, :] + radius * ring).reshape(-1, 3)
    around = np.arange(_SIDES)
    beside = (around + 1) % _SIDES
    start = (np.arange(count - 1) * _SIDES)[:, None]
    quads = np.stack([start + around, start + beside, start + beside + _SIDES, start + around + _SIDES], axis=-1)
    faces = np.concatenate([np.full((*quads.shape[:2], 1), 4), quads], axis=-1)
    return vertices, faces.ravel()
