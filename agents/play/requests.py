"""Requests between threads: anybody asks, the one thread that owns the robot does."""

from __future__ import annotations

from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any

from evergym.errors import EvergymError

__all__ = ["Desk"]


class Desk:
    """Takes requests from any thread, and has them done by the thread that calls `answer`."""

    def __init__(self) -> None:
        self.notices: list[tuple[str, bool]] = []
        """Messages for people and whether they are errors, until a page has shown them."""
        self._requests: SimpleQueue[Callable[[], Any]] = SimpleQueue()

    def post(self, request: Callable[[], Any]) -> None:
        """Ask for something; it is done before the next frame."""
        self._requests.put(request)

    def answer(self) -> None:
        """Do what has been asked for; what cannot be done becomes a notice."""
        while True:
            try:
                request = self._requests.get_nowait()
            except Empty:
                return
            try:
                request()
            except EvergymError as error:
                self.notices.append((str(error), True))
