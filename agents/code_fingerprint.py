"""A fingerprint of the code that a result depends on, so that results of different code are never mixed unnoticed."""

from __future__ import annotations

import hashlib
import importlib
from functools import lru_cache
from pathlib import Path

__all__ = ["fingerprint_code", "fingerprint_file"]

_PACKAGES = ("evergym", "evergym.duct_models", "evergym.envs", "evergym.agents")
_SHOW_ONLY = ("cli.py", "figures.py", "progress.py", "report.py", "soak.py", "suggest.py")
"""Files of `evergym.agents` that show results and cannot change them."""


@lru_cache(maxsize=1)
def fingerprint_code() -> str:
    """Hash of every source and settings file of the package, 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        folder = Path(importlib.import_module(package).__path__[0]).resolve()
        # rglob does not follow the links of the checkout, so no file comes twice.
        for path in sorted(item for item in folder.rglob("*") if item.suffix in (".py", ".toml")):
            if package == "evergym.agents" and path.name in _SHOW_ONLY:
                continue
            digest.update(f"{package}/{path.relative_to(folder)}\0".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def fingerprint_file(*paths: Path) -> str:
    """Hash of the given files that exist, 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for path in paths:
        if path.is_file():
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
