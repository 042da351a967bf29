"""The shape of the code base: who may import whom, and how large a file may grow."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
LINE_LIMIT = 400
FORBIDDEN_STEMS = {"common", "helper", "helpers", "misc", "util", "utils"}

# From the lowest layer up. A module belongs to the last entry that is its name or a package above it.
LAYERS = {
    "evergym.units": 0,
    "evergym.errors": 0,
    "evergym.cache": 0,
    "evergym.config": 0,
    "evergym.jit": 0,
    "evergym.whole_file": 0,
    "evergym.duct_models": 1,
    "evergym": 2,
    "evergym.discrepancy.data": 3,
    "evergym.discrepancy": 4,
    "evergym.discrepancy.blind": 5,
    "evergym.envs": 6,
    "evergym.agents": 7,
    "train": 8,
}
# Heavy or telling libraries, and the only modules and packages that may import them.
RESERVED = {
    "numba": {"evergym.jit", "evergym.compilation"},
    "gymnasium": {"evergym", "evergym.envs", "evergym.agents"},
    "torch": {"evergym.agents"},
    "stable_baselines3": {"evergym.agents"},
    "sb3_contrib": {"evergym.agents"},
}


def module_files() -> dict[str, Path]:
    """Every module that is ours, by import path, with the file behind the links."""
    found = {"train": CHECKOUT / "train.py"}
    for folder, package in {
        "evergym": "evergym",
        **{n: f"evergym.{n}" for n in ("envs", "agents", "duct_models")},
    }.items():
        for path in sorted((CHECKOUT / folder).rglob("*.py")):
            parts = path.relative_to(CHECKOUT / folder).with_suffix("").parts
            if folder == "evergym" and parts[0] in ("envs", "agents", "duct_models"):
                continue  # through a link
            found[".".join([package, *(parts[:-1] if parts[-1] == "__init__" else parts)])] = path
    return found


MODULES = module_files()
PYTHON_FILES = sorted({*MODULES.values(), *(CHECKOUT / "tests").rglob("*.py")})


def layer(module: str) -> int:
    while module not in LAYERS:
        module = module.rpartition(".")[0]
    return LAYERS[module]


def imported_modules(text: str, known: set[str]) -> Iterator[tuple[int, str]]:
    """(line, module) of every import statement, also those inside functions."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: relative import"
            for alias in node.names:
                submodule = f"{node.module}.{alias.name}"
                yield node.lineno, submodule if submodule in known else str(node.module)


def upward_imports(module: str, text: str) -> list[str]:
    return [
        f"line {line}: {module} imports {other}"
        for line, other in imported_modules(text, set(MODULES))
        if other.partition(".")[0] in ("evergym", "train") and layer(other) > layer(module)
    ]


def reserved_imports(module: str, text: str) -> list[str]:
    found = []
    for line, other in imported_modules(text, set(MODULES)):
        allowed = RESERVED.get(other.partition(".")[0])
        # "evergym" itself stands for its __init__ only, or it would allow everything.
        if allowed and not any(
            module == name or (name != "evergym" and module.startswith(f"{name}.")) for name in allowed
        ):
            found.append(f"line {line}: {module} imports {other}")
    return found


def test_the_walk_finds_every_folder() -> None:
    assert {"train", "evergym", "evergym.jit", "evergym.envs", "evergym.agents", "evergym.duct_models"} <= set(MODULES)


@pytest.mark.parametrize("module", MODULES)
def test_imports_point_downwards(module: str) -> None:
    assert upward_imports(module, MODULES[module].read_text()) == []


@pytest.mark.parametrize("module", MODULES)
def test_reserved_libraries_stay_where_they_belong(module: str) -> None:
    assert reserved_imports(module, MODULES[module].read_text()) == []


@pytest.mark.parametrize(
    ("module", "text"),
    [
        ("evergym.units", "import evergym.duct_models"),
        ("evergym.jit", "from evergym import Simulator"),
        ("evergym.duct_models.field", "def f():\n    from evergym.world import World"),
        ("evergym.simulator", "from evergym.envs import duct"),
        ("evergym.simulator", "from evergym.discrepancy import diagnose"),
        ("evergym.discrepancy.data.reading", "from evergym.discrepancy.simulate import simulate_run"),
        ("evergym.discrepancy.stages", "from evergym.discrepancy.blind.truth import Truth"),
        ("evergym.effects.burst_limit", "if TYPE_CHECKING:\n    import evergym.envs.duct"),
        ("evergym.envs.duct", "from evergym import agents"),
        ("evergym.agents.cli", "import train"),
    ],
)
def test_an_upward_import_is_seen(module: str, text: str) -> None:
    assert len(upward_imports(module, text)) == 1


@pytest.mark.parametrize(
    ("module", "text"),
    [
        ("evergym.stepper", "import numba"),
        ("evergym.simulator", "import gymnasium as gym"),
        ("evergym.envs.duct", "from torch import nn"),
        ("evergym.duct_models.field", "from numba.core import types"),
    ],
)
def test_a_misplaced_library_is_seen(module: str, text: str) -> None:
    assert len(reserved_imports(module, text)) == 1


@pytest.mark.parametrize("path", PYTHON_FILES, ids=lambda path: str(path.relative_to(CHECKOUT)))
def test_files_are_short_and_named_for_what_they_hold(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= LINE_LIMIT, f"{path.name} holds more than one idea: split it"
    assert path.stem not in FORBIDDEN_STEMS, f"{path.name} says nothing about its content"


@pytest.mark.parametrize(
    "module", [name for name in MODULES if name != "train" and not name.rpartition(".")[2].startswith("_")]
)
def test_public_modules_list_their_public_names(module: str) -> None:
    names = [
        target.id
        for node in ast.parse(MODULES[module].read_text()).body
        for target in (node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)])
        if isinstance(target, ast.Name)
    ]
    assert "__all__" in names
