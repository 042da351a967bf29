"""Where compiled kernels are cached: a folder of its own for every state of the sources a kernel is built from.

numba recompiles a cached function when its own file changes, but not when a file that it *calls into*, or takes a
constant from, does; it then runs stale physics without a word. So the folder's name holds a hash of the module and of
every evergym module it imports, directly or not. An edit anywhere below a kernel opens a new, empty folder; an edit
elsewhere recompiles nothing.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
import tempfile
import time
from pathlib import Path

import platformdirs

__all__ = ["compute_source_digest", "find_cache_root", "find_kernel_folder", "find_kernel_sources"]

PACKAGE_NAME = "evergym"
PACKAGE_FOLDER = Path(__file__).parent
START_TIME = time.time()

# One match per import statement: the module, then the imported names (in brackets, over several lines, or on one line).
_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+(?P<module>[\w.]+)[ \t]+import[ \t]+(?P<names>\([^)]*\)|[^\n#]*)"
    r"|import[ \t]+(?P<modules>[^\n#]*))",
    re.MULTILINE,
)


@functools.cache
def find_cache_root() -> Path | None:
    """The folder under which kernels are cached, or None where nothing can be written.

    Kernels are then compiled anew in every process. The folder is in ``NUMBA_CACHE_DIR`` if the user has set it, else
    in the user's cache folder, else in the system's temporary folder.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    candidates = [
        Path(chosen) / PACKAGE_NAME if chosen else platformdirs.user_cache_path(PACKAGE_NAME) / "numba",
        Path(tempfile.gettempdir()) / f"{PACKAGE_NAME}-{os.getuid()}" / "numba",
    ]
    for folder in candidates:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK | os.X_OK):
            return folder
    return None


def find_kernel_folder(source: str | Path) -> Path | None:
    """The folder for the compiled kernels of one module, or None where they cannot be cached.

    Args:
        source: The module's file, through the links of a checkout or in an installed (perhaps read-only) package.
    """
    path = Path(source)
    root = find_cache_root()
    if root is None or not path.is_file():
        return None
    # A file saved while this process runs may hold another text than what was imported: cached under the new text's
    # hash, the old code would be found by every later process.
    if any(file.stat().st_mtime > START_TIME for file in find_kernel_sources(path)):
        return None
    return root / f"{path.stem}-{compute_source_digest(path)}"


@functools.cache
def compute_source_digest(source: Path) -> str:
    """Hash (16 hexadecimal digits) of the texts of a module and of every evergym module it imports, directly or not."""
    digest = hashlib.sha256()
    for path in sorted(find_kernel_sources(source)):
        digest.update(
            str(path.relative_to(PACKAGE_FOLDER) if path.is_relative_to(PACKAGE_FOLDER) else path.name).encode()
        )
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:16]


@functools.cache
def find_kernel_sources(source: Path) -> frozenset[Path]:
    """A module's file and the files of all evergym modules it imports, directly or not."""
    found = {source}
    waiting = [source]
    while waiting:
        for path in _imported_files(waiting.pop()):
            if path not in found:
                found.add(path)
                waiting.append(path)
    return frozenset(found)


@functools.cache
def _imported_files(source: Path) -> tuple[Path, ...]:
    """The evergym files that one file's import statements name, found in its text: importing it would be slow."""
    modules: set[str] = set()
    for match in _IMPORT.finditer(source.read_text(encoding="utf-8")):
        if match["modules"] is not None:
            modules.update(part.split()[0] for part in match["modules"].split(",") if part.split())
        else:
            modules.add(match["module"])
            modules.update(f"{match['module']}.{name}" for name in re.findall(r"\w+", match["names"]))
    files = (_module_file(name) for name in sorted(modules))
    return tuple(path for path in files if path is not None)


def _module_file(name: str) -> Path | None:
    """The file of an evergym module or package, or None if the name is neither (such as a function)."""
    package, *parts = name.split(".")
    if package != PACKAGE_NAME or not parts:
        return None
    path = PACKAGE_FOLDER.joinpath(*parts)
    for candidate in (path.with_suffix(".py"), path / "__init__.py"):
        if candidate.is_file():
            return candidate
    return None
