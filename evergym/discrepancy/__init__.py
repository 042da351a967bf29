"""Find what a model lacks: measured datasets, their simulation, and the diagnosis of the difference.

`diagnose` does all of it, from a folder to a folder; `load_dataset` reads the measured runs, `run_stages` returns what
each stage found, and a user's own effect joins as a `UserEffect`. Measured runs are in `evergym.discrepancy.data`, the
campaign that tests the diagnosis on hidden effects in `evergym.discrepancy.blind`; the stages are here, in the order of
`evergym.discrepancy.stages`.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evergym.discrepancy.data.reading import load_dataset
    from evergym.discrepancy.hook import UserEffect
    from evergym.discrepancy.stages import diagnose, run_stages

__all__ = ["UserEffect", "diagnose", "load_dataset", "run_stages"]

_LAZY = {
    "UserEffect": "evergym.discrepancy.hook",
    "diagnose": "evergym.discrepancy.stages",
    "load_dataset": "evergym.discrepancy.data.reading",
    "run_stages": "evergym.discrepancy.stages",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'evergym.discrepancy' has no attribute {name!r}")
    value = getattr(importlib.import_module(_LAZY[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
