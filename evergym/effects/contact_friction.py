"""Contact friction: Coulomb friction between the robot and the duct's wall, or the pegs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from evergym.config import parameter
from evergym.effects.information import EffectInfo

__all__ = ["ContactFriction", "ContactFrictionParameters"]


class ContactFrictionParameters(NamedTuple):
    """SI parameters: friction coefficients [1] on tissue and pegs, and the speed [m/s] of full friction."""

    mu_tissue: float
    mu_peg: float
    sliding_speed: float


@dataclass(frozen=True)
class ContactFriction:
    """|F_t| <= mu N. The everted wall does not slide along the duct; it resists being dragged across. Off at zero
    ``mu``.

    Regularised: the force reaches mu N within a small sliding speed, so that it is the gradient of a convex potential.
    """

    info: ClassVar[EffectInfo] = EffectInfo(
        row=24,
        acts_on="state",
        moves=("tip_x_mm", "tip_y_mm", "tip_z_mm"),
        depends_on=("history",),
        partners=("duct_compliance",),
        off={"mu_tissue": 0.0, "mu_peg": 0.0},
        strength=("mu_tissue", "mu_peg"),
        typical={"mu_tissue": 0.2, "mu_peg": 0.3},
    )

    mu_tissue: float = parameter(
        0.05,
        unit="1",
        low=0.0,
        high=1.5,
        prior=True,
        source="0.01 (hydrogel on bladder) to 0.3 (bare polymer on vessel)",
    )
    mu_peg: float = parameter(0.2, unit="1", low=0.0, high=1.5, prior=True, source="0.1-0.4, polymer on a rigid peg")
    sliding_speed_mm_s: float = parameter(
        0.2, unit="mm/s", low=1e-4, high=100.0, prior=True, help="Numerical: full friction above this speed."
    )

    def compile(self) -> ContactFrictionParameters:
        """Return the SI parameters."""
        return ContactFrictionParameters(self.mu_tissue, self.mu_peg, self.sliding_speed_mm_s * 1e-3)
