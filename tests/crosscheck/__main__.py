"""Print what this simulator and independent ones say about a sagging rod: ``python -m tests.crosscheck``.

PyElastica and MuJoCo come with ``pip install -c constraints.txt -e '.[crosscheck]'``; one that is missing is left out.
"""

from __future__ import annotations

import importlib
import importlib.util

from rich.console import Console
from rich.table import Table

from tests.crosscheck.sag_case import EXACT_TIP_MM, Result, run_evergym

RODS = {"elastica": ("pyelastica_rod", "run_pyelastica"), "mujoco": ("mujoco_rod", "run_mujoco")}


def collect_results() -> list[Result]:
    """Return the results of this simulator and of every other one that is installed."""
    results = [run_evergym(links=25), run_evergym()]
    for package, (module, function) in RODS.items():
        if importlib.util.find_spec(package) is not None:
            results.append(getattr(importlib.import_module(f"tests.crosscheck.{module}"), function)())
    return results


def main() -> None:
    """Print the table."""
    table = Table(title="Sag of a clamped rod: L 0.1 m, r 0.8 mm, E 40 MPa, 1000 kg/m^3")
    for heading in ("simulator", "method", "elements", "x, mm", "y, mm", "error, um", "CPU, s"):
        table.add_column(heading, justify="left" if heading in ("simulator", "method") else "right")
    table.add_row("exact", "inextensible elastica", "", f"{EXACT_TIP_MM[0]:.4f}", f"{EXACT_TIP_MM[1]:.4f}", "", "")
    for result in collect_results():
        x, y = result.tip_mm
        table.add_row(
            result.name,
            result.method,
            str(result.elements),
            f"{x:.4f}",
            f"{y:.4f}",
            f"{result.error_mm * 1e3:.2f}",
            f"{result.cpu_s:.4f}",
        )
    console = Console(width=100)
    console.print(table)
    for package in RODS:
        if importlib.util.find_spec(package) is None:
            console.print(f"{package} is not installed: pip install -c constraints.txt -e '.\\[crosscheck]'")


if __name__ == "__main__":
    main()
