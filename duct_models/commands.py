"""The commands ``evergym duct make | check | show``: one dataclass each; its fields are the options."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import tomli_w
import trimesh
from tyro.conf import Positional

from evergym.duct_models.check import check_duct, format_report
from evergym.duct_models.duct import Duct, generate_duct
from evergym.duct_models.family import find_family
from evergym.duct_models.importer import load_duct
from evergym.errors import ConfigError, GeometryError
from evergym.units import DEG, MM

__all__ = ["DuctCheck", "DuctMake", "DuctShow"]

_GENERATED = re.compile(r"(?P<family>\w+):(?P<index>\d+)")


@dataclass(frozen=True)
class DuctMake:
    """Write procedural ducts as files: wall mesh (mm), centreline table, and a duct.toml that loads them again."""

    family: str = "train"
    """Family to draw from: train, held_out, wide_angle, narrow, deep, true_scale_train or true_scale_held_out."""
    index: int = 0
    """First duct of the family."""
    count: int = 1
    """How many ducts."""
    out: Path = Path("ducts")
    """Folder in which each duct gets a folder of its own."""
    mesh_format: str = "ply"
    """Format of the mesh: ply, stl, obj or glb."""
    overwrite: bool = False
    """Write over files that are there already."""

    def run(self) -> int:
        """Write the files and name them.

        Raises:
            ConfigError: An option is not usable, or a file is there already.
        """
        find_family(self.family)
        if self.mesh_format not in ("ply", "stl", "obj", "glb"):
            raise ConfigError(f"A mesh cannot be written as '{self.mesh_format}'. Choose ply, stl, obj or glb.")
        if self.count < 1:
            raise ConfigError(f"The count must be 1 or more: got {self.count}.")
        for index in range(self.index, self.index + self.count):
            print(write_duct(generate_duct(self.family, index), self.out, self.mesh_format, self.overwrite))
        return 0


@dataclass(frozen=True)
class DuctCheck:
    """Check that a duct's wall is closed and that a robot fits on the way to every target."""

    duct: Positional[str]
    """A mesh file, a duct.toml, or family:index such as held_out:3."""
    robot_diameter_mm: float | None = None
    """Outer diameter of the robot; by default the one that the duct is made for."""
    scale: float | None = None
    """Factor on a mesh's coordinates."""
    unit: str | None = None
    """Unit of a mesh's coordinates: m, cm, mm (default), um or inch."""

    def run(self) -> int:
        """Print what was measured; a duct that is not usable raises GeometryError."""
        duct = open_duct(self.duct, self.robot_diameter_mm, self.scale, self.unit)
        diameter_mm = self.robot_diameter_mm
        if diameter_mm is None:
            diameter_mm = float(duct.metadata.get("robot_diameter_mm", 3.0))
        print(format_report(check_duct(duct, diameter_mm * MM)))
        for reason in duct.metadata.get("unreachable", ()):
            print(f"no target: {reason}")
        return 0


@dataclass(frozen=True)
class DuctShow:
    """Draw a duct with its centreline and targets, without a display, into a PNG file."""

    duct: Positional[str]
    """A mesh file, a duct.toml, or family:index such as held_out:3."""
    out: Path = Path("duct.png")
    """The picture."""
    scale: float | None = None
    """Factor on a mesh's coordinates."""
    unit: str | None = None
    """Unit of a mesh's coordinates: m, cm, mm (default), um or inch."""
    overwrite: bool = False
    """Write over a picture that is there already."""

    def run(self) -> int:
        """Draw and name the picture.

        Raises:
            ConfigError: The picture is there already, or its folder is not, or it is no PNG.
        """
        if self.out.suffix.lower() != ".png":
            raise ConfigError(f"The picture must be a .png file: got '{self.out}'.")
        if not self.out.parent.is_dir():
            raise ConfigError(f"There is no folder '{self.out.parent}' for the picture.")
        _refuse_to_overwrite([self.out], self.overwrite)
        from evergym.duct_models.picture import draw_duct  # PyVista takes a second to load

        draw_duct(open_duct(self.duct, None, self.scale, self.unit), self.out)
        print(self.out)
        return 0


def open_duct(
    text: str, robot_diameter_mm: float | None = None, scale: float | None = None, unit: str | None = None
) -> Duct:
    """The duct that a user names on the command line.

    Args:
        text: Mesh file, duct.toml, or family:index.
        robot_diameter_mm: Must fit a mesh [mm].
        scale: Factor on a mesh's coordinates.
        unit: Of a mesh's coordinates.

    Raises:
        ConfigError: There is no such family.
        GeometryError: The mesh cannot be used, or a scale is given for a generated duct.
    """
    match = _GENERATED.fullmatch(text)
    if match is None or Path(text).exists():
        diameter = None if robot_diameter_mm is None else robot_diameter_mm * MM
        return load_duct(text, scale=scale, unit=unit, robot_outer_diameter=diameter)
    if scale is not None or unit is not None:
        raise GeometryError(f"'{text}' is a generated duct: scale and unit are for meshes of your own.")
    return generate_duct(match["family"], int(match["index"]))


def write_duct(duct: Duct, folder: Path, mesh_format: str = "ply", overwrite: bool = False) -> Path:
    """Write a duct's mesh [mm], centreline table and duct.toml into a folder of its name.

    Args:
        duct: What to write.
        folder: Where its folder is made.
        mesh_format: File ending of the mesh.
        overwrite: Whether files that are there may be replaced.

    Returns:
        The duct.toml.

    Raises:
        ConfigError: A file is there already, or the folder cannot be written.
    """
    home = folder / duct.name
    mesh_path = home / f"wall.{mesh_format}"
    table_path = home / "centreline.csv"
    duct_path = home / "duct.toml"
    _refuse_to_overwrite([mesh_path, table_path, duct_path], overwrite)
    wall = trimesh.Trimesh(duct.mesh.vertices / MM, duct.mesh.faces, process=False)
    description = {
        "name": duct.name,
        "mesh": mesh_path.name,
        "unit": "mm",
        "robot_outer_diameter_mm": float(duct.metadata.get("robot_diameter_mm", 3.0)),
        "pose": {"port_mm": [0.0, 0.0, 0.0], "direction": [0.0, 0.0, 1.0]},
    }
    try:
        home.mkdir(parents=True, exist_ok=True)
        wall.export(mesh_path)
        _write_centreline(duct, table_path)
        duct_path.write_text(tomli_w.dumps(description), encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"Cannot write duct '{duct.name}' to '{home}': {error.strerror or error}.") from None
    return duct_path


def _write_centreline(duct: Duct, path: Path) -> None:
    line = duct.centreline
    targets = {target.node for target in duct.targets}
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(
            "node parent x_mm y_mm z_mm radius_mm station_mm generation branch turn_deg target".split()  # noqa: SIM905
        )
        for node in range(len(line.position)):
            writer.writerow(
                [
                    node,
                    line.parent[node],
                    *(f"{value / MM:.4f}" for value in line.position[node]),
                    f"{line.radius[node] / MM:.4f}",
                    f"{line.station[node] / MM:.4f}",
                    line.generation[node],
                    line.branch[node],
                    f"{line.turn_angle[node] / DEG:.3f}",
                    int(node in targets),
                ]
            )


def _refuse_to_overwrite(paths: list[Path], overwrite: bool) -> None:
    for path in paths:
        if path.exists() and not overwrite:
            raise ConfigError(f"'{path}' is there already. Choose another place, or allow it with --overwrite.")
