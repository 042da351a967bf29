"""What all tests share: no display, one thread per numerical library, and hypothesis that repeats itself."""

from __future__ import annotations

import os
from pathlib import Path

import hypothesis
import pytest

# Set before anything numerical is imported. Workers share the cores: threads inside a library only get in the way.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("PYVISTA_OFF_SCREEN", "true")

# No deadline: the first example may compile a kernel. Derandomised: the same commit gets the same verdict.
hypothesis.settings.register_profile("evergym", deadline=None, derandomize=True, print_blob=True)
hypothesis.settings.load_profile("evergym")


@pytest.fixture(scope="session")
def checkout() -> Path:
    """The folder that holds pyproject.toml."""
    return Path(__file__).resolve().parents[1]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """List what a documented command was replaced by in `tests/docs`: nothing is left out in silence."""
    smaller = [
        text
        for report in terminalreporter.getreports("passed")
        if isinstance(report, pytest.TestReport)
        for name, text in report.user_properties
        if name == "smaller instance"
    ]
    if smaller:
        terminalreporter.section("documented commands that ran in a smaller instance")
        for text in sorted(smaller):
            terminalreporter.line(str(text))
