"""The command ``evergym diagnose``: what does the model lack, according to measured runs?"""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import tyro

from evergym.agents.progress import ProgressReport
from evergym.errors import ConfigError

__all__ = ["Diagnose"]

UNITS = 1000


@dataclasses.dataclass(frozen=True)
class Diagnose:
    """Find what a model lacks: compare it with measured runs, name the missing effect, and write a corrected model."""

    dataset: tyro.conf.Positional[Path]
    """Folder with dataset.toml and samples.csv."""
    model: str = "mammobot_2023"
    """Model file, or the name of a shipped model."""
    out: Path | None = None
    """Folder for diagnosis.json, report.html and model.toml (None: diagnosis/ in the dataset's folder)."""
    effects: Path | None = None
    """Python file with effects of your own that join the candidates."""
    jobs: int = 0
    """Processes that simulate (0: one per core)."""
    json: bool = False
    """Print diagnosis.json instead of sentences."""

    def run(self) -> int:
        """Diagnose and write the results; returns the exit code."""
        from evergym.discrepancy import diagnose
        from evergym.discrepancy.words import describe_effect, describe_gap, describe_verdict, describe_where

        if self.jobs < 0:
            raise ConfigError(f"--jobs is {self.jobs}, but must be 0 (one process per core) or more.")
        if self.dataset.is_file():
            raise ConfigError(f"'{self.dataset}' is a file. Give the folder that holds dataset.toml.")
        out = self.dataset / "diagnosis" if self.out is None else self.out
        _check_folder(out)
        with ProgressReport("Diagnosis", UNITS, unit="parts") as progress:
            diagnosis = diagnose(
                self.dataset,
                self.model,
                out,
                self.effects,
                self.jobs,
                on_stage=lambda what, share: progress.update(int(share * UNITS), what),
            )
        if self.json:
            print((out / "diagnosis.json").read_text(encoding="utf-8"), end="")
            return 0
        sentences = (
            describe_verdict(diagnosis),
            describe_where(diagnosis),
            describe_gap(diagnosis),
            *diagnosis.remarks,
        )
        for sentence in sentences:
            print(sentence)
        for effect in diagnosis.effects:
            if meaning := describe_effect(effect.name):
                print(f"{effect.name}: {meaning}")
            for interval in diagnosis.parameters[effect.name]:
                print(f"  {interval.path} = {interval.estimate:.4g} ({interval.low_90:.4g} to {interval.high_90:.4g})")
        print(
            f"Results: {out}" + ("" if diagnosis.effects else "; its model.toml is recalibrated, no effect was added")
        )
        return 0


def _check_folder(out: Path) -> None:
    """Refuse a folder that cannot be written to before anything is computed; it is made at the end."""
    nearest = next(folder for folder in (out, *out.absolute().parents) if folder.exists())
    if not nearest.is_dir():
        raise ConfigError(f"'{nearest}' is a file; the results need a folder. Choose another --out.")
    if not os.access(nearest, os.W_OK):
        raise ConfigError(f"The folder '{nearest}' cannot be written to. Choose another --out.")
