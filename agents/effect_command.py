"""``evergym effects``: list the physical effects, or explain some of them."""

from __future__ import annotations

import dataclasses

import tyro
from rich.console import Console
from rich.table import Table

from evergym.agents.effect_pages import ACTS_ON, EffectPage, describe_depends, describe_effect
from evergym.agents.effect_separations import find_separations
from evergym.agents.suggest import suggest
from evergym.effects.catalogue import EFFECTS
from evergym.errors import ConfigError
from evergym.model import load_model

__all__ = ["ShowEffects"]


@dataclasses.dataclass(frozen=True)
class ShowEffects:
    """List the physical effects, or explain some: law, parameters, sources, signature, and what they are taken for."""

    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Effects to explain (none: list all)."""
    model: str = "mammobot_2023"
    """Model (name or TOML file) whose values are shown beside the defaults."""

    def run(self) -> int:
        """Print; returns the exit code."""
        for name in self.names:
            if name not in EFFECTS:
                raise ConfigError(f"There is no effect '{name}'{suggest(name, EFFECTS)}")
        model = load_model(self.model)
        console = Console(highlight=False, markup=False)
        if not self.names:
            console.print(_tabulate_effects([describe_effect(name, model) for name in EFFECTS], model.name))
            console.print("evergym effects NAME explains one of them.")
        for name in self.names:
            _explain(describe_effect(name, model), model.name, console)
        return 0


def _tabulate_effects(pages: list[EffectPage], model_name: str) -> Table:
    table = Table(title="Physical effects")
    for heading in ("row", "effect", "what it is", "depends on", model_name):
        table.add_column(heading, justify="right" if heading == "row" else "left", no_wrap=heading == "effect")
    for page in sorted(pages, key=lambda page: (page.info.row, page.name)):
        info = page.info
        is_off = bool(info.off) and all(row.present == row.off for row in page.parameters if row.off)
        state = "off" if is_off else "on"
        table.add_row(str(info.row), page.name, page.about, ", ".join(sorted(info.depends_on)), state)
    return table


def _explain(page: EffectPage, model_name: str, console: Console) -> None:
    info = page.info
    console.rule(page.name)
    console.print(page.law)
    table = Table()
    for heading in ("parameter", "unit", "limits", "default", model_name, "off", "visible", "source"):
        table.add_column(heading)
    for row in page.parameters:
        table.add_row(*row)
    console.print(table)
    console.print(f"Row {info.row} of the catalogue; acts on {ACTS_ON[info.acts_on]}.")
    console.print(f"Moves {', '.join(info.moves)}; depends on {describe_depends(info)}.")
    if info.partners:
        console.print(f"Taken for: {', '.join(info.partners)}.")
    for group, text in find_separations(page.name, info.partners):
        console.print(f"{', '.join(group)}: {text}")
