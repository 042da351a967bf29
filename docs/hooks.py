"""What the site has beside its pages: a reference of the commands, and the navigation of the generated pages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from evergym.agents.command_page import compose_command_page


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """List the pages of a generated folder after its README.md, which is all that the navigation names."""
    docs = Path(config.docs_dir)
    config.nav = _expand(config.nav or [], docs)
    named = set(_list_pages(config.nav))
    left = sorted(str(path.relative_to(docs)) for path in docs.rglob("*.md"))
    if others := [name for name in left if name not in named]:
        config.nav.append({"More": others})  # a new page is found before somebody has found its place
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the reference of the commands, which is written anew for every site and so is never stale."""
    files.append(File.generated(config, "commands.md", content=compose_command_page()))
    return files


def _list_pages(entry: Any) -> list[str]:
    """Return every page that a part of the navigation names."""
    if isinstance(entry, str):
        return [entry]
    return [name for part in (entry.values() if isinstance(entry, dict) else entry) for name in _list_pages(part)]


def _expand(entry: Any, docs: Path) -> Any:
    """Return a part of the navigation with the pages beside every ``<folder>/README.md`` in a list."""
    if isinstance(entry, dict):
        return {title: _expand(value, docs) for title, value in entry.items()}
    if not isinstance(entry, list):
        return entry
    expanded = []
    for item in entry:
        expanded.append(_expand(item, docs))
        if isinstance(item, str) and item.endswith("/README.md"):
            others = sorted(path for path in (docs / item).parent.glob("*.md") if path.name != "README.md")
            expanded += [{path.stem: str(path.relative_to(docs))} for path in others]
    return expanded
