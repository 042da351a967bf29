"""Files that are there whole or not at all, however a process ends."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["whole_file", "write_whole"]


@contextmanager
def whole_file(path: Path, keep_ending: bool = False) -> Iterator[Path]:
    """Give a hidden path beside ``path`` to write to; the file takes its place when all went well, else it is removed.

    Args:
        path: Of the file; its folder must exist.
        keep_ending: Let the hidden name end as that of ``path`` does, for writers that go by it; else it ends in
            ".part", so that nobody takes it for such a file.

    Raises:
        OSError: the file cannot be written.
    """
    token = secrets.token_hex(4)
    draft = path.with_name(f".{token}-{path.name}" if keep_ending else f".{path.name}.{token}.part")
    try:
        yield draft
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file whole or not at all; text as UTF-8, its line ends as they are.

    Raises:
        OSError: the file cannot be written.
    """
    with whole_file(path) as draft:
        draft.write_bytes(content.encode() if isinstance(content, str) else content)
