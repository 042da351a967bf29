"""A picture of a duct from two sides: wall, centreline and targets, drawn off-screen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyvista
from vtkmodules.vtkCommonCore import vtkLogger

from evergym.duct_models.duct import Duct
from evergym.units import MM

__all__ = ["draw_duct"]

SIZE = (1000, 800)


def draw_duct(duct: Duct, path: Path) -> None:
    """Draw a duct as seen along x and along y.

    Args:
        duct: What to draw.
        path: The PNG file.
    """
    # Without a display VTK tries X before it renders off-screen, and warns of it although all is well.
    verbosity = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    plotter = pyvista.Plotter(off_screen=True, shape=(1, 2), window_size=list(SIZE))
    try:
        for column, view in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))):
            plotter.subplot(0, column)
            _add_duct(plotter, duct)
            _look_along(plotter, duct, np.array(view))
            plotter.add_text("seen along " + "xy"[column], font_size=9)
        plotter.screenshot(path)
    finally:
        plotter.close()
        vtkLogger.SetStderrVerbosity(verbosity)


def _add_duct(plotter: Any, duct: Duct) -> None:
    wall = pyvista.make_tri_mesh(duct.mesh.vertices / MM, duct.mesh.faces)
    plotter.add_mesh(wall, color="#e8b0a8", opacity=0.4, smooth_shading=True)
    line = duct.centreline
    way = pyvista.PolyData(line.position / MM)
    nodes = np.arange(1, len(line.position))
    way.lines = np.column_stack([np.full(len(nodes), 2), line.parent[1:], nodes]).ravel()
    plotter.add_mesh(way, color="#2b3038", line_width=2)
    for target in duct.targets:
        plotter.add_mesh(pyvista.Sphere(radius=1.0, center=target.position / MM), color="#2f9e44")
        plotter.add_point_labels(
            target.position[None] / MM,
            [f"{target.station / MM:.0f} mm"],
            font_size=14,
            text_color="black",
            shape=None,
            show_points=False,
            always_visible=True,
        )
    plotter.add_mesh(pyvista.Sphere(radius=1.0, center=(0.0, 0.0, 0.0)), color="#1c7ed6")


def _look_along(plotter: Any, duct: Duct, view: np.ndarray[Any, Any]) -> None:
    lower, upper = duct.mesh.bounds / MM
    centre = 0.5 * (lower + upper)
    plotter.camera_position = [centre + 200.0 * view, centre, (0.0, 0.0, 1.0)]
    plotter.camera.parallel_projection = True
    plotter.camera.parallel_scale = 0.55 * float(max(upper - lower))
