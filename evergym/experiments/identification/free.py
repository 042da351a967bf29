"""The parameters that the figures are to give, where they are looked for, and which figures they act in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from evergym.experiments.parameter_sets import override
from evergym.model import Model

__all__ = [
    "BENDING",
    "GROWTH_LAWS",
    "LAW_COEFFICIENTS",
    "FreeParameter",
    "clear_growth_law",
    "make_tables",
    "set_values",
]


class FreeParameter(NamedTuple):
    """A parameter that is fitted: its path in a model file, in that file's unit.

    Attributes:
        path: Such as "effects.root_kink.moment_n_m".
        start: First guess; round numbers, so that a fit which does not see a figure does not start from it either.
        low: Smallest value tried.
        high: Largest value tried.
        figures: Figures that it acts in. Two or more: a parameter that only one figure knows would be no physics.
        prior: Mean and standard deviation from a source that is none of the figures; None: none.
    """

    path: str
    start: float
    low: float
    high: float
    figures: tuple[str, ...]
    prior: tuple[float, float] | None = None


KINK_PRIOR = {"moment_n_m": (7.3e-5, 7.3e-5), "pressure_share": (0.5, 0.25)}
"""What theory says of the sheath's collapse without Fig. 9. A resting fold shares the thrust p A between wall and tail,
to within its static yield Y (13.7 kPa): the wall carries (p + Y) A / 2 of it, and collapses at R times that,
pi R^3 (p + Y) / 2. As uncertain as it is large: wall against tail is only known to be between (p - Y) and (p + Y)."""

BENDING = (
    FreeParameter("robot.catheter_bending_stiffness_n_m2", 5e-4, 3e-4, 6e-4, ("fig6", "fig7", "fig10", "fig11")),
    FreeParameter("effects.tendon_stretch.compliance_mm_per_n", 0.2, 0.05, 0.6, ("fig7", "fig10", "fig11")),
    FreeParameter("effects.tendon_backlash.backlash_mm", 0.3, 0.1, 0.7, ("fig7", "fig10", "fig11")),
    FreeParameter("effects.tendon_backlash.lost_motion_mm", 1.5, 0.5, 3.5, ("fig10", "fig11")),
    FreeParameter("effects.clearance_play.angle_deg", 3.0, 0.05, 12.0, ("fig10", "fig11")),
    FreeParameter(
        "effects.root_kink.moment_n_m", 5e-5, 0.0, 6e-4, ("fig9", "fig10", "fig11"), KINK_PRIOR["moment_n_m"]
    ),
    FreeParameter("effects.root_kink.pressure_share", 0.5, 0.0, 1.5, ("fig9", "fig10"), KINK_PRIOR["pressure_share"]),
)
"""Of statics. The tendon's arm stays at the notches' neutral axis of the published mesh: with a free line compliance
the figures know only their combination (see the report of ``evergym identify``)."""

_GROWTH_FIGURES = ("fig8a", "fig8b", "fig8c")
_GROWTH = (
    FreeParameter("effects.eversion_yield.kinetic_kpa", 12.0, 7.9, 18.7, _GROWTH_FIGURES),
    FreeParameter("effects.viscous_eversion.resistance_kpa_s_mm", 4.0, 0.5, 15.0, _GROWTH_FIGURES),
    FreeParameter("effects.feed_limit.slip", 0.4, 0.0, 0.8, _GROWTH_FIGURES),
    FreeParameter("effects.tail_coulomb_friction.speed_exponent", 0.3, 0.0, 1.0, _GROWTH_FIGURES),
)
GROWTH_LAWS: dict[str, tuple[FreeParameter, ...]] = {
    "exponential": (
        *_GROWTH,
        FreeParameter("effects.tail_coulomb_friction.yield_growth_per_mm", 0.015, 0.0, 0.1, _GROWTH_FIGURES),
    ),
    "proportional": (
        *_GROWTH,
        FreeParameter("effects.tail_coulomb_friction.pressure_gradient_per_mm", 0.008, 0.0, 0.05, _GROWTH_FIGURES),
    ),
    "constant": (
        *_GROWTH,
        FreeParameter("effects.tail_coulomb_friction.gradient_kpa_per_mm", 0.4, 0.0, 3.0, _GROWTH_FIGURES),
    ),
}
"""Of growth, one set per law of the tail's friction. The yield in motion is at least the 2021 robot's 7.9 kPa
(Berthet-Rayne et al. 2021, its published model) and at most the 18.7 kPa at which the robot does grow."""

LAW_COEFFICIENTS = (
    "effects.tail_coulomb_friction.yield_growth_per_mm",
    "effects.tail_coulomb_friction.pressure_gradient_per_mm",
    "effects.tail_coulomb_friction.gradient_kpa_per_mm",
)
"""Of the three laws of the tail's friction, of which a model has one."""


def clear_growth_law(model: Model) -> Model:
    """Return the model with all three coefficients of the tail's friction at zero."""
    return set_values(model, LAW_COEFFICIENTS, (0.0, 0.0, 0.0))


def set_values(model: Model, paths: Sequence[str], values: Sequence[float]) -> Model:
    """Return the model with the values at the paths, in the units of a model file.

    Raises:
        ConfigError: a path is unknown or a value out of its bounds.
    """
    return override(model, make_tables(dict(zip(paths, map(float, values), strict=True))), "identification")


def make_tables(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by path as nested tables, as they stand in a model file."""
    tables: dict[str, Any] = {}
    for path, value in values.items():
        *sections, key = path.split(".")
        table = tables
        for section in sections:
            table = table.setdefault(section, {})
        table[key] = value
    return tables
