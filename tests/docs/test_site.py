"""The site builds without a warning and needs nothing from elsewhere; its generated pages say what the code says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from evergym.agents.cli import COMMANDS, main
from evergym.agents.env_pages import split_sections
from evergym.agents.generated_pages import compose_generated_pages, find_stale_pages
from evergym.agents.play.readout import KEYS

CHECKOUT = Path(__file__).resolve().parents[2]
FETCHED = re.compile(r"<(?:script|link|img|iframe|source)\b[^>]*?\b(?:src|href)=[\"']?(?:https?:)?//", re.IGNORECASE)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    folder = tmp_path_factory.mktemp("site")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NO_MKDOCS_2_WARNING", "1")
        # strict: a broken link, a page that the navigation leaves out, a missing anchor end the build.
        build(load_config(str(CHECKOUT / "mkdocs.yml"), site_dir=str(folder), strict=True))
    return folder


def test_every_page_is_built(site: Path) -> None:
    pages = [path.relative_to(CHECKOUT / "docs").with_suffix(".html") for path in (CHECKOUT / "docs").rglob("*.md")]
    built = [page.with_name("index.html") if page.stem == "README" else page for page in pages]
    assert [str(page) for page in built if not (site / page).is_file()] == []


def test_the_reader_fetches_nothing(site: Path) -> None:
    found = [str(path.relative_to(site)) for path in site.rglob("*.html") if FETCHED.search(path.read_text("utf-8"))]
    assert found == []
    styles = [str(path.relative_to(site)) for path in site.rglob("*.css") if "url(http" in path.read_text("utf-8")]
    assert styles == []


def test_every_command_is_explained(site: Path) -> None:
    text = (site / "commands.html").read_text("utf-8")
    assert [name for name in COMMANDS if f'id="evergym-{name.replace(" ", "-")}"' not in text] == []
    assert text.count("--help") >= len(COMMANDS)


def test_generated_pages_say_what_the_code_says() -> None:
    assert find_stale_pages(CHECKOUT / "docs") == [], "run: evergym docs"


def test_every_argument_of_an_environment_is_explained() -> None:
    for name, text in compose_generated_pages().items():
        if name.startswith("environments/Mammobot"):
            above, _, table = split_sections(text)[1]["Arguments of ``gymnasium.make``"].partition("| argument |")
            named = re.findall(r"^\| `(\w+)` \|.*\| see above \|$", table, re.MULTILINE)
            assert named, name
            assert [argument for argument in named if f"`{argument}`" not in above] == [], name


def test_every_key_of_the_player_is_listed() -> None:
    text = (CHECKOUT / "docs" / "play.md").read_text("utf-8")
    rows = [f"| {key} | {back} | {meaning} |".replace("|  |", "| |") for key, back, meaning in KEYS]
    assert [row for row in rows if row not in text] == []


def test_command_writes_and_checks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new"
    assert main(["docs", "--folder", str(folder), "--check"]) == 1
    assert "environments/MammobotDuct-v0.md is not" in capsys.readouterr().out
    assert main(["docs", "--folder", str(folder)]) == 0
    assert main(["docs", "--folder", str(folder), "--check"]) == 0
    (folder / "effects" / "tendon_friction.md").write_text("stale")
    (folder / "effects" / "no_such_effect.md").write_text("stale")
    assert find_stale_pages(folder) == ["effects/no_such_effect.md", "effects/tendon_friction.md"]


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["docs", "--folder", str(tmp_path / "file" / "docs")]) == 1
    assert "cannot be written" in capsys.readouterr().err
