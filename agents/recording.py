"""Record episodes of an environment as a dataset of measured runs, as a bench would have seen them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.data.export import add_noise, format_csv, write_dataset, write_table
from evergym.discrepancy.data.record import Recorder
from evergym.duct_models.commands import write_duct
from evergym.duct_models.duct import Duct
from evergym.duct_models.pegs import PegField
from evergym.errors import ConfigError, RunError
from evergym.simulator import Simulator
from evergym.units import MM

__all__ = ["EpisodeRecording"]


class EpisodeRecording(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Record every episode of an environment of this package; `write` makes a dataset of them.

    The control step is sampled once, or as often as the environment holds commands within it. A dataset's robot starts
    straight; in a duct the environment lays it along the way, which is the same to the first few samples.

    Args:
        env: The environment.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        self._done: list[tuple[Recorder, Any]] = []
        self._recorder: Recorder | None = None
        self._scene: Any = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode, and its record."""
        self._close_record()
        result = super().reset(seed=seed, options=options)
        simulator = getattr(self.unwrapped, "_simulator", None)
        if not isinstance(simulator, Simulator):
            raise RunError(
                f"{type(self.unwrapped).__name__} has no simulator of this package, so there is nothing to record. "
                "Wrap an environment of evergym."
            )
        self._recorder = Recorder(simulator)
        self._scene = getattr(self.unwrapped, "_scene", None)
        simulator.advance = self._recorder.advance  # type: ignore[method-assign]
        return result

    def close(self) -> None:
        """End the record and close the environment."""
        self._close_record()
        super().close()

    def write(
        self,
        folder: str | Path,
        noise: Mapping[str, float],
        rng: np.random.Generator | None = None,
        *,
        name: str = "",
        overwrite: bool = False,
    ) -> Path:
        """Write all episodes so far, with the tables of their pegs and the meshes of their ducts.

        Args:
            folder: Is made where it is missing.
            noise: One standard deviation of each channel that the bench has; the others are left out.
            rng: Draws the noise; None: the channels stay exact.
            name: Of the dataset.
            overwrite: Write over a dataset that is there already.

        Raises:
            ConfigError: no episode was recorded, or a dataset is there already.
        """
        self._close_record()
        if not self._done:
            raise ConfigError("No episode was recorded. Run at least one before writing.")
        folder = Path(folder)
        if (folder / "dataset.toml").exists() and not overwrite:
            raise ConfigError(f"'{folder / 'dataset.toml'}' is there already. Choose another folder.")
        folder.mkdir(parents=True, exist_ok=True)
        runs = []
        for number, (recorder, scene) in enumerate(self._done, start=1):
            environment, place = _write_scene(folder, scene, number)
            run = recorder.finish(f"e{number:02d}", place, environment)
            draw = np.random.default_rng(0) if rng is None else rng
            runs.append(add_noise(run, noise if rng is not None else dict.fromkeys(noise, 0.0), draw))
        return write_dataset(folder, runs, noise, name=name, overwrite=overwrite)

    @property
    def runs(self) -> tuple[Run, ...]:
        """The finished episodes, exact and without their surroundings' files."""
        return tuple(recorder.finish(f"e{number:02d}") for number, (recorder, _) in enumerate(self._done, start=1))

    def _close_record(self) -> None:
        """Give the simulator its own `advance` back, and keep the record if anything happened."""
        if self._recorder is None:
            return
        del self._recorder.simulator.advance
        if self._recorder.sample_count > 1:
            self._done.append((self._recorder, self._scene))
        self._recorder = None


def _write_scene(folder: Path, scene: Any, number: int) -> tuple[str, str]:
    """Write what surrounds an episode; return the run's environment and the place's name."""
    if isinstance(scene, PegField):
        file = folder / f"pegs-{number:02d}.csv"
        rows = [
            [repr(float(peg[0] / MM)), repr(float(peg[2] / MM)), repr(float(2.0 * peg[6] / MM))] for peg in scene.pegs
        ]
        write_table(file, format_csv(["x_mm", "z_mm", "diameter_mm"], rows))
        return f"pegs:{file.name}", scene.name
    if isinstance(scene, Duct):
        path = write_duct(scene, folder, overwrite=True)
        return f"duct:{path.relative_to(folder)}", scene.name
    return "free", ""
