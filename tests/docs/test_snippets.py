"""Every command and snippet of the README and of the documentation runs.

A page's blocks run in order, in one folder and one Python namespace. What would take too long says, in a comment right
before it, what smaller instance runs instead; the summary at the end of the session lists these:

    <!-- test: evergym train --total-steps 64 --env-count 1 -->

``<!-- before: ... -->`` runs first and is not replaced: it makes what the block takes for granted.
"""

from __future__ import annotations

import dataclasses
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest
from markdown_it import MarkdownIt

from evergym.agents.cli import main
from evergym.config import build
from evergym.model import Model, check_model

CHECKOUT = Path(__file__).resolve().parents[2]
PAGES = ["README.md", *sorted(str(path.relative_to(CHECKOUT)) for path in (CHECKOUT / "docs").rglob("*.md"))]
RUN = {"python", "bash", "toml", "json"}
SHOWN = {"text", "csv"}
"""Languages of blocks that are only shown."""
LONG = {
    *("train", "evaluate", "tune", "identify", "validate", "bench", "scenario", "soak", "diagnose", "blind"),
    *("play", "replay", "rehearse"),
}
"""Commands that may take minutes: a block with one must say what runs instead."""
STAND_INS = {
    "evergym dataset check DIR": {
        "language": "bash",
        "instead": """evergym dataset export-paper paper --figures fig7
evergym dataset check paper
evergym dataset show paper --out runs.png""",
    },
    "schema = 1": {"language": "toml"},
    "from evergym import load_model": {
        "language": "python",
        "before": """from evergym.agents.cli import main
assert main(["dataset", "export-paper", "bench-2026-03", "--figures", "fig7"]) == 0""",
    },
    "from evergym.discrepancy.data.record import Recorder": {
        "language": "python",
        "before": """import numpy as np
from evergym import Command, Simulator, World
rng, noise = np.random.default_rng(0), {"tip_x_mm": 0.3}
simulator = Simulator(model, World.free())
simulator.reset(everted_length=0.05)
command = Command(tendon_pull=3e-3, pressure=2e4)""",
    },
    "from evergym.agents.recording import EpisodeRecording": {
        "language": "python",
        "instead": """import gymnasium
from evergym.agents.recording import EpisodeRecording
env = EpisodeRecording(gymnasium.make("MammobotPegs-v0"))
env.reset(seed=0)
env.step(env.action_space.sample())
env.write("episodes", {"tip_x_mm": 0.3, "tip_z_mm": 0.3}, rng)""",
    },
}
"""For the indented blocks of docs/datasets.md, which have no language: what they are, or what runs, by their start."""
DIRECTIVE = re.compile(r"\A\s*<!--\s*(test|before):(.*?)-->\s*\Z", re.DOTALL)


@dataclasses.dataclass(frozen=True)
class Block:
    """A block of code, where it stands, and what its comments say."""

    page: str
    line: int
    language: str
    text: str
    instead: str = ""
    before: str = ""

    @property
    def place(self) -> str:
        return f"{self.page}:{self.line}"


def find_blocks(page: str, text: str) -> list[Block]:
    """Return the blocks of a page; an indented one has no language."""
    blocks, directives = [], {}
    for token in MarkdownIt().parse(text):
        line = token.map[0] + 1 if token.map else 0
        if token.type == "html_block" and (match := DIRECTIVE.match(token.content)):
            directives[match[1]] = match[2].strip("\n ")
        elif token.type in ("fence", "code_block"):
            block = Block(
                page, line, token.info.strip(), token.content, directives.pop("test", ""), directives.pop("before", "")
            )
            stand_in = [known for start, known in STAND_INS.items() if token.content.startswith(start)]
            if token.type == "code_block" and page == "docs/datasets.md" and stand_in:
                block = dataclasses.replace(block, **stand_in[0])
            blocks.append(block)
        elif token.type not in ("paragraph_open", "inline", "paragraph_close") and directives:
            raise AssertionError(f"{page}:{line}: a comment {sorted(directives)} without a block right after it")
    assert not directives, f"{page}: a comment {sorted(directives)} without a block"
    return blocks


def find_faults(blocks: list[Block]) -> list[str]:
    """Return what is wrong with the blocks themselves."""
    faults = []
    for block in blocks:
        if block.language not in RUN | SHOWN:
            faults.append(
                f"{block.place}: the block's language is {block.language!r}; fence it as {sorted(RUN | SHOWN)}"
            )
        if block.language == "bash" and not block.instead:
            found = split_commands(block.text)
            long = {words[words.index("evergym") + 1] for words in found if "evergym" in words[:2]} & LONG
            if long:
                faults.append(f"{block.place}: {sorted(long)} may take long; say what runs instead: <!-- test: ... -->")
    return faults


def split_commands(text: str) -> list[list[str]]:
    """Return the words of each command; comments and continued lines as in a shell."""
    lines = text.replace("\\\n", " ").splitlines()
    return [words for line in lines if (words := shlex.split(line, comments=True))]


def run_commands(text: str, folder: Path, place: str) -> None:
    """Run each command: ours in this process, where compiled code is loaded once, others in a shell."""
    for words in split_commands(text):
        if words[0] == "PYTHONPATH=.":
            words, paths = words[1:], [str(folder)]
        else:
            paths = []
        if words[0] == "evergym":
            sys.path[:0] = paths
            try:
                code = main(words[1:])
            except SystemExit as leaving:  # --help
                code = int(leaving.code or 0)
            finally:
                del sys.path[: len(paths)]
            plt.close("all")
        else:
            # Targets of make are held to exist: `make -n` says what would be done.
            where = CHECKOUT if words[0] == "make" else folder
            path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
            ended = subprocess.run(
                words,
                cwd=where,
                env={**os.environ, "PATH": path},
                capture_output=True,
                text=True,
                timeout=600,
                check=False,
            )
            code = ended.returncode
            print(ended.stdout, ended.stderr)
        assert code == 0, f"{place}: '{shlex.join(words)}' ended with {code}"


def check_toml(text: str, place: str) -> None:
    """Read a table of TOML; one of a model must be a model's."""
    table = tomllib.loads(text)
    if "effects" in table or ("robot" in table and "run" not in table):
        check_model(build(Model, table, place), place)


def run_block(block: Block, folder: Path, namespace: dict[str, Any]) -> None:
    for text in (block.before, block.instead or block.text):
        if not text:
            continue
        if block.language == "python":
            # Line numbers of an error are those of the page.
            code = compile("\n" * block.line + text, f"<{block.page}>", "exec")
            exec(code, namespace)
            plt.close("all")
        elif block.language == "bash":
            run_commands(text, folder, block.place)
        elif block.language == "toml":
            check_toml(text, block.place)
        elif block.language == "json":
            json.loads(text)


def read(page: str) -> list[Block]:
    return find_blocks(page, (CHECKOUT / page).read_text(encoding="utf-8"))


WITH_BLOCKS = [page for page in PAGES if read(page)]


@pytest.mark.parametrize("page", WITH_BLOCKS)
def test_every_block_runs(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, record_property: Any) -> None:
    blocks = read(page)
    assert find_faults(blocks) == []
    monkeypatch.chdir(tmp_path)
    shutil.copytree(CHECKOUT / "docs" / "examples", tmp_path / "examples")
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for block in blocks:
        run_block(block, tmp_path, namespace)
        if block.instead:
            smaller = " | ".join(block.instead.split("\n"))
            record_property("smaller instance", f"{block.place}: {smaller}")


# -- the test itself can fail


def test_blocks_and_comments_are_found() -> None:
    comments = "<!-- before: evergym effects -->\n<!-- test: evergym docs --check -->\n"
    text = f"# A\n\n{comments}```bash\nevergym train\n```\n\n    x = 1\n"
    first, second = find_blocks("a.md", text)
    assert (first.language, first.line, first.text) == ("bash", 5, "evergym train\n")
    assert (first.before, first.instead) == ("evergym effects", "evergym docs --check")
    assert find_faults([first]) == []
    assert find_faults([dataclasses.replace(first, instead="")]) != []
    assert find_faults([second]) != []


def test_a_comment_needs_its_block() -> None:
    with pytest.raises(AssertionError, match="without a block"):
        find_blocks("a.md", "<!-- test: x -->\n\n# Heading\n\n```bash\nevergym effects\n```\n")


@pytest.mark.parametrize(
    ("language", "text", "error"),
    [
        ("bash", "evergym effects no_such_effect", AssertionError),
        ("bash", "evergym effects \\\n  --no-such-option", AssertionError),
        ("bash", "false", AssertionError),
        ("python", "1 / 0", ZeroDivisionError),
        ("toml", "[effects.tendon_friction]\nmuu = 0.1", Exception),
        ("json", "{", ValueError),
    ],
)
def test_a_wrong_block_fails(language: str, text: str, error: type[Exception], tmp_path: Path) -> None:
    with pytest.raises(error):
        run_block(Block("a.md", 1, language, text), tmp_path, {})


def test_every_link_of_the_readme_is_there() -> None:
    """The site's links are held by its build, the README's by this."""
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", (CHECKOUT / "README.md").read_text(encoding="utf-8"))
    assert links
    assert [link for link in links if not (CHECKOUT / link).exists()] == []
