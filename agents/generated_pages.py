"""The pages of the documentation that are written from the code: which they are, and which of them are stale."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from evergym.agents.effect_pages import compose_effect_pages
from evergym.agents.env_pages import compose_env_pages
from evergym.errors import RunError
from evergym.whole_file import write_whole

__all__ = ["GENERATED", "compose_generated_pages", "find_stale_pages", "write_generated_pages"]

GENERATED: dict[str, Callable[[], dict[str, str]]] = {
    "effects": compose_effect_pages,
    "environments": compose_env_pages,
}
"""Each folder of pages that are written from the code, and what returns their texts by file name."""


def compose_generated_pages() -> dict[str, str]:
    """Return the text of every page, by its path in the documentation's folder."""
    return {f"{folder}/{name}": text for folder, compose in GENERATED.items() for name, text in compose().items()}


def find_stale_pages(docs: Path) -> list[str]:
    """Return the pages in ``docs`` that are missing, do not say what the code says, or are no longer written."""
    expected = compose_generated_pages()
    found = {f"{folder}/{path.name}": path for folder in GENERATED for path in (docs / folder).glob("*.md")}
    texts = {name: path.read_text(encoding="utf-8") for name, path in found.items()}
    return sorted(name for name in expected.keys() | texts.keys() if expected.get(name) != texts.get(name))


def write_generated_pages(docs: Path) -> int:
    """Write the pages into their folders and return how many there are.

    Raises:
        RunError: A folder cannot be written.
    """
    pages = compose_generated_pages()
    try:
        for name, text in pages.items():
            path = docs / name
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, text)
    except OSError as error:
        raise RunError(
            f"The pages cannot be written into '{docs}': {error.strerror}. Choose another folder."
        ) from error
    return len(pages)
