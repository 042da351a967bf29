"""``evergym docs``: write the pages of the documentation that say what the code says, or check them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

__all__ = ["Docs"]


@dataclass(frozen=True)
class Docs:
    """Write the generated pages of the documentation: one per environment and one per physical effect."""

    folder: Path = Path("docs")
    """Folder of the documentation; the pages go into its folders environments/ and effects/."""
    check: bool = False
    """Write nothing: name the pages that are not what the code says; the exit code is 1 if there are any."""

    def run(self) -> int:
        """Write or check; returns the exit code."""
        from evergym.agents.generated_pages import find_stale_pages, write_generated_pages

        if not self.check:
            print(f"{write_generated_pages(self.folder)} pages written into {self.folder}")
            return 0
        stale = find_stale_pages(self.folder)
        for name in stale:
            print(f"{self.folder / name} is not what the code says")
        print("Run: evergym docs" if stale else "The generated pages say what the code says.")
        return 1 if stale else 0
