"""Where the parts of a campaign are kept: what the diagnosis is given, what is sealed from it, and what came out."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from evergym.whole_file import write_whole

__all__ = ["CaseFolders", "fill_folder", "read_json", "write_json"]


class CaseFolders:
    """The folders of one case in a campaign's folder.

    Args:
        campaign: The campaign's folder.
        index: Number of the case.
    """

    def __init__(self, campaign: Path, index: int) -> None:
        name = f"case-{index:04d}"
        self.index = index
        self.public = campaign / "public" / name
        self.sealed = campaign / "sealed" / name
        self.result = campaign / "results" / name

    @property
    def truth(self) -> Path:
        """What is true."""
        return self.sealed / "truth.json"

    @property
    def signals(self) -> Path:
        """Noise-free channels of every run."""
        return self.sealed / "signals.npz"

    @property
    def outcome(self) -> Path:
        """How the diagnosis ended."""
        return self.result / "outcome.json"

    @property
    def baselines(self) -> Path:
        """What the baselines say."""
        return self.result / "baselines.json"

    @property
    def recheck(self) -> Path:
        """How far the corrected model is from the truth."""
        return self.result / "recheck.json"

    @property
    def diagnosis(self) -> Path:
        """What the diagnosis wrote."""
        return self.result / "out"


@contextmanager
def fill_folder(target: Path) -> Iterator[Path]:
    """Give a folder beside ``target`` to fill; it takes the target's place when all went well, else it is removed."""
    target.parent.mkdir(parents=True, exist_ok=True)
    draft = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    try:
        yield draft
        if target.exists():
            shutil.rmtree(target)
        draft.chmod(0o755)
        draft.replace(target)
    except BaseException:
        shutil.rmtree(draft, ignore_errors=True)
        raise


def read_json(path: Path) -> Any:
    """Return the content of a JSON file."""
    return json.loads(path.read_text(encoding="utf-8"))


def write_json(content: Any, path: Path) -> None:
    """Write a JSON file, whole or not at all."""
    write_whole(path, json.dumps(content, indent=1, allow_nan=False) + "\n")
