"""What is known about each physical effect, as a page: law, parameters, signature, and what tells it from its partners.

All of it is read from the effects themselves (docstrings, `evergym.config.parameter`, `EffectInfo`), so that a page
cannot say anything else than the model does; only the experiments that separate partners are written down, in
`evergym.agents.effect_separations`.
"""

from __future__ import annotations

import dataclasses
import inspect
import sys
from typing import NamedTuple

import tomli_w

from evergym.agents.effect_separations import find_separations
from evergym.config import ParameterInfo, iterate_parameters
from evergym.effects.catalogue import EFFECTS
from evergym.effects.information import EffectInfo
from evergym.model import Model, load_model

__all__ = [
    "ACTS_ON",
    "EffectPage",
    "ParameterRow",
    "compose_effect_pages",
    "describe_depends",
    "describe_effect",
]

ACTS_ON = {
    "state": "the state: what the robot does",
    "lattice": "the lattice: the springs that the robot is made of",
    "sensor": "a sensor: what is read, not what the robot does",
}
DEPENDS_ON = {
    "pressure": "the pressure",
    "rate": "rates and time",
    "orientation": "the direction of gravity, of the load or of the notches",
    "history": "what was done before (hysteresis, memory)",
    "length": "the length that is outside the port",
}


class ParameterRow(NamedTuple):
    """One parameter of an effect, as text."""

    key: str
    unit: str
    limits: str
    default: str
    present: str
    """Value in the model that is described."""
    off: str
    """Value that switches the effect off; empty where it need not change."""
    typical: str
    """Value at which the effect is clearly visible; empty where it need not change."""
    source: str


@dataclasses.dataclass(frozen=True)
class EffectPage:
    """What is known about one effect.

    Attributes:
        name: As in model files.
        info: Row of the catalogue, signature, partners and values.
        about: What it is, in a sentence.
        law: The law, its limits and its source.
        parameters: Its parameters.
    """

    name: str
    info: EffectInfo
    about: str
    law: str
    parameters: tuple[ParameterRow, ...]


def describe_effect(name: str, model: Model) -> EffectPage:
    """Return what is known about the effect ``name``, with its values in ``model``."""
    kind = EFFECTS[name]
    info = kind.info
    present = getattr(model.effects, name)
    rows = tuple(
        ParameterRow(
            key,
            "" if isinstance(default, bool) else known.unit,
            "on or off" if isinstance(default, bool) else known.describe_limits().removesuffix(f" {known.unit}"),
            _format(default),
            _format(getattr(present, key)),
            _format(info.off.get(key)),
            _format(info.typical.get(key)),
            _describe_source(known),
        )
        for key, known, default in iterate_parameters(kind)
    )
    heading = (inspect.getdoc(sys.modules[kind.__module__]) or name).split("\n\n")[0]
    about = " ".join(heading.split()).partition(": ")[2] or heading
    return EffectPage(name, info, about[0].upper() + about[1:], inspect.getdoc(kind) or "", rows)


def describe_depends(info: EffectInfo) -> str:
    """Return what the effect depends on, in words."""
    return "; ".join(text for key, text in DEPENDS_ON.items() if key in info.depends_on) or "none of these"


def compose_effect_pages(model_name: str = "mammobot_2023") -> dict[str, str]:
    """Return the Markdown text of every page and of the index, by file name, with the values of a model beside."""
    model = load_model(model_name)
    pages = [describe_effect(name, model) for name in EFFECTS]
    texts = {f"{page.name}.md": _compose_page(page, model.name) for page in pages}
    return {"README.md": _compose_index(pages), **texts}


def _compose_page(page: EffectPage, model_name: str) -> str:
    info = page.info
    lines = [f"# {page.name}", "", page.about, "", "## Law", "", page.law, "", "## Parameters", ""]
    lines += [
        f"| key | unit | limits | default | {model_name} | off | visible | source |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += ["| " + " | ".join([f"`{row.key}`", *row[1:]]) + " |" for row in page.parameters]
    lines += ["", "## Signature", "", f"- row {info.row} of the catalogue"]
    lines += [f"- acts on {ACTS_ON[info.acts_on]}", f"- moves: {', '.join(info.moves)}"]
    lines += [f"- depends on: {describe_depends(info)}", "", "## What it is taken for", ""]
    lines += [", ".join(f"[{name}]({name}.md)" for name in info.partners) or "Nothing in the catalogue."]
    for group, text in find_separations(page.name, info.partners):
        lines += ["", f"**{', '.join(group)}**: {text}"]
    if info.typical:
        table = tomli_w.dumps({"effects": {page.name: dict(info.typical)}}).strip()
        lines += ["", "## In a model file", "", "```toml", table, "```", ""]
        lines += ["Values at which it is clearly visible, not measurements."]
    return "\n".join([*lines, ""])


def _compose_index(pages: list[EffectPage]) -> str:
    lines = [
        "# The effects",
        "",
        "Written by `evergym docs`; a test keeps these pages true.",
        "",
    ]
    lines += ["| row | effect | what it is | acts on | moves | depends on |", "|---|---|---|---|---|---|"]
    for page in sorted(pages, key=lambda page: (page.info.row, page.name)):
        info = page.info
        depends = ", ".join(key for key in DEPENDS_ON if key in info.depends_on)
        link = f"[{page.name}]({page.name}.md)"
        lines.append(f"| {info.row} | {link} | {page.about} | {info.acts_on} | {', '.join(info.moves)} | {depends} |")
    return "\n".join([*lines, ""])


def _describe_source(known: ParameterInfo) -> str:
    text = ". ".join(part.rstrip(".") for part in (known.help, known.source) if part)
    return f"prior; {text}".rstrip("; ") if known.prior else text


def _format(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:g}" if isinstance(value, float | int) else str(value)
