"""How to tell effects apart that look alike: the experiment in which one answers and the other does not.

Each sentence is a test in ``tests/physics/test_effect_signatures_*.py``.
"""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ["SEPARATIONS", "find_separations"]

SEPARATIONS: dict[tuple[str, ...], str] = {
    ("tail_coulomb_friction", "tail_catheter_friction", "tail_capstan_friction"): (
        "Grow at two lengths, with and without the catheter, straight and bent: the first loses pressure with the "
        "length, the second only over the catheter and in proportion to the pressure, the third multiplies all losses "
        "by exp(mu theta) and does nothing in a straight robot."
    ),
    ("tendon_friction", "tendon_backlash", "tendon_stretch"): (
        "Pull, release and pull again, between small and large pulls: friction opens a loop as wide as the tension is "
        "large, backlash one of constant width with flat ends, stretch opens none and lowers the slope."
    ),
    ("pre_curvature", "wall_pretension", "pressure_bias"): (
        "Change the pressure without load and without pull: pre-curvature stays, but for what the sheath stiffens; "
        "pre-tension steps with the pressure; a biased gauge bends nothing and shifts the pressures at which all else "
        "happens. Roll the catheter: pre-curvature turns with it, pre-tension stays with the wall."
    ),
    ("wall_wrinkling", "root_kink", "wall_creep"): (
        "Let the sheath alone hang at several pressures and lengths, and wait: wrinkling softens with the moment over "
        "the pressure, the kink is a hinge that sets in at a length, creep goes on at constant pressure and length."
    ),
    ("eversion_yield", "pressure_droop"): (
        "Hold the pressure just below the threshold, then grow at several feed speeds: the yield is a threshold that "
        "does not depend on the speed and leaves the pressure alone; droop lowers the measured pressure in proportion "
        "to the speed and is none at rest."
    ),
    ("bending_anisotropy", "torsional_windup"): (
        "Turn the base and turn it back: anisotropy bends the deflection off the load's direction without memory; "
        "wind-up lets the tip lag behind the base, the other way round on the way back, and more under pressure."
    ),
}
"""The sentence for each group of confusable effects."""


def find_separations(name: str, partners: Iterable[str]) -> list[tuple[tuple[str, ...], str]]:
    """Return the groups that hold ``name`` and one of its partners or more, with their sentences."""
    wanted = set(partners)
    return [(group, text) for group, text in SEPARATIONS.items() if name in group and wanted & set(group)]
