"""The one way to compile a kernel: ``from evergym.jit import njit`` instead of numba's own."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, overload

import numba
from filelock import FileLock
from numba.typed import List as TypedList

from evergym.cache import find_kernel_folder

__all__ = ["TypedList", "njit"]

P = ParamSpec("P")
R = TypeVar("R")


@overload
def njit(function: Callable[P, R], /) -> Callable[P, R]: ...
@overload
def njit(**options: Any) -> Callable[[Callable[P, R]], Callable[P, R]]: ...
def njit(function: Callable[..., Any] | None = None, /, **options: Any) -> Any:
    """Compile a function with numba, cached on disk until it or anything it imports from evergym changes.

    Division by zero gives inf or NaN as in numpy (``error_model="numpy"``: no hidden branch at every division;
    divergence leaves a kernel as a status code). ``fastmath`` stays off, since it deletes NaN checks.

    Args:
        function: The kernel, when used as ``@njit`` without brackets.
        options: Passed to ``numba.njit``, such as ``inline="always"``.
    """
    if function is None:
        return lambda kernel: _compile(kernel, options)
    return _compile(function, options)


def _compile(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    folder = find_kernel_folder(function.__code__.co_filename)
    settings = {"error_model": "numpy", "cache": folder is not None, **options}
    # numba fixes a function's cache folder when it is decorated. Setting it for that moment only leaves the caches of
    # other packages, and the environment of child processes, alone.
    config: Any = numba.config
    previous = config.CACHE_DIR
    config.CACHE_DIR = str(folder) if folder is not None else previous
    try:
        kernel: Any = numba.njit(**settings)(function)
    finally:
        config.CACHE_DIR = previous
    if settings["cache"] and folder is not None and hasattr(kernel, "_cache"):  # not with the jit switched off
        kernel._cache.save_overload = _save_alone(kernel._cache.save_overload, folder)
    return kernel


def _save_alone(save: Callable[P, R], folder: Path) -> Callable[P, R]:
    """Let one process at a time save into a cache folder.

    numba reads a function's index, adds a line and writes it back: of two processes that do so at once, one may end up
    with its index pointing to the other's machine code, made for other arguments.
    """

    def save_locked(*arguments: P.args, **named: P.kwargs) -> R:
        lock = FileLock(folder / "saving.lock")
        with contextlib.ExitStack() as held:
            # A file system without locks, or another user's folder: numba finds a place of its own, as it would anyway.
            with contextlib.suppress(OSError):
                held.enter_context(lock)
            return save(*arguments, **named)

    return save_locked
