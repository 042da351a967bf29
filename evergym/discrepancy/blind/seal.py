"""The sealing process: draws truths, writes datasets to one folder and what is true to another.

python -m evergym.discrepancy.blind.seal CAMPAIGN SEED INDEX [INDEX ...]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from evergym.discrepancy.blind.case import make_case
from evergym.discrepancy.blind.folders import CaseFolders, fill_folder, write_json
from evergym.discrepancy.blind.instruments import write_dataset
from evergym.model import save_model

__all__ = ["main", "seal_case"]


def seal_case(campaign: Path, seed: int, index: int) -> None:
    """Write one case: first what is sealed, then what the diagnosis may see, each whole or not at all."""
    folders = CaseFolders(campaign, index)
    case = make_case(seed, index)
    with fill_folder(folders.sealed) as draft:
        write_json(case.sealed, draft / folders.truth.name)
        with (draft / folders.signals.name).open("wb") as file:
            np.savez_compressed(file, *case.signals)
    with fill_folder(folders.public) as draft:
        write_dataset(draft / "dataset", case.files)
        save_model(case.model, draft / "model.toml")


def main(arguments: list[str]) -> int:
    """Seal cases, one line on stdout for each."""
    campaign, seed, *indices = arguments
    for index in indices:
        seal_case(Path(campaign), int(seed), int(index))
        print(index, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
