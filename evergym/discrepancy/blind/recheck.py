"""Check the gap that a diagnosis claims: its corrected model against the noise-free truth, on its held-out runs.

python -m evergym.discrepancy.blind.recheck CAMPAIGN INDEX [INDEX ...]
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.blind.folders import CaseFolders, read_json, write_json
from evergym.discrepancy.data.columns import channel_index
from evergym.discrepancy.data.reading import load_dataset
from evergym.discrepancy.data.rig import apply_robot
from evergym.discrepancy.parameters import set_values
from evergym.discrepancy.simulate import simulate_run
from evergym.model import load_model

__all__ = ["check_gap", "main"]

Array = NDArray[np.float64]


def check_gap(case: CaseFolders) -> dict[str, Any]:
    """Return the distance of the recalibrated and the corrected model from the truth [sigma rms], and their ratio.

    The recalibrated model is the one that the sealing process has fitted to noise-free signals, so it is as good as a
    recalibrated model can be.
    """
    truth = read_json(case.truth)
    diagnosis = read_json(case.diagnosis / "diagnosis.json")
    raw = load_model(case.public / "model.toml")
    dataset = load_dataset(case.public / "dataset", raw.robot)
    recalibrated = set_values(apply_robot(raw, dataset), truth["recalibrated"])
    corrected = load_model(case.diagnosis / "model.toml")
    held_out = set(diagnosis["gap"]["held_out_runs"])
    with np.load(case.signals) as stored:
        signals = [stored[name] for name in stored.files]
    gaps: dict[str, list[Array]] = {"before": [], "after": []}
    for run, signal in zip(dataset.runs, signals, strict=True):
        if run.id not in held_out:
            continue
        for name, model in (("before", recalibrated), ("after", corrected)):
            gaps[name].append(_scale(simulate_run(model, run) - signal, run.measured, truth["bench"]))
    sizes = {name: _rms(parts) for name, parts in gaps.items()}
    before, after = sizes["before"], sizes["after"]
    ratio = after / before if before and after is not None else None
    return {**sizes, "ratio": ratio, "held_out_runs": sorted(held_out)}


def _scale(gap: Array, measured: Array, sigma: Mapping[str, float]) -> Array:
    index = [channel_index(name) for name in sigma]
    scaled = gap[:, index] / np.array(list(sigma.values()))
    return np.asarray(scaled[np.isfinite(measured[:, index])])


def _rms(parts: Sequence[Array]) -> float | None:
    """Return the rms; None without a held-out run, or where a simulation failed."""
    if not parts:
        return None
    value = float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
    return value if math.isfinite(value) else None


def main(arguments: Sequence[str]) -> int:
    """Check cases, and write what was found beside their diagnoses."""
    campaign, *indices = arguments
    for index in indices:
        case = CaseFolders(Path(campaign), int(index))
        write_json(check_gap(case), case.recheck)
        print(index, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
