"""The commands ``evergym dataset check | show | export-paper``: one dataclass each; its fields are the options."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tyro.conf import Positional

from evergym.discrepancy.data.columns import CHANNELS, COLUMNS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.data.nearest import suggest_nearest
from evergym.discrepancy.data.reading import load_dataset
from evergym.errors import ConfigError
from evergym.model import load_model

__all__ = ["DatasetCheck", "DatasetExportPaper", "DatasetShow", "describe_dataset"]


@dataclass(frozen=True)
class DatasetCheck:
    """Check a folder of measured runs, as the diagnosis will read it, and say what is in it."""

    folder: Positional[Path]
    """Folder with dataset.toml and samples.csv or samples.parquet."""
    model: str = "mammobot_2023"
    """Model that the data will be compared with (name or file); its robot decides which rows are impossible."""

    def run(self) -> int:
        """Print what was found.

        Raises:
            ConfigError: bad data, with file, row and column.
        """
        from evergym.discrepancy.alignment import align_dataset
        from evergym.discrepancy.data.rig import apply_robot, soften_line
        from evergym.discrepancy.data.surroundings import open_world

        model = load_model(self.model)
        dataset = load_dataset(self.folder, model.robot)
        rig, _ = soften_line(apply_robot(model, dataset))
        for run in dataset.runs:
            open_world(run)  # meshes are read by nothing before
        print(describe_dataset(dataset))
        for remark in align_dataset(rig, dataset)[1]:
            print(f"  {remark}")
        return 0


@dataclass(frozen=True)
class DatasetShow:
    """Draw the commands and channels of measured runs into a PNG file."""

    folder: Positional[Path]
    """Folder with dataset.toml and samples.csv or samples.parquet."""
    out: Path = Path("dataset.png")
    """The picture."""
    runs: tuple[str, ...] = ()
    """Ids of the runs to draw; none: all."""
    model: str | None = None
    """Model (name or file) whose prediction to draw over the measurements."""
    overwrite: bool = False
    """Write over a picture that is there already."""

    def run(self) -> int:
        """Draw and name the picture.

        Raises:
            ConfigError: bad data, an unknown run, or a picture that cannot be written.
        """
        if self.out.suffix.lower() != ".png":
            raise ConfigError(f"The picture must be a .png file: got '{self.out}'.")
        if not self.out.parent.is_dir():
            raise ConfigError(f"There is no folder '{self.out.parent}' for the picture.")
        if self.out.exists() and not self.overwrite:
            raise ConfigError(f"'{self.out}' is there already. Choose another name, or allow to --overwrite it.")
        model = None if self.model is None else load_model(self.model)
        dataset = load_dataset(self.folder, None if model is None else model.robot)
        runs = _choose(dataset, self.runs)
        predictions = None
        if model is not None:
            from evergym.discrepancy.data.rig import apply_robot
            from evergym.discrepancy.simulate import try_simulate_run

            rig = apply_robot(model, dataset)
            found = [try_simulate_run(rig, run) for run in runs]
            for prediction in found:
                if prediction.failure:
                    print(f"not simulated to its end: {prediction.failure}")
            predictions = [prediction.channels for prediction in found]
        from evergym.discrepancy.data.picture import draw_dataset  # matplotlib takes a second to load

        draw_dataset(dataset, self.out, predictions, runs)
        print(self.out)
        return 0


@dataclass(frozen=True)
class DatasetExportPaper:
    """Write the measured figures of the paper (Wu et al. 2023) as a dataset."""

    folder: Positional[Path]
    """Folder to write; made where it is missing."""
    figures: tuple[str, ...] = ()
    """Figures to write, such as fig7 fig10; none: all."""
    overwrite: bool = False
    """Write over a dataset that is there already."""

    def run(self) -> int:
        """Write and name the folder.

        Raises:
            ConfigError: an unknown figure, or a dataset that is there already.
        """
        from evergym.discrepancy.data.paper import export_paper

        print(export_paper(self.folder, self.figures or None, self.overwrite))
        return 0


def describe_dataset(dataset: Dataset) -> str:
    """Return what a dataset holds, as lines of text."""
    experiments = len({run.experiment for run in dataset.runs})
    size = f"{len(dataset.runs)} runs in {experiments} experiments, {dataset.duration:.1f} s of robot time"
    lines = [
        f"{dataset.path}: '{dataset.name}', {size}",
        f"  {'channel':<24}{'noise':>12}{'samples':>10}{'smallest':>12}{'largest':>12}",
    ]
    for name in dataset.channels:
        values = np.concatenate([run.measured[:, CHANNELS.index(name)] for run in dataset.runs])
        values = values[np.isfinite(values)]
        noise = f"{dataset.noise[name]:.3g} {COLUMNS[name].unit}"
        lines.append(f"  {name:<24}{noise:>12}{len(values):>10}{values.min():>12.4g}{values.max():>12.4g}")
    if dataset.ignore:
        lines.append(f"  ignored: {', '.join(dataset.ignore)}")
    if dataset.robot:
        lines.append("  robot: " + ", ".join(f"{key} = {value:g}" for key, value in dataset.robot.items()))
    if any(run.signed_angles for run in dataset.runs):
        lines.append("  angles are signed (some are negative): positive towards +x, seen along -y")
    lines.append(f"  {'run':<16}{'experiment':<16}{'setup':<10}{'environment':<20}{'rows':>6}{'time':>10}")
    for run in dataset.runs:
        time = f"{run.time_s[-1] - run.time_s[0]:.1f} s"
        lines.append(
            f"  {run.id:<16}{run.experiment:<16}{run.setup:<10}{run.environment:<20}{len(run.time_s):>6}{time:>10}"
        )
    lines.append(f"  rows set aside: {len(dataset.set_aside)}")
    lines += [f"    row {row}: {why}" for row, why in dataset.set_aside]
    return "\n".join(lines)


def _choose(dataset: Dataset, ids: tuple[str, ...]) -> tuple[Run, ...]:
    by_id = {run.id: run for run in dataset.runs}
    for name in ids:
        if name not in by_id:
            raise ConfigError(f"There is no run '{name}' in {dataset.path}.{suggest_nearest(name, by_id)}")
    return tuple(by_id[name] for name in ids) if ids else dataset.runs
