"""Compiled kernels are found again, and never after anything below them has changed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from evergym import cache

CHECKOUT = Path(__file__).resolve().parents[2]

KERNEL = """
from evergym.duct_models.lower import (
    scale,  # a comment in brackets
    SHIFT,
)
from evergym.jit import njit

@njit
def apply(x: float) -> float:
    return scale(x) + SHIFT
"""
LOWER = """
from evergym.jit import njit
from evergym import lowest as base

SHIFT = 1.0

@njit(inline="always")
def scale(x: float) -> float:
    return base.FACTOR * x
"""

IMPORT = "from evergym.kernel import apply"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A small evergym with a kernel that calls into a linked folder, which takes a constant from a third module."""
    folder = tmp_path / "evergym"
    folder.mkdir()
    for name in ("cache.py", "jit.py"):
        shutil.copy(CHECKOUT / "evergym" / name, folder)
    (folder / "__init__.py").write_text("")
    (tmp_path / "duct_models").mkdir()
    (tmp_path / "duct_models" / "__init__.py").write_text("")
    (folder / "duct_models").symlink_to("../duct_models")
    (folder / "kernel.py").write_text(KERNEL)
    (folder / "lowest.py").write_text("FACTOR = 2.0\n")
    (folder / "unrelated.py").write_text("X = 1\n")
    (tmp_path / "duct_models" / "lower.py").write_text(LOWER)
    return folder


def run(code: str, package: Path, **environment: str) -> list[str]:
    """The words that code prints in a new process, which sees the small evergym (-S: and not the editable install)."""
    paths = os.pathsep.join([str(package.parent), sysconfig.get_paths()["purelib"]])
    result = subprocess.run(
        [sys.executable, "-S", "-c", code],
        cwd=package.parent,
        env={**os.environ, "PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(package.parent / "cache"), **environment},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.split()


def call(package: Path) -> list[str]:
    """Value and number of cache hits of one call of the kernel in a new process."""
    return run(f"{IMPORT}; print(apply(10.0), sum(apply.stats.cache_hits.values()))", package)


def test_a_second_process_loads_what_the_first_compiled(package: Path) -> None:
    assert call(package) == ["21.0", "0"]
    (package / "unrelated.py").write_text("X = 2\n")
    assert call(package) == ["21.0", "1"]


@pytest.mark.parametrize(
    ("file", "old", "new", "value"),
    [
        ("lowest.py", "2.0", "3.0", "31.0"),  # a constant two modules below
        ("duct_models/lower.py", "base.FACTOR * x", "base.FACTOR + x", "13.0"),  # a called kernel behind a link
    ],
)
def test_an_edit_below_a_kernel_recompiles_it(package: Path, file: str, old: str, new: str, value: str) -> None:
    assert call(package)[0] == "21.0"
    path = package / file
    path.write_text(path.read_text().replace(old, new))
    assert call(package) == [value, "0"]


def test_kernels_are_saved_by_one_process_at_a_time(package: Path) -> None:
    """numba's index has no lock: of two that write it at once, one would load the other's machine code later."""
    watch = """
from pathlib import Path
from filelock import FileLock, Timeout
from numba.core.caching import IndexDataCacheFile
save = IndexDataCacheFile.save
def watched(self, key, data):
    lock = Path(self._cache_path).parent / "saving.lock"
    try:
        with FileLock(lock, timeout=0):
            print("free")
    except Timeout:
        print("locked")
    save(self, key, data)
IndexDataCacheFile.save = watched
"""
    assert run(f"{watch}\n{IMPORT}\napply(10.0); apply(10)", package) == ["locked", "locked"]
    assert run(f"{watch}\n{IMPORT}\napply(10.0); apply(10)", package) == []


def test_the_users_cache_folder_is_used(package: Path) -> None:
    chosen = package.parent / "chosen"
    (used,) = run(f"{IMPORT}; print(apply.stats.cache_path)", package, NUMBA_CACHE_DIR=str(chosen))
    assert Path(used).is_relative_to(chosen)


def test_without_any_folder_kernels_still_compile(package: Path) -> None:
    blocked = package.parent / "blocked"
    blocked.write_text("")  # a file, where each of the folders would have to be made
    (package / "__init__.py").write_text(f"import tempfile\ntempfile.tempdir = {str(blocked)!r}\n")
    printed = run(f"{IMPORT}; print(apply(10.0), apply.stats.cache_path)", package, NUMBA_CACHE_DIR=str(blocked))
    assert printed == ["21.0", "None"]


def test_what_is_saved_while_a_process_runs_is_not_cached(package: Path) -> None:
    path = package / "lowest.py"
    save = (
        f"import time, evergym.lowest, evergym.cache; time.sleep(0.1); open({str(path)!r}, 'w').write('FACTOR = 3.0')"
    )
    assert run(f"{save}; {IMPORT}; print(apply(10.0), apply.stats.cache_path)", package) == ["21.0", "None"]
    assert call(package) == ["31.0", "0"]


def test_sources_are_followed_through_links_and_brackets(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "PACKAGE_FOLDER", package)
    sources = {path.relative_to(package).as_posix() for path in cache.find_kernel_sources(package / "kernel.py")}
    assert sources == {"kernel.py", "duct_models/lower.py", "lowest.py", "jit.py", "cache.py"}


def test_the_jit_can_be_switched_off(package: Path) -> None:
    assert run(f"{IMPORT}; print(apply(10.0), type(apply).__name__)", package, NUMBA_DISABLE_JIT="1") == [
        "21.0",
        "function",
    ]
