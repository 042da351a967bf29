"""Which library effects can be hidden: their strengths, the protocols that excite them, and other forms of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields

from numpy.random import Generator

from evergym.discrepancy.blind.alteration import Alteration, Values
from evergym.discrepancy.blind.pressure_forms import (
    OrificeDroop,
    SecondOrderLag,
    SoftBias,
    StickyAngle,
    ThrottledLeak,
    TriangleRipple,
)
from evergym.discrepancy.blind.tendon_forms import DahlTendon, SmoothPlay, StiffeningLine, WoundRoll
from evergym.effects.catalogue import Effects
from evergym.model import Model

__all__ = ["HIDDEN", "HiddenEffect", "list_hidden"]

Range = tuple[float, float]
TENDON = ("tendon_staircase", "tendon_staircase", "pressure_steps", "hold", "catheter_staircase")
GROWTH = ("growth", "growth", "growth_threshold", "growth_bent")
PRESSURE = ("pressure_steps", "pressure_steps", "growth", "growth_threshold")


@dataclass(frozen=True)
class HiddenEffect:
    """How an effect of the library is hidden in a truth.

    Attributes:
        ranges: Parameters that are drawn, uniformly, with their range.
        switches: Parameters that are set as given.
        exciting: Protocols of which some are in the campaign.
        form: Another form of it on a code path of its own; None: there is none (or it is one of the growth law's).
        form_values: The form's numbers, from the drawn parameters and the lab's model.
        growth_form: Name among `evergym.discrepancy.blind.growth_forms.GROWTH_FORMS`, or empty.
        needs: Effects without which this one does nothing.
    """

    ranges: Mapping[str, Range]
    exciting: tuple[str, ...]
    switches: Mapping[str, float | bool] = field(default_factory=dict)
    form: type[Alteration] | None = None
    form_values: Callable[[Values, Model], dict[str, float]] | None = None
    growth_form: str = ""
    needs: tuple[str, ...] = ()

    @property
    def has_form(self) -> bool:
        """Whether there is another functional form."""
        return self.form is not None or bool(self.growth_form)

    def draw(self, generator: Generator) -> dict[str, float | bool]:
        """Draw the parameters, to three digits."""
        drawn = {key: float(f"{generator.uniform(low, high):.3g}") for key, (low, high) in self.ranges.items()}
        return {**self.switches, **drawn}


def _same(*names: str) -> Callable[[Values, Model], dict[str, float]]:
    return lambda values, _: {name: float(values[name]) for name in names}


def _with(function: Callable[[Values], dict[str, float]]) -> Callable[[Values, Model], dict[str, float]]:
    return lambda values, _: function(values)


HIDDEN: dict[str, HiddenEffect] = {
    "eversion_yield": HiddenEffect(
        {"static_kpa": (12.0, 18.0), "kinetic_kpa": (7.0, 11.0)}, GROWTH, growth_form="stribeck_yield"
    ),
    "viscous_eversion": HiddenEffect({"resistance_kpa_s_mm": (4.0, 12.0)}, GROWTH, growth_form="sinh_rate"),
    "feed_limit": HiddenEffect({"slip": (0.3, 0.6)}, GROWTH, growth_form="sharp_slip"),
    "tail_coulomb_friction": HiddenEffect({"gradient_kpa_per_mm": (0.2, 0.5)}, GROWTH, growth_form="stribeck_tail"),
    "tail_catheter_friction": HiddenEffect({"mu": (0.004, 0.012)}, GROWTH, growth_form="saturating_squeeze"),
    "tail_capstan_friction": HiddenEffect(
        {"mu": (0.25, 0.6)}, ("growth_bent", "growth_bent", "growth_bent", "growth"), growth_form="linear_capstan"
    ),
    "tendon_backlash": HiddenEffect(
        {"backlash_mm": (0.25, 0.6)},
        TENDON,
        {"lost_motion_mm": 0.0},
        SmoothPlay,
        _with(lambda v: {"backlash_mm": v["backlash_mm"], "lost_motion_mm": 0.0, "edge_share": 0.1}),
    ),
    "tendon_stretch": HiddenEffect(
        {"compliance_mm_per_n": (0.12, 0.35)},
        TENDON,
        {},
        StiffeningLine,
        _with(
            lambda v: {
                "compliance_mm_per_n": v["compliance_mm_per_n"],
                "stiffening_share": 0.35,
                "stiffening_n": 4.0,
            }
        ),
    ),
    "pressure_lag": HiddenEffect({"time_s": (0.5, 1.8)}, PRESSURE, {}, SecondOrderLag, _same("time_s")),
    "pre_curvature": HiddenEffect({"curvature_1_per_m": (1.0, 3.0)}, ("catheter_staircase", *TENDON, "roll_sweep")),
    "wall_wrinkling": HiddenEffect({}, ("tendon_staircase", "pressure_steps", "load_steps"), {"enabled": True}),
    "bending_anisotropy": HiddenEffect({}, ("load_steps", "roll_sweep", "tendon_staircase"), {"enabled": True}),
    "saline_weight": HiddenEffect({"share": (0.85, 1.1)}, ("roll_sweep", "sheath_alone", "hold", "load_steps")),
    "root_kink": HiddenEffect({"moment_n_m": (0.9e-4, 1.5e-4), "pressure_share": (0.25, 0.36)}, ("sheath_alone",)),
    "contact_friction": HiddenEffect({"mu_peg": (0.2, 0.5)}, ("peg_sweep",), {"mu_tissue": 0.05}),
    "tendon_friction": HiddenEffect(
        {"mu": (0.1, 0.35)},
        TENDON,
        {},
        DahlTendon,
        lambda v, model: {
            "mu": v["mu"],
            "rest_share": 0.5,
            "compliance_mm_per_n": model.effects.tendon_stretch.compliance_mm_per_n,
        },
        needs=("tendon_stretch",),
    ),
    "torsional_windup": HiddenEffect(
        {"mu": (0.15, 0.4)},
        ("roll_sweep",),
        {},
        WoundRoll,
        _with(lambda v: {"play_deg": 37.0 * v["mu"], "pressure_share": 0.85, "edge_share": 0.1}),
    ),
    "wall_pretension": HiddenEffect({"eccentricity_mm": (0.4, 1.0)}, ("pressure_steps", "roll_sweep", *TENDON)),
    "wall_creep": HiddenEffect({"share": (0.5, 0.9), "time_s": (1.5, 6.0)}, ("hold", "pressure_steps", *TENDON)),
    "notch_closure": HiddenEffect({"curvature_1_per_m": (4.0, 7.0)}, TENDON, {"stiffness_n_m2": 2e-3}),
    "clearance_play": HiddenEffect({"angle_deg": (2.0, 5.0)}, ("load_steps", "roll_sweep", "tendon_staircase")),
    "pressure_droop": HiddenEffect(
        {"resistance_kpa_s_mm": (3.0, 9.0)}, GROWTH, {}, OrificeDroop, _same("resistance_kpa_s_mm")
    ),
    "pressure_ripple": HiddenEffect(
        {"amplitude_kpa": (2.0, 6.0), "frequency_hz": (0.2, 0.5)},
        ("hold", "growth", "pressure_steps"),
        {},
        TriangleRipple,
        _same("amplitude_kpa", "frequency_hz"),
    ),
    "pressure_leak": HiddenEffect({"share": (0.1, 0.3)}, PRESSURE, {}, ThrottledLeak, _same("share")),
    "pressure_bias": HiddenEffect(
        {"bias_kpa": (1.5, 5.0)}, ("growth_threshold", "growth", *PRESSURE), {}, SoftBias, _same("bias_kpa")
    ),
    "angle_quantisation": HiddenEffect({"step_deg": (4.0, 8.0)}, TENDON, {}, StickyAngle, _same("step_deg")),
}
"""Effects by name; those that this version of the library lacks are left out by `list_hidden`.

Not here: `burst_limit`, `catheter_protrusion`, `retraction_buckling`, `duct_compliance` (no bench protocol of this
campaign excites them safely), and those whose strength at this scale is below every instrument (`wall_shear`,
`wall_compliance`).
"""


def list_hidden() -> dict[str, HiddenEffect]:
    """Return the effects that can be hidden with the library as it is."""
    present = {entry.name for entry in fields(Effects)}
    return {name: hidden for name, hidden in HIDDEN.items() if name in present}
