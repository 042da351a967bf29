"""A training run on disk: settings, versions, learning curve and checkpoints.

    runs/<name>/settings.toml                the resolved settings, seed included
                versions.toml                Python, platform and the packages that matter
                curve.csv                    the learning curve
                tensorboard/                 the same and more, for TensorBoard
                checkpoints/000050000/       one folder per checkpoint, named by its step
                    model.zip                weights and optimiser, in Stable-Baselines3's own format
                    normaliser.pkl           running statistics (only if normalising)
                    replay.pkl               SAC and TQC, in the latest checkpoint only
                    progress.toml            step, segment, seconds trained

A checkpoint is written under a hidden name and renamed when complete, so a kill leaves either a whole one or none.
Model files are pickles: open only run folders you trust.
"""

from __future__ import annotations

import dataclasses
import importlib.metadata
import platform
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path

import tomli_w

from evergym.agents.code_fingerprint import fingerprint_code
from evergym.agents.settings import TrainSettings, read_settings, write_settings
from evergym.agents.suggest import suggest
from evergym.errors import RunError

__all__ = ["Checkpoint", "Progress", "RunFolder", "collect_versions", "find_changed_versions"]

_PARTIAL = ".partial-"


def collect_versions() -> dict[str, str]:
    """Versions of Python, the platform and the packages on which a result depends."""
    names = ("evergym", "gymnasium", "numba", "numpy", "scipy", "stable-baselines3", "sb3-contrib", "torch")
    versions = {"python": platform.python_version(), "platform": platform.platform()}
    versions["evergym code"] = fingerprint_code()
    for name in names:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return versions


def find_changed_versions(folder: RunFolder) -> tuple[str, ...]:
    """Name what is not as it was when the run was started, as ``torch 2.6 -> 2.7``."""
    stored = tomllib.loads((folder.path / "versions.toml").read_text(encoding="utf-8"))
    now = collect_versions()
    return tuple(f"{name} {stored.get(name)} -> {now[name]}" for name in now if stored.get(name) != now[name])


@dataclasses.dataclass(frozen=True)
class Progress:
    """How far a checkpoint is."""

    step: int
    """Environment steps taken."""
    segment: int
    """Number of checkpoints before the steps that follow; seeds them."""
    seconds: float
    """Wall time spent training, over all resumed parts [s]."""
    environment: str
    """Environment id, to notice a checkpoint of another one."""


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """A complete checkpoint on disk."""

    path: Path

    @property
    def progress(self) -> Progress:
        """What `RunFolder.save` was given."""
        return read_settings(Progress, self.path / "progress.toml")

    @property
    def model(self) -> Path:
        """Weights and optimiser, in Stable-Baselines3's own format."""
        return self.path / "model.zip"

    @property
    def normaliser(self) -> Path:
        """Running statistics; the file exists only if the run normalises."""
        return self.path / "normaliser.pkl"

    @property
    def replay(self) -> Path:
        """Replay buffer; the file exists only for SAC and TQC, in the latest checkpoint."""
        return self.path / "replay.pkl"


@dataclasses.dataclass(frozen=True)
class RunFolder:
    """The folder of one run; `create` a new one or `open` an existing one."""

    path: Path

    @classmethod
    def create(cls, path: Path, settings: TrainSettings) -> RunFolder:
        """Make the folder and write settings and versions.

        Raises:
            RunError: Something is there already; nothing is ever overwritten.
        """
        if path.exists():
            raise RunError(
                f"Run folder '{path}' exists already and is not overwritten. Choose another one with --folder, or "
                f"continue the run with: evergym train --resume {path}"
            )
        try:
            (path / "checkpoints").mkdir(parents=True)
        except OSError as error:
            raise RunError(f"Run folder '{path}' cannot be made: {error}.") from error
        write_settings(settings, path / "settings.toml")
        (path / "versions.toml").write_text(tomli_w.dumps(collect_versions()), encoding="utf-8")
        return cls(path)

    @classmethod
    def open(cls, path: Path) -> RunFolder:
        """Open an existing run.

        Raises:
            RunError: There is no such folder (the nearest name is suggested) or it holds no run.
        """
        if not path.is_dir():
            parent = path.parent
            if not parent.is_dir():
                raise RunError(f"Run folder '{path}' does not exist, and neither does '{parent}'.")
            runs = [item.name for item in parent.iterdir() if (item / "settings.toml").is_file()]
            if not runs:
                raise RunError(f"Run folder '{path}' does not exist, and '{parent}' holds no other run.")
            raise RunError(f"Run folder '{path}' does not exist in '{parent}'{suggest(path.name, runs)}")
        if not (path / "settings.toml").is_file() or not (path / "checkpoints").is_dir():
            raise RunError(f"'{path}' is not a run folder: it has no settings.toml with checkpoints/ beside it.")
        return cls(path)

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.path.resolve().name

    @property
    def settings(self) -> TrainSettings:
        """The resolved settings of the run."""
        return read_settings(TrainSettings, self.path / "settings.toml")

    @property
    def curve(self) -> Path:
        """The learning curve."""
        return self.path / "curve.csv"

    @property
    def tensorboard(self) -> Path:
        """Folder of the TensorBoard logs."""
        return self.path / "tensorboard"

    def checkpoints(self) -> tuple[Checkpoint, ...]:
        """Complete checkpoints, oldest first."""
        folders = [item for item in (self.path / "checkpoints").iterdir() if item.name.isdigit()]
        return tuple(Checkpoint(item) for item in sorted(folders, key=lambda item: int(item.name)))

    def latest(self) -> Checkpoint:
        """The newest complete checkpoint.

        Raises:
            RunError: There is none yet.
        """
        checkpoints = self.checkpoints()
        if not checkpoints:
            raise RunError(
                f"Run '{self.path}' has no checkpoint yet: it was stopped before its first one. Delete the folder and "
                "start again, with a smaller --checkpoint-interval if that is why."
            )
        return checkpoints[-1]

    def save(self, progress: Progress, write: Callable[[Checkpoint], None]) -> Checkpoint:
        """Write a checkpoint so that it appears whole or not at all.

        Args:
            progress: How far the run is; its step names the checkpoint.
            write: Writes model, normaliser and replay buffer to the paths of the checkpoint it is given.
        """
        folder = self.path / "checkpoints"
        for stale in folder.glob(f"{_PARTIAL}*"):
            shutil.rmtree(stale)
        partial = Checkpoint(folder / f"{_PARTIAL}{progress.step:09d}")
        partial.path.mkdir()
        write(partial)
        write_settings(progress, partial.path / "progress.toml")
        final = Checkpoint(folder / f"{progress.step:09d}")
        partial.path.replace(final.path)
        for older in self.checkpoints()[:-1]:
            older.replay.unlink(missing_ok=True)  # large, and only the newest is continued
        return final
