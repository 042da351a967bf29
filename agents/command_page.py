"""The reference of the command line: what ``evergym <command> --help`` prints, for every command."""

from __future__ import annotations

import contextlib
import io
import os
from unittest import mock

from evergym.agents.cli import COMMANDS, main

__all__ = ["compose_command_page", "read_help"]

WIDTH = 100
"""Columns of the texts."""


def read_help(command: str) -> str:
    """Return what ``evergym <command> --help`` prints."""
    printed = io.StringIO()
    with (
        # The width of a terminal and its colours must not depend on where the page is written.
        mock.patch.dict(os.environ, {"COLUMNS": str(WIDTH), "NO_COLOR": "1"}),
        contextlib.redirect_stdout(printed),
        contextlib.suppress(SystemExit),  # as argparse leaves after --help
    ):
        main([*command.split(), "--help"])
    return "\n".join(line.rstrip() for line in printed.getvalue().strip().splitlines())


def compose_command_page() -> str:
    """Return the Markdown text of the page."""
    lines = ["# The commands", "", "| command | what it does |", "|---|---|"]
    lines += [
        f"| [`evergym {name}`](#evergym-{name.replace(' ', '-')}) | {entry.summary} |"
        for name, entry in COMMANDS.items()
    ]
    for name in COMMANDS:
        lines += ["", f"## evergym {name}", "", "```text", read_help(name), "```"]
    return "\n".join([*lines, ""])
