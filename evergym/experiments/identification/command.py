"""The command ``evergym identify``."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from evergym.model import load_model

__all__ = ["Identify"]


@dataclass(frozen=True)
class Identify:
    """Estimate the robot's parameters from the paper's figures, and write the models that `evergym validate` compares.

    An interrupted run goes on where it was stopped: every finished fit is kept in the folder.
    """

    out: Path = Path("identification")
    """Folder of the model files, identification.json and the fits."""
    model: str = "mammobot_2023"
    """The model whose other values stay, by name or file."""
    evaluations_max: int = 25
    """Steps of the optimiser, at most."""
    workers: int = -1
    """Processes (-1: one per core)."""

    def run(self) -> int:
        """Fit, write and print; returns the exit code."""
        # The simulator: not for --help.
        campaign = importlib.import_module("evergym.experiments.identification.campaign")
        findings = importlib.import_module("evergym.experiments.identification.findings")
        console = Console()
        columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
        with Progress(TextColumn("{task.description}"), *columns, console=Console(stderr=True)) as progress:
            bar = progress.add_task("Fits", total=None)
            found = campaign.identify(
                load_model(self.model),
                self.out / "fits",
                evaluations_max=self.evaluations_max,
                workers=self.workers,
                on_progress=lambda done, total: progress.update(bar, completed=done, total=total),
            )
        paths = findings.write_models(found, self.out)
        summary = findings.describe(found)
        table = Table("parameter", "estimate", "+-", "acts in")
        for path, record in summary["parameters"].items():
            table.add_row(
                path, f"{record['estimate']:.4g}", f"{record['uncertainty']:.2g}", ", ".join(record["figures"])
            )
        console.print(table)
        for note in summary["not_identifiable"]:
            console.print(note, highlight=False)
        console.print(f"Written: {len(paths)} files in {self.out}", highlight=False)
        return 0
