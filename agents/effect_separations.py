"""How to tell effects apart that look alike: the experiment in which one answers and the other does not.

Each sentence is a test in ``tests/physics/test_effect_signatures_*.py`` or ``tests/physics/test_effect_partners.py``.
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
    ("axial_buckling", "bending_anisotropy"): (
        "Load the tip sideways in and across the soft plane, with and without a push along the robot: anisotropy "
        "divides one of the two always, buckling multiplies what bends already, and only under the push."
    ),
    ("axial_buckling", "wall_wrinkling"): (
        "Push the sheath along itself at two pressures: what the push amplifies does not depend on the pressure, "
        "the load at which the wall wrinkles is proportional to it."
    ),
    ("axial_buckling", "retraction_buckling"): (
        "Push at the tip, and pull the tail: the one answers the push, the other the pull, at a tail force that "
        "goes with the pressure."
    ),
    ("burst_limit", "pressure_leak"): (
        "Raise the pressure and lower it again: a leak takes the same share all the time, a burst takes all of it "
        "from one pressure on, for good."
    ),
    ("pressure_leak", "pressure_bias"): (
        "Compare two pressures: a leak takes a share and the gauge shows it, a biased gauge takes a constant and "
        "shows the set point."
    ),
    ("pressure_leak", "tail_coulomb_friction"): (
        "Grow at two lengths and two pressures: a leak takes more at more pressure, whatever the length; friction "
        "takes more at more length, whatever the pressure."
    ),
    ("pressure_bias", "eversion_yield"): (
        "In growth alone they are the same. Where pressure acts otherwise (squeezed friction, a step of the wall, "
        "stiffness) the biased gauge shifts that too."
    ),
    ("catheter_protrusion", "feed_limit"): (
        "Insert the catheter faster than the sheath grows: with protrusion the tip follows the insertion, without "
        "it stays with the sheath; the feed's slip changes the sheath's length only."
    ),
    ("feed_limit", "viscous_eversion"): (
        "Double the feed, then the pressure: the feed's limit doubles the speed with the feed, the rate law with "
        "the pressure."
    ),
    ("pressure_lag", "pressure_droop", "pressure_ripple"): (
        "Step the set point and wait, while it grows and while it does not: lag is late but ends, droop stays as "
        "long as it grows, ripple goes on for ever about the set point."
    ),
    ("pressure_lag", "wall_compliance"): (
        "Step the pressure without growth: a compliant wall has its new length at once and goes back; with lag, "
        "growth sets in late and goes on."
    ),
    ("viscous_eversion", "pressure_droop"): (
        "The speeds are the very same; only the gauge tells: it falls with the speed under droop, and stays at the "
        "set point where the tip resists."
    ),
    ("saline_weight", "pre_curvature", "wall_pretension"): (
        "Turn the robot about its axis under gravity, and roll the catheter in it: weight follows gravity, pre- "
        "curvature follows the catheter's roll, pre-tension stays with the wall."
    ),
    ("saline_weight", "clearance_play"): ("Load it twice as hard: weight bends twice as far, play ends at its angle."),
    ("clearance_play", "torsional_windup"): (
        "Turn the base to the same angle from both sides: wind-up leaves the tip in two places, play in one."
    ),
    ("clearance_play", "tendon_backlash"): (
        "Load the tip a little, and pull a little: play answers the load at once and does not hold the pull back, "
        "backlash the other way round."
    ),
    ("contact_friction", "duct_compliance"): (
        "Press on the wall, push along it and let go: compliance shows how deep the press goes, friction in that "
        "the tip does not slide back."
    ),
    ("notch_closure", "tendon_stretch", "tendon_friction"): (
        "Pull and pay out between small and large bends: closed notches lower the slope beyond one curvature, to "
        "one side, without a loop; stretch lowers it everywhere; friction opens a loop."
    ),
    ("wall_creep", "tendon_backlash"): (
        "Hold the pull after a reversal: creep goes on for its time, on both ways; backlash does not move."
    ),
    ("wall_compliance", "wall_pretension"): (
        "Raise the pressure without load: compliance makes the wall longer, pre-tension bends it."
    ),
    ("wall_shear", "wall_compliance"): (
        "Load the tip of the sheath alone: shear moves it sideways by 0.2 % more, compliance makes it longer under "
        "pressure without any load."
    ),
    ("wall_shear", "wall_wrinkling"): (
        "Load the tip of the sheath alone, a little and a lot: shear moves it without turning it at any load, "
        "wrinkling turns it, beyond its load only."
    ),
    ("angle_quantisation", "tendon_backlash"): (
        "Pull and pay out slowly: both hold the reading over some pull; only with backlash does it differ between "
        "the ways."
    ),
    ("eversion_yield", "tail_coulomb_friction"): (
        "Grow at several lengths, and find the pressure at which growth starts and stops: the yield is the same at any "
        "length and lower once the tip moves, friction takes more in a longer robot."
    ),
    ("tail_capstan_friction", "viscous_eversion"): (
        "Bend the robot at the same pressure and length, then feed faster: friction in bends slows growth in the bent "
        "robot only, the resistance of the tip slows it in the straight one too."
    ),
}
"""The sentence for each group of confusable effects."""


def find_separations(name: str, partners: Iterable[str]) -> list[tuple[tuple[str, ...], str]]:
    """Return the groups that hold ``name`` and one of its partners or more, with their sentences."""
    wanted = set(partners)
    return [(group, text) for group, text in SEPARATIONS.items() if name in group and wanted & set(group)]
