"""What gets installed: everything in the tree, under ``evergym`` only, and it works away from the checkout."""

from __future__ import annotations

import ast
import fnmatch
import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path
from typing import Any

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
LINKED = ("agents", "duct_models", "envs")
IDS = ("MammobotDuct-v0", "MammobotPegs-v0", "MammobotDuctGoal-v0", "MammobotPegsGoal-v0")
HEAVY = ("torch", "numba", "vtk", "pyvista", "stable_baselines3", "scipy", "trimesh")


@pytest.fixture(scope="module")
def settings() -> dict[str, Any]:
    return tomllib.loads((CHECKOUT / "pyproject.toml").read_text())


def package_folders() -> dict[str, Path]:
    """Every folder of ours that holds Python files, by its installed name."""
    folders = {}
    for root, names, files in os.walk(CHECKOUT / "evergym", followlinks=True):
        names[:] = [name for name in names if name != "__pycache__"]
        if any(file.endswith(".py") for file in files):
            folders[".".join(Path(root).relative_to(CHECKOUT).parts)] = Path(root)
    return folders


# -- the list of packages


def test_every_package_in_the_tree_is_listed(settings: dict[str, Any]) -> None:
    assert sorted(settings["tool"]["setuptools"]["packages"]) == sorted(package_folders())


def test_every_package_has_an_init_file() -> None:
    assert [name for name, folder in package_folders().items() if not (folder / "__init__.py").is_file()] == []


def test_the_diagnosis_is_a_function_whatever_was_imported_before(tmp_path: Path) -> None:
    code = """
import evergym.discrepancy.stages
from evergym.discrepancy import diagnose, load_dataset, run_stages
import evergym
print(evergym.discrepancy.diagnose is diagnose is evergym.discrepancy.stages.diagnose, callable(diagnose))
"""
    assert run("-c", code, cwd=tmp_path).stdout.split() == ["True", "True"]


@pytest.mark.parametrize("name", LINKED)
def test_top_level_folders_are_mapped_and_linked(settings: dict[str, Any], name: str) -> None:
    assert settings["tool"]["setuptools"]["package-dir"][f"evergym.{name}"] == name
    assert (CHECKOUT / "evergym" / name).readlink() == Path("..", name)


def test_subpackages_of_linked_folders_are_mapped(settings: dict[str, Any]) -> None:
    mapping = settings["tool"]["setuptools"]["package-dir"]
    for package in settings["tool"]["setuptools"]["packages"]:
        assert (CHECKOUT / mapping.get(package, package.replace(".", "/"))).is_dir()


def test_every_data_file_is_packaged(settings: dict[str, Any]) -> None:
    patterns = settings["tool"]["setuptools"]["package-data"]
    lost = []
    for root, names, files in os.walk(CHECKOUT / "evergym", followlinks=True):
        names[:] = [name for name in names if name != "__pycache__"]
        for file in (Path(root) / name for name in files if not name.endswith((".py", ".pyc")) and name[0] != "."):
            package = next(parent for parent in file.parents if (parent / "__init__.py").is_file())
            name = ".".join(package.relative_to(CHECKOUT).parts)
            if not any(fnmatch.fnmatch(str(file.relative_to(package)), pattern) for pattern in patterns.get(name, [])):
                lost.append(str(file.relative_to(CHECKOUT)))
    assert lost == []


# -- dependencies


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def declared(settings: dict[str, Any]) -> set[str]:
    project = settings["project"]
    lines = [*project["dependencies"], *project["optional-dependencies"]["dev"]]
    return {canonical(re.match(r"[\w.-]+", line)[0]) for line in lines}  # type: ignore[index]


def test_every_import_is_a_declared_dependency(settings: dict[str, Any]) -> None:
    providers = importlib.metadata.packages_distributions()
    known = declared(settings)
    missing = set()
    for path in [CHECKOUT / "train.py", *(p for folder in package_folders().values() for p in folder.glob("*.py"))]:
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
            for top in {name.partition(".")[0] for name in names} - set(sys.stdlib_module_names) - {"evergym"}:
                # A compiled module alone (manifold3d) has no entry among the providers; its project has its name.
                if not known & {canonical(provider) for provider in providers.get(top, [top])}:
                    missing.add(f"{path.relative_to(CHECKOUT)} imports {top}")
    assert missing == set()


def test_every_dependency_is_pinned(settings: dict[str, Any]) -> None:
    lines = [line for line in (CHECKOUT / "constraints.txt").read_text().splitlines() if not line.startswith("#")]
    assert [line for line in lines if not re.fullmatch(r"[a-z0-9.-]+==[\w.]+", line)] == []
    assert lines[0].startswith("torch==")  # the Makefile installs it first, by itself
    assert declared(settings) - {line.partition("==")[0] for line in lines} == set()


# -- in the checkout


def run(*arguments: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=cwd,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


def test_import_is_light(tmp_path: Path) -> None:
    code = f"""
import sys, time
start = time.perf_counter()
import evergym
import evergym.discrepancy
print(f"import evergym: {{time.perf_counter() - start:.2f}} s")
print([name for name in {HEAVY} if name in sys.modules])
"""
    result = run("-c", code, cwd=tmp_path)
    print(result.stdout)
    assert result.stdout.splitlines()[-1:] == ["[]"], result.stderr


@pytest.mark.parametrize("name", LINKED)
def test_a_second_copy_of_a_package_is_refused(name: str) -> None:
    result = run("-c", f"import {name}", cwd=CHECKOUT)
    assert result.returncode == 1
    assert f"write 'import evergym.{name}'" in result.stderr


def test_train_is_the_command_line(tmp_path: Path) -> None:
    assert run("train.py", "--help", cwd=CHECKOUT).returncode == 0
    assert run(str(CHECKOUT / "train.py"), "--no-such-option", cwd=tmp_path).returncode == 2


# -- away from the checkout


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which the built wheel is installed; built from a copy, so that no build folder appears here."""
    folder = tmp_path_factory.mktemp("wheel")
    copy = folder / "checkout"
    copy.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(CHECKOUT / name, copy)
    for name in ("evergym", *LINKED):
        shutil.copytree(CHECKOUT / name, copy / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    pip = ("-m", "pip", "--disable-pip-version-check", "--quiet")
    offline = ("--no-deps", "--no-index")
    built = run(*pip, "wheel", *offline, "--no-build-isolation", "-w", str(folder), str(copy), cwd=folder)
    assert built.returncode == 0, built.stderr
    (wheel,) = folder.glob("evergym-*.whl")
    shutil.rmtree(copy)
    result = run(*pip, "install", *offline, "--target", str(folder / "target"), str(wheel), cwd=folder)
    assert result.returncode == 0, result.stderr
    return folder / "target"


def run_installed(code: str, installed: Path, cwd: Path) -> str:
    """Run code that sees the wheel and the dependencies, but (-S: no .pth files) not the editable install."""
    paths = os.pathsep.join([str(installed), sysconfig.get_paths()["purelib"]])
    result = run("-S", "-W", "error", "-c", code, cwd=cwd, PYTHONPATH=paths)
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_only_evergym_is_installed(installed: Path) -> None:
    names = {re.sub(r"-.*\.dist-info", ".dist-info", path.name) for path in installed.iterdir()}
    assert names == {"evergym", "evergym.dist-info", "bin"}
    assert not any(path.is_symlink() for path in installed.rglob("*"))


def test_the_wheel_holds_every_file(installed: Path) -> None:
    for name, folder in package_folders().items():
        there = {path.name for path in installed.joinpath(*name.split(".")).glob("*.py")}
        assert there >= {path.name for path in folder.glob("*.py")}


def test_the_wheel_can_be_imported(installed: Path, tmp_path: Path) -> None:
    code = "from evergym import agents, duct_models, envs; print(*(m.__file__ for m in (agents, duct_models, envs)))"
    files = run_installed(code, installed, tmp_path).split()
    assert [Path(name).parent for name in files] == [installed / "evergym" / name for name in LINKED]


@pytest.mark.parametrize("statement", ["import evergym; prefix = ''", "prefix = 'evergym:'"], ids=["import", "prefix"])
def test_environments_can_be_made_from_the_wheel(installed: Path, tmp_path: Path, statement: str) -> None:
    code = f"""
import sys
import gymnasium
{statement}
for name in {IDS}:
    gymnasium.make(prefix + name).close()
print(*{{module.__file__ for name, module in sys.modules.items() if name.split(".")[0] == "evergym"}})
"""
    files = run_installed(code, installed, tmp_path).split()
    assert len(files) > len(IDS)
    assert all(Path(name).is_relative_to(installed) for name in files)
