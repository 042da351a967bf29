"""The fits of an identification: what each one is fitted to, and from where it starts."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from typing import NamedTuple

from evergym.config import dump_toml
from evergym.experiments.identification.fit import Selection, select
from evergym.experiments.identification.free import BENDING, GROWTH_LAWS, FreeParameter, clear_growth_law, set_values
from evergym.experiments.paper import load_experiment
from evergym.model import Model

__all__ = [
    "ARMS_MM",
    "BENDING_FIGURES",
    "COMPONENT",
    "GROWTH_CURVES",
    "GROWTH_FIGURES",
    "LEFT_OUT_FIGURES",
    "Task",
    "plan_alternatives",
    "plan_first",
    "plan_left_out",
]

BENDING_FIGURES = ("fig6_toward", "fig6_opposite", "fig7", "fig9", "fig10", "fig11a", "fig11b", "fig11c", "fig11d")
GROWTH_FIGURES = ("fig8a", "fig8b", "fig8c")
COMPONENT = ("fig6_toward", "fig6_opposite", "fig7", "fig9")
"""The component experiments of statics."""
GROWTH_CURVES = tuple(dict.fromkeys(load_experiment("fig8b").points.curve))

LEFT_OUT_FIGURES: dict[str, tuple[str, ...]] = {
    "fig6": ("fig6_toward", "fig6_opposite"),
    "fig7": ("fig7",),
    "fig9": ("fig9",),
    "fig10": ("fig10",),
    "fig11a": ("fig11a",),
    "fig11b": ("fig11b",),
    "fig11c": ("fig11c",),
    "fig11d": ("fig11d",),
}
"""What is left out of the fits of statics, one after the other."""

LOST_MOTION_POINT = 2
"""The point of Fig. 10 that tells the prediction the lost motion of the assembled system: 130 kPa absolute."""

ARMS_MM = (1.0, 1.3)
"""Other tendon arms at which statics are fitted as well: the far side of the range that the mesh leaves."""

SYSTEM_ONLY = ("effects.tendon_backlash.lost_motion_mm", "effects.clearance_play.angle_deg")


class Task(NamedTuple):
    """One fit: its name, the model whose other values stay, what is free, what it sees, and the optimiser's steps."""

    name: str
    base: Model
    free: tuple[FreeParameter, ...]
    selections: tuple[Selection, ...]
    evaluations_max: int

    def compute_digest(self) -> str:
        """Return a hash of everything that the result depends on but the physics."""
        text = json.dumps([dump_toml(self.base), self.free, self.selections, self.evaluations_max])
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def plan_first(base: Model, evaluations_max: int) -> list[Task]:
    """Return the fits to everything: statics, and growth with each law; and the fit to the components alone."""
    tasks = [Task("statics", base, BENDING, tuple(select(BENDING_FIGURES)), evaluations_max)]
    for law, free in GROWTH_LAWS.items():
        tasks.append(
            Task(f"growth_{law}", clear_growth_law(base), free, tuple(select(GROWTH_FIGURES)), evaluations_max)
        )
    component_free = tuple(parameter for parameter in BENDING if parameter.path not in SYSTEM_ONLY)
    tasks.append(Task("components", base, component_free, tuple(select(COMPONENT)), evaluations_max))
    return tasks


def plan_left_out(base: Model, law: str, steps: int) -> list[Task]:
    """Return the fits that leave something out; they start where the others did, not from what those found."""
    tasks = []
    for name, experiments in LEFT_OUT_FIGURES.items():
        seen = [figure for figure in BENDING_FIGURES if figure not in experiments]
        tasks.append(Task(f"without_{name}", base, BENDING, tuple(select(seen)), steps))
    tasks.extend(
        Task(
            f"without_fig8_{curve}",
            clear_growth_law(base),
            GROWTH_LAWS[law],
            tuple(select(GROWTH_FIGURES, without=curve)),
            steps,
        )
        for curve in GROWTH_CURVES
    )
    return tasks


def plan_alternatives(base: Model, statics: Sequence[float], components: Model, steps: int) -> list[Task]:
    """Return the fits with other tendon arms, and of the lost motion on top of the components' values."""
    tasks = [
        Task(
            f"arm_{arm:g}",
            set_values(base, ["robot.tendon_arm_mm"], [arm]),
            _start_at(BENDING, statics),
            tuple(select(BENDING_FIGURES)),
            steps,
        )
        for arm in ARMS_MM
    ]
    lost = tuple(parameter for parameter in BENDING if parameter.path == SYSTEM_ONLY[0])
    tasks.append(Task("predicted", components, lost, (Selection("fig10", (LOST_MOTION_POINT,)),), steps))
    return tasks


def _start_at(free: Sequence[FreeParameter], values: Sequence[float]) -> tuple[FreeParameter, ...]:
    return tuple(parameter._replace(start=float(value)) for parameter, value in zip(free, values, strict=True))
