"""Say so when kernels are compiled: whoever waits for minutes without a word thinks that the program hangs."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any

__all__ = ["COMPILING", "announce_compilation"]

COMPILING = "Compiling the simulator for this place: up to a few minutes, once"
"""What people are told."""


def _print_at_once(text: str) -> None:
    print(text, flush=True)


@contextlib.contextmanager
def announce_compilation(tell: Callable[[str], Any] = _print_at_once, patience: float = 1.5) -> Iterator[None]:
    """Tell people once if kernels are compiled within the context, and that takes longer than a moment.

    Kernels that are found on disk are not compiled, and nothing is said.

    Args:
        tell: Is given the message, in another thread; by default it is printed.
        patience: From the first compilation on [s].
    """
    from numba.core import event  # here, so that the commands' help stays light

    timer: threading.Timer | None = None

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:
            del event  # which kernel it is tells nobody anything
            nonlocal timer
            if timer is None:
                timer = threading.Timer(patience, tell, (COMPILING,))
                timer.daemon = True
                timer.start()

        def on_end(self, event: Any) -> None:
            """Another one may follow: the wait is for all of them."""

    with event.install_listener("numba:compile", Listener()):
        try:
            yield
        finally:
            if timer is not None:
                timer.cancel()
