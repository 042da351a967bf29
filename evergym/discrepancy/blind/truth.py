"""What is true in a blind case: drawn from a seed, kept from the diagnosis, compared afterwards."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.random import Generator

from evergym.config import to_mapping
from evergym.discrepancy.blind.campaign_plan import draw_campaign
from evergym.discrepancy.blind.faults import FAULTS
from evergym.discrepancy.blind.hidden import HiddenEffect, list_hidden
from evergym.discrepancy.blind.outside import OUTSIDE
from evergym.discrepancy.blind.plan import PlannedRun
from evergym.discrepancy.blind.protocols import find_range
from evergym.discrepancy.blind.rig import draw_jitter, draw_lab_model, draw_overrides, draw_wrong_nominals
from evergym.discrepancy.parameters import set_values
from evergym.model import Model, Numerics

__all__ = ["HiddenPart", "Kind", "Truth", "draw_truth", "find_kind"]


class Kind(StrEnum):
    """What sort of case it is."""

    SINGLE = "single"
    """One effect of the library is missing in the model."""
    TWO = "two"
    """Two effects are missing."""
    NONE = "none"
    """Nothing is missing: noise, or wrong nominal parameters."""
    OUTSIDE = "outside"
    """An effect is missing that the library does not have."""
    FAULT = "fault"
    """The data are bad."""


BLOCK = (Kind.SINGLE,) * 4 + (Kind.TWO,) * 2 + (Kind.NONE,) * 2 + (Kind.OUTSIDE,) * 2 + (Kind.FAULT,) * 2
"""Kinds in every twelve cases, in an order drawn anew."""

GROUPS = (
    {"eversion_yield", "viscous_eversion", "feed_limit", "tail_coulomb_friction", "tail_catheter_friction"},
    {"tendon_backlash", "tendon_stretch", "tendon_friction"},
    {"pressure_lag", "pressure_droop", "pressure_ripple", "pressure_leak", "pressure_bias"},
)
"""Effects of one part of the robot; of two hidden effects no two are of the same."""


@dataclass(frozen=True)
class HiddenPart:
    """One thing that the truth has and the model lacks.

    Attributes:
        name: Of the effect, in the library or among the outside ones.
        form: "library", "other" (another functional form of a library effect) or "outside".
        values: The library's parameters (also of another form: the ones it was made from), or the outside effect's.
    """

    name: str
    form: str
    values: dict[str, Any]


@dataclass(frozen=True, eq=False)
class Truth:
    """Everything about a case; all but ``lab``, ``overrides`` and ``plans`` is hidden from the diagnosis.

    Attributes:
        lab: The lab's model, as written to the model file.
        overrides: ``[robot]`` of the dataset.
        parts: What is missing in the model.
        nominals: Values of the true robot's nominal parameters, by path.
        wrong: Which of them are as wrong as their tolerances allow.
        numerics: Discretisation of the truth.
        fault: Name of the fault in the data, or empty.
        plans: The runs of the bench.
    """

    seed: int
    index: int
    attempt: int
    kind: Kind
    lab: Model
    overrides: dict[str, float]
    parts: tuple[HiddenPart, ...]
    nominals: dict[str, float]
    wrong: tuple[str, ...]
    numerics: Numerics
    fault: str = ""
    plans: tuple[PlannedRun, ...] = field(default=(), repr=False)

    @property
    def known(self) -> Model:
        """The model as the diagnosis knows it: the model file with the dataset's overrides."""
        return set_values(self.lab, {f"robot.{key}": value for key, value in self.overrides.items()})

    def to_json(self) -> dict[str, Any]:
        """Return what is sealed."""
        return {
            "seed": self.seed,
            "index": self.index,
            "attempt": self.attempt,
            "kind": self.kind.value,
            "parts": [dataclasses.asdict(part) for part in self.parts],
            "nominals": self.nominals,
            "wrong": list(self.wrong),
            "fault": self.fault,
            "numerics": to_mapping(self.numerics),
        }


def find_kind(seed: int, index: int) -> tuple[Kind, int]:
    """Return the kind of a case and how many cases of its kind come before it."""
    block, place = divmod(index, len(BLOCK))
    order = np.random.default_rng([seed, block, 1]).permutation(len(BLOCK))
    kinds = [BLOCK[i] for i in order]
    kind = kinds[place]
    return kind, block * BLOCK.count(kind) + kinds[:place].count(kind)


def draw_truth(seed: int, index: int, attempt: int = 0) -> Truth:
    """Draw a case; an attempt that turned out not to be detectable is followed by another of the same kind."""
    kind, number = find_kind(seed, index)
    what, how, rig, plan, real = (
        np.random.default_rng(child) for child in np.random.SeedSequence([seed, index, attempt, 2]).spawn(5)
    )
    names, outside, exciting = _choose(what, seed, kind, number)
    library = list_hidden()
    lab = draw_lab_model(rig, names)
    needed = {need for name in names for need in library[name].needs}
    lab = set_values(lab, {f"effects.{need}.{key}": value for need in needed for key, value in _default(need).items()})
    overrides = draw_overrides(rig, lab)
    known = set_values(lab, {f"robot.{key}": value for key, value in overrides.items()})
    other = [_takes_other_form(what, kind, number, library[name]) for name in names]
    parts = [
        HiddenPart(name, "other" if form else "library", library[name].draw(how))
        for name, form in zip(names, other, strict=True)
    ]
    if outside:
        parts.append(HiddenPart(outside, "outside", OUTSIDE[outside].draw(how, find_range(known))))
    nominals = draw_jitter(real, known)
    nominals = {path: value for path, value in nominals.items() if path.split(".")[1] not in names}
    wrong: dict[str, float] = {}
    if kind is Kind.NONE and number % 2 == 1:
        wrong = draw_wrong_nominals(real, known)
        nominals.update(wrong)
    numerics = Numerics(
        section_length_mm=round(real.uniform(1.6, 2.4), 2),
        step_s=float(real.choice([1.0 / 16.0, 1.0 / 20.0])),
        sheath_fibres=int(real.choice([14, 16])),
        energy_tolerance_j=1e-11,
    )
    return Truth(
        seed=seed,
        index=index,
        attempt=attempt,
        kind=kind,
        lab=lab,
        overrides=overrides,
        parts=tuple(parts),
        nominals=nominals,
        wrong=tuple(wrong),
        numerics=numerics,
        fault=list(FAULTS)[(number + seed) % len(FAULTS)] if kind is Kind.FAULT else "",
        plans=draw_campaign(plan, known, exciting),
    )


def _choose(generator: Generator, seed: int, kind: Kind, number: int) -> tuple[list[str], str, tuple[str, ...]]:
    """Return the hidden library effects, the outside effect, and the protocols that excite them."""
    library = list_hidden()
    if kind is Kind.SINGLE:
        names = [name for name, hidden in library.items() if number % 2 == 1 or hidden.has_form]
        chosen = str(generator.choice(names))
        return [chosen], "", library[chosen].exciting
    if kind is Kind.TWO:
        first, second = generator.permutation(list(library))[:2].tolist()
        while any({first, second} <= group for group in GROUPS):
            first, second = generator.permutation(list(library))[:2].tolist()
        return [first, second], "", library[first].exciting + library[second].exciting
    if kind is Kind.OUTSIDE:
        order = np.random.default_rng([seed, 3]).permutation(len(OUTSIDE))
        name = list(OUTSIDE)[order[number % len(OUTSIDE)]]
        return [], name, OUTSIDE[name].exciting
    return [], "", ()


def _takes_other_form(generator: Generator, kind: Kind, number: int, hidden: HiddenEffect) -> bool:
    """Every other single effect has another form, so half of them have; of two effects, those drawn."""
    drawn = bool(generator.uniform() < 0.5)
    if kind is Kind.SINGLE:
        return number % 2 == 0
    return drawn and hidden.has_form


def _default(name: str) -> dict[str, Any]:
    from evergym.model import load_model

    return to_mapping(getattr(load_model("mammobot_2023").effects, name))
