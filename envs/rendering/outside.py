"""The view from outside: a translucent wall or pegs, sheath, catheter, tendon side, target and contacts, by PyVista."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from evergym.duct_models.duct import Duct
from evergym.duct_models.pegs import PegField
from evergym.envs.rendering.pose import Pose, read_pose
from evergym.envs.rendering.side import PEG_REACH, choose_side, fit_scale, list_corners
from evergym.envs.rendering.solids import Solid, make_arrows, sweep_tube
from evergym.envs.rendering.writing import draw_scale_bar, find_legend_height, write_caption, write_legend
from evergym.simulator import Simulator
from evergym.units import DEG, MM

__all__ = ["COLOURS", "CONTACT_LENGTH", "FORCE_LENGTH", "OUTSIDE_SIZE", "OutsideView"]

Array = NDArray[np.float64]

OUTSIDE_SIZE = (480, 360)
"""Width and height of the picture in pixels."""
FORCE_LENGTH = 20 * MM
"""Length that a contact force of one newton is drawn with [m/N]."""
CONTACT_LENGTH = 1.5 * MM
"""Length that is added to it, so that a light touch is seen as well [m]."""
COLOURS = {
    "duct wall": "#e8a79c",
    "pegs": "#9aa3b0",
    "sheath": "#3b8fd9",
    "catheter": "#343a40",
    "tendon side": "#ffd43b",
    "target": "#2b9e54",
    "contact force": "#d9480f",
}
"""The colour of each thing; blue, yellow, orange and green of different brightness, for all eyes."""

_BACKGROUND = "#ffffff"
_TURN = -10.0 * DEG  # how far the camera is turned towards the port: depth is seen, and little is hidden
_TILT_DUCT = 22.0 * DEG  # and upwards
_TILT_PEGS = 12.0 * DEG
_TENDON_RADIUS = 0.13 * MM
_TARGET_RADIUS = 1.5 * MM
_PORT_RADIUS = 4.0 * MM
_BORDER = 0.06
_MULTISAMPLES = 8


class OutsideView:
    """Draws the place once and the robot anew for each frame; parallel projection, so lengths can be compared.

    PyVista is imported here and not with the module: it costs a second that a training process need not pay.

    Args:
        scene: The duct or the pegs; None: free space.
        target: Shown as a green ball [m]; None: no target.
        size: Width and height in pixels.
        legend: Whether the colours are explained in the picture.
    """

    def __init__(
        self,
        scene: Duct | PegField | None,
        target: tuple[float, float, float] | None = None,
        size: tuple[int, int] = OUTSIDE_SIZE,
        *,
        legend: bool = False,
    ) -> None:
        import pyvista
        from vtkmodules.vtkCommonCore import vtkLogger

        # Without a display VTK tries X before EGL and warns of it, although all is well.
        verbosity = vtkLogger.GetCurrentVerbosityCutoff()
        vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
        plotter: Any = pyvista.Plotter(off_screen=True, window_size=list(size), lighting="none")
        # One light: each costs as much again on a machine without a GPU. It stands above the camera's left shoulder.
        plotter.add_light(pyvista.Light(light_type="camera light", position=(-0.4, 0.7, 1.0), focal_point=(0, 0, 0)))
        plotter.render_window.SetMultiSamples(_MULTISAMPLES)
        plotter.background_color = _BACKGROUND
        plotter.render()
        vtkLogger.SetStderrVerbosity(verbosity)
        self.size = size
        self._legend = legend
        self._strip = find_legend_height(size) if legend else 0
        self._pyvista: Any = pyvista
        self._plotter = plotter
        self._scene: object = self
        self._target: tuple[float, float, float] | None = None
        self.place(scene, target)

    def place(self, scene: Duct | PegField | None, target: tuple[float, float, float] | None) -> None:
        """Show another place, or another target [m] in it; costs nothing if both are those shown already."""
        if scene is self._scene and target == self._target:
            return
        self._plotter.clear_actors()
        self._aim(scene)
        # VTK draws translucent things in the order in which they are added: from back to front.
        self._actors: dict[str, Any] = {}
        if isinstance(scene, Duct):
            self._add_wall(scene, front=False)
        elif isinstance(scene, PegField):
            self._add_pegs(scene)
        else:
            ring = self._pyvista.Disc(inner=0.5 * _PORT_RADIUS, outer=_PORT_RADIUS, c_res=48)
            self._plotter.add_mesh(ring, color=COLOURS["pegs"], reset_camera=False, render=False)
        if target is not None:
            ball = self._pyvista.Sphere(radius=_TARGET_RADIUS, center=target, theta_resolution=36, phi_resolution=36)
            self._add(ball, "target", specular=0.3)
        for name in ("catheter", "tendon side", "contact force", "sheath"):
            self._actors[name] = self._add(
                self._pyvista.Sphere(radius=1e-9), name, specular=0.25, rgba=name == "sheath"
            )
        if isinstance(scene, Duct):
            self._add_wall(scene, front=True)
        self._scene, self._target = scene, target

    def frame(self, robot: Simulator | Pose, caption: str = "") -> NDArray[np.uint8]:
        """Return a fresh picture, shape (height, width, 3), with the caption in its upper left corner."""
        self._update_robot(read_pose(robot))
        self._plotter.renderer.ResetCameraClippingRange()
        self._plotter.render()
        image: NDArray[np.uint8] = np.array(self._plotter.screenshot(return_img=True), dtype=np.uint8)
        image = draw_scale_bar(image, self._pixels, above=self._strip)
        if self._legend:
            names = [name for name in COLOURS if name not in ("duct wall", "pegs")]
            place = {Duct: ["duct wall"], PegField: ["pegs"]}.get(type(self._scene), [])
            image = write_legend(image, {name: COLOURS[name] for name in (*place, *names)})
        return write_caption(image, caption) if caption else image

    def close(self) -> None:
        """Free the window and its memory; it can be closed more than once."""
        self._plotter.close()

    def _aim(self, scene: Duct | PegField | None) -> None:
        """Look at the whole place from its widest side, somewhat from above, without perspective."""
        right, down = choose_side(scene)
        towards = np.cross(right, -down)  # from the place to the camera
        tilt, turn = _TILT_PEGS if isinstance(scene, PegField) else _TILT_DUCT, _TURN
        up = np.cos(tilt) * -down - np.sin(tilt) * towards
        towards = np.cos(tilt) * towards - np.sin(tilt) * down
        side = np.cos(turn) * right + np.sin(turn) * towards
        towards = np.cos(turn) * towards - np.sin(turn) * right
        corners = list_corners(scene, margin=3 * MM)
        axes = np.stack([side, -up])
        free = (self.size[0], self.size[1] - self._strip)
        self._pixels, middle = fit_scale(corners, axes, free, round(_BORDER * min(self.size)))
        middle[1] += 0.5 * self._strip / self._pixels
        self._towards = towards
        centre = middle @ axes + (np.mean(corners, axis=0) @ towards) * towards
        camera = self._plotter.camera
        camera.parallel_projection = True
        self._plotter.camera_position = [centre + 0.5 * towards, centre, up]
        camera.parallel_scale = 0.5 * self.size[1] / self._pixels

    def _add_wall(self, duct: Duct, *, front: bool) -> None:
        """Add the half of the wall that faces away from the camera, or the one that faces it.

        Where a translucent wall is seen edge on, more of it lies in the line of sight: so it gets its outline.
        """
        mesh = duct.mesh
        vertex, normal = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.vertex_normals)
        wall = self._pyvista.make_tri_mesh(vertex, np.asarray(mesh.faces))
        wall.point_data["rgba"] = self._tint("duct wall", normal, (0.05, 0.6) if front else (0.35, 0.6))
        wall.point_data["Normals"] = normal.astype(np.float32)
        culling, gloss = ("back", 0.15) if front else ("front", 0.0)
        self._add(wall, "duct wall", rgba=True, culling=culling, ambient=0.45, diffuse=0.6, specular=gloss)

    def _add_pegs(self, field: PegField) -> None:
        """Add the pegs and the way among them."""
        for peg in field.pegs:
            foot = peg[:3] - (peg[1] * peg[4]) * peg[3:6]
            cylinder = self._pyvista.Cylinder(
                center=foot, direction=peg[3:6], radius=peg[6], height=2.0 * PEG_REACH, resolution=64
            )
            self._add(cylinder, "pegs", split_sharp_edges=True, opacity=0.6, culling="back")
        self._add(self._pyvista.lines_from_points(field.way), "target", line_width=1, lighting=False)

    def _add(self, mesh: Any, colour: str, *, rgba: bool = False, **how: Any) -> Any:
        """Add a mesh in one of the colours, or with those of its vertices; return the actor."""
        settings = {"smooth_shading": True, "reset_camera": False, "render": False, "ambient": 0.3, "diffuse": 0.75}
        settings |= {"specular_power": 30.0, **how}
        if rgba:
            if "rgba" not in mesh.point_data:
                mesh.point_data["rgba"] = np.zeros((mesh.n_points, 4), dtype=np.uint8)
            return self._plotter.add_mesh(mesh, scalars="rgba", rgba=True, **settings)
        return self._plotter.add_mesh(mesh, color=COLOURS[colour], **settings)

    def _tint(self, colour: str, normal: Array, opacity: tuple[float, float]) -> NDArray[np.uint8]:
        """Return a colour per vertex whose opacity goes from face on to edge on, shape (n, 4)."""
        edge = 1.0 - np.abs(normal @ self._towards)
        share = edge**2.5
        tint = np.empty((len(normal), 4), dtype=np.uint8)
        plain = np.array([int(COLOURS[colour][k : k + 2], 16) for k in (1, 3, 5)], dtype=np.float64)
        tint[:, :3] = plain * (1.0 - 0.3 * share[:, None])
        tint[:, 3] = 255.0 * (opacity[0] + (opacity[1] - opacity[0]) * share)
        return tint

    def _update_robot(self, pose: Pose) -> None:
        """Give the robot and its contacts their current shapes."""
        shape = pose.shape
        self._update("catheter", sweep_tube(shape.position, pose.catheter_radius, capped=True))
        side = shape.position + pose.catheter_radius * shape.catheter_direction
        self._update("tendon side", sweep_tube(side, _TENDON_RADIUS))
        self._update("sheath", sweep_tube(shape.position[shape.in_sheath], pose.sheath_radius, capped=True))
        size = np.linalg.norm(pose.contacts.force, axis=1)
        # A force is drawn as it acts on the wall: outwards from where the robot's surface touches it.
        outwards = -pose.contacts.force / np.maximum(size, 1e-12)[:, None]
        foot = pose.contacts.position + pose.sheath_radius * outwards
        self._update("contact force", make_arrows(foot, outwards, CONTACT_LENGTH + FORCE_LENGTH * size))

    def _update(self, name: str, solid: Solid) -> None:
        """Replace the surface of something that moves."""
        actor = self._actors[name]
        actor.visibility = len(solid.vertex) > 0
        if len(solid.vertex) == 0:
            return
        mesh = self._pyvista.make_tri_mesh(solid.vertex, solid.face)
        mesh.point_data.active_normals = solid.normal.astype(np.float32)
        if name == "sheath":
            mesh.point_data["rgba"] = self._tint(name, solid.normal, (0.34, 0.9))
            mesh.set_active_scalars("rgba")
        actor.mapper.SetInputData(mesh)
