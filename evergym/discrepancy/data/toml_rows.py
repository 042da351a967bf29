"""In which row of a dataset.toml something stands: the parser forgets it, and messages need it."""

from __future__ import annotations

import re

__all__ = ["add_row", "find_row"]

_HEADER = re.compile(r"\s*\[{1,2}\s*([\w.-]+)\s*\]{1,2}")
_PATH = re.compile(r"(?:(?P<table>\w+)(?:\[(?P<index>\d+)\])?\.)?(?P<key>\w+)(?:\[\d+\])? (?:is|must|has) ")
_QUOTED = re.compile(
    r"'(?:(?P<table>\w+)(?:\[(?P<index>\d+)\])?\.)?(?P<key>\w+)'(?: in \[(?P<where>\w+)(?:\[(?P<at>\d+)\])?\])?"
)


def find_row(text: str, table: str = "", key: str = "", index: int = 0) -> int | None:
    """Return the row of a key, or of its table's header where the key is not there; None where that is not either.

    Args:
        text: The file's.
        table: Name of the key's table; empty: before all tables.
        key: Its name; empty: the table itself.
        index: Which of several tables of this name (``[[run]]``), from 0.
    """
    current, seen, header = "", -1, None
    for number, line in enumerate(text.splitlines(), start=1):
        found = _HEADER.match(line)
        if found:
            current = found[1]
            if current == table:
                seen += 1
                if seen == index:
                    header = number
            continue
        if (
            current == table
            and (not table or seen == index)
            and re.match(rf"\s*[\"']?{re.escape(key)}[\"']?\s*=", line)
        ):
            if key:
                return number
    return header


def add_row(message: str, path: str, text: str) -> str:
    """Return a message of `evergym.config` about a file with the row of the key that it is about."""
    head, separator, rest = message.partition(f"{path}: ")
    if head or not separator:
        return message
    found = _PATH.match(rest) or _QUOTED.search(rest)
    if found is None:
        return message
    parts = found.groupdict()
    table = parts["table"] or parts.get("where") or ""
    row = find_row(text, table, parts["key"], int(parts["index"] or parts.get("at") or 0))
    return message if row is None else f"{path}, row {row}: {rest}"
