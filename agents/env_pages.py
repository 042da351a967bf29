"""What an environment's page says: all of it is read from the code, so that it cannot say anything else.

The class docstring is the specification. A docstring that leaves out a section and names another class ("as in
``MammobotDuctEnv``") has that section from there. Spaces, limits, arguments and weights come from an instance.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
from collections.abc import Iterable, Mapping
from typing import Any

import docstring_parser
import gymnasium

import evergym
from evergym.envs.base import MammobotEnv
from evergym.envs.drive import DriveLimits
from evergym.envs.observation import observation_table
from evergym.envs.settings import EpisodeSettings, RewardSettings
from evergym.units import DEG, KPA, MM

__all__ = ["compose_env_pages", "describe_attributes", "find_env_class", "split_sections"]

_PEOPLE = {
    "m": (MM, "mm"),
    "m/s": (MM, "mm/s"),
    "Pa": (KPA, "kPa"),
    "Pa/s": (KPA, "kPa/s"),
    "rad/s": (DEG, "deg/s"),
}
"""What an SI unit is written as, and the factor."""
_NAMED = re.compile(r"``(\w+)``")
_ARGUMENTS = "Arguments of ``gymnasium.make``"


def find_env_class(env_id: str) -> type[MammobotEnv]:
    """Return the class behind a registered id."""
    module, _, name = evergym.ENTRY_POINTS[env_id].partition(":")
    found: type[MammobotEnv] = getattr(importlib.import_module(module), name)
    return found


def compose_env_pages() -> dict[str, str]:
    """Return the Markdown text of every environment's page and of the index, by file name."""
    classes = {env_id: find_env_class(env_id) for env_id in evergym.ENTRY_POINTS}
    pages = {f"{env_id}.md": _compose_page(env_id, classes) for env_id in classes}
    return {"README.md": _compose_index(classes), **pages}


def split_sections(text: str) -> tuple[str, dict[str, str]]:
    """Return what comes before the first ``## `` heading of a docstring, and the sections by heading."""
    first, *rest = re.split(r"^## +", text, flags=re.MULTILINE)
    sections = {}
    for part in rest:
        heading, _, body = part.partition("\n")
        sections[heading.strip()] = body.strip()
    return first.strip(), sections


def describe_attributes(kind: type) -> dict[str, str]:
    """Return the meaning of each attribute, from the ``Attributes`` section of a class docstring."""
    params = docstring_parser.parse(inspect.getdoc(kind) or "", style=docstring_parser.DocstringStyle.GOOGLE).params
    return {entry.arg_name: " ".join((entry.description or "").split()) for entry in params}


def _order_sources(start: type, classes: Iterable[type]) -> list[type]:
    """Return the class and those whose sections it may have: the ones that docstrings name, nearest first."""
    known = {kind.__name__: kind for kind in classes}
    order = [start]
    for kind in order:  # grows while it is walked: breadth first
        named = [known[name] for name in _NAMED.findall(inspect.getdoc(kind) or "") if name in known]
        order += [found for found in dict.fromkeys(named) if found not in order]
    return order


def _collect_sections(sources: list[type]) -> dict[str, tuple[str, type]]:
    """Return every section's text with the class that it is from, in the order of the most complete docstring."""
    split = {kind: split_sections(inspect.getdoc(kind) or "")[1] for kind in sources}
    order: list[str] = []
    for kind in reversed(sources):  # the last named is the most general
        place = 0
        for title in split[kind]:
            if title not in order:
                order.insert(place, title)
            place = order.index(title) + 1
    return {title: next((split[kind][title], kind) for kind in sources if title in split[kind]) for title in order}


def _compose_page(env_id: str, classes: Mapping[str, type[MammobotEnv]]) -> str:
    kind = classes[env_id]
    ids = {other.__name__: other_id for other_id, other in classes.items()}
    env: Any = gymnasium.make(env_id).unwrapped
    lead, _ = split_sections(inspect.getdoc(kind) or "")
    lines = [f"# {env_id}", "", lead, ""]
    lines += ["```python", "import evergym", "import gymnasium", "", f'env = gymnasium.make("{env_id}")', "```", ""]
    lines += [_tabulate_facts(kind, env), ""]
    for title, (body, source) in _collect_sections(_order_sources(kind, classes.values())).items():
        lines += [f"## {title}", ""]
        if source is not kind:
            lines += [f"As in ``{source.__name__}``:", ""]
        lines += [body, ""]
        for named, text in _follow(title, body, classes.values()):
            lines += [f"In ``{named}``:", "", text, ""]
        if title == "Action":
            lines += [_tabulate_limits(env.drive.limits, env.model.name), ""]
        elif title == "Observation" and observation_table(env.terms) not in body:
            lines += ["The vector ``observation``:", "", observation_table(env.terms), ""]
        elif title == _ARGUMENTS:
            lines += [_tabulate_arguments(kind, env), ""]
    env.close()
    text = "\n".join(lines)
    return _NAMED.sub(lambda match: _link(match[1], ids, env_id), text).rstrip() + "\n"


def _follow(title: str, body: str, classes: Iterable[type]) -> list[tuple[str, str]]:
    """Return the sections of that title, with the class's name, that a section refers to by beginning "As in"."""
    if not body.startswith("As in"):
        return []
    known = {kind.__name__: split_sections(inspect.getdoc(kind) or "")[1] for kind in classes}
    return [(name, known[name][title]) for name in _NAMED.findall(body) if title in known.get(name, {})]


def _link(name: str, ids: Mapping[str, str], here: str) -> str:
    if name not in ids or ids[name] == here:
        return f"`{name}`"
    return f"[`{name}`]({ids[name]}.md)"


def _compose_index(classes: Mapping[str, type[MammobotEnv]]) -> str:
    lines = ["# The environments", "", "Written by `evergym docs`; a test keeps these pages true.", ""]
    lines += ["| id | task | observation | action |", "|---|---|---|---|"]
    for env_id, kind in classes.items():
        env: Any = gymnasium.make(env_id).unwrapped
        lead = " ".join(split_sections(inspect.getdoc(kind) or "")[0].split())
        sentence = re.split(r"(?<=[a-z])\. ", lead)[0].rstrip(".")
        spaces = f"`{_describe_space(env.observation_space)}` | `{_describe_space(env.action_space)}`"
        lines.append(f"| [{env_id}]({env_id}.md) | {sentence} | {spaces} |")
        env.close()
    return "\n".join([*lines, ""])


def _tabulate_facts(kind: type[MammobotEnv], env: Any) -> str:
    settings: EpisodeSettings = env.settings
    steps = settings.time_limit_s / settings.control_step_s
    rows = {
        "class": f"`{kind.__module__}.{kind.__name__}`",
        "action space": f"`{_describe_space(env.action_space)}`",
        "observation space": f"`{_describe_space(env.observation_space)}`",
        "control step": f"{settings.control_step_s:g} s of robot time",
        "time limit": f"{settings.time_limit_s:g} s, {steps:g} steps",
        "render modes": ", ".join(f"`{mode}`" for mode in env.metadata["render_modes"]),
    }
    return "\n".join(["| | |", "|---|---|", *(f"| {name} | {text} |" for name, text in rows.items())])


def _describe_space(space: Any) -> str:
    if isinstance(space, gymnasium.spaces.Dict):
        return ", ".join(f"{name}: {_describe_space(part)}" for name, part in space.spaces.items())
    return str(space)


def _tabulate_limits(limits: DriveLimits, model: str) -> str:
    lines = [f"The drive's limits with the model `{model}`:", "", "| limit | value | meaning |", "|---|---|---|"]
    for name, meaning in describe_attributes(type(limits)).items():
        unit = re.search(r" \[([^]]+)\]", meaning)
        factor, written = _PEOPLE[unit[1]] if unit else (1.0, "")
        text = meaning.replace(unit[0], "", 1) if unit else meaning
        lines.append(f"| `{name}` | {getattr(limits, name) / factor:g} {written} | {text} |")
    return "\n".join(lines)


def _tabulate_arguments(kind: type[MammobotEnv], env: Any) -> str:
    """Return every argument with its default, and the weights of ``reward``."""
    named = {
        name: parameter.default
        for owner in reversed(kind.__mro__)
        for name, parameter in inspect.signature(owner).parameters.items()
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY and issubclass(owner, gymnasium.Env)
    }
    meanings = describe_attributes(EpisodeSettings)
    lines = ["| argument | default | meaning |", "|---|---|---|"]
    lines += [f"| `{name}` | `{default!r}` | see above |" for name, default in named.items()]
    for field in dataclasses.fields(EpisodeSettings):
        lines.append(f"| `{field.name}` | `{getattr(env.settings, field.name)!r}` | {meanings.get(field.name, '')} |")
    lines += ["", "The weights, as in `reward={...}`:", "", "| weight | default | meaning |", "|---|---|---|"]
    meanings = describe_attributes(RewardSettings)
    for field in dataclasses.fields(RewardSettings):
        value = getattr(env.reward_settings, field.name)
        lines.append(f"| `{field.name}` | `{value!r}` | {meanings.get(field.name, '')} |")
    return "\n".join(lines)
