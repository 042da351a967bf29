"""A growth law of the truth's own, in Python: the library's structure, with single terms in another form.

The simulator underneath grows as it is fed, without any resistance; this law decides how fast that is.
"""

# ruff: noqa: ARG002, D102  (a form overrides what it needs of `Alteration`, which documents the methods)
from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from evergym.discrepancy.blind.alteration import Alteration
from evergym.discrepancy.blind.plan import PlannedRun
from evergym.discrepancy.parameters import set_values
from evergym.model import Model
from evergym.simulator import Command, Simulator
from evergym.units import KPA, MM

__all__ = ["GROWTH_FORMS", "GrowthLaw", "remove_resistance"]

GROWTH_FORMS = {
    "stribeck_yield": "eversion_yield",
    "sinh_rate": "viscous_eversion",
    "sharp_slip": "feed_limit",
    "stribeck_tail": "tail_coulomb_friction",
    "saturating_squeeze": "tail_catheter_friction",
    "linear_capstan": "tail_capstan_friction",
}
"""Forms of this law, with the library effect that each of them is another form of."""

STRIBECK_MM_S = 0.4
SINH_KPA = 12.0
SQUEEZE_KPA = 30.0
SLIP_POWER = 3.0
FRICTION_REFERENCE_MM_S = 2.9  # the feed at which the library's friction holds (paper, Fig. 8)
PARTS = 5  # of a step


def remove_resistance(model: Model) -> Model:
    """Return the model with nothing that resists growth: the everted wall follows the feed."""
    return set_values(
        model,
        {
            "effects.eversion_yield.static_kpa": 0.0,
            "effects.eversion_yield.kinetic_kpa": 0.0,
            "effects.viscous_eversion.resistance_kpa_s_mm": 0.0,
            "effects.feed_limit.slip": 0.0,
            "effects.tail_coulomb_friction.gradient_kpa_per_mm": 0.0,
            "effects.tail_coulomb_friction.pressure_gradient_per_mm": 0.0,
            "effects.tail_coulomb_friction.yield_growth_per_mm": 0.0,
            "effects.tail_catheter_friction.mu": 0.0,
            "effects.tail_capstan_friction.mu": 0.0,
        },
    )


class GrowthLaw(Alteration):
    """How fast the tip moves, in mm, s and kPa.

    Args:
        model: The truth's robot and growth effects, those in another form with the values of the library's.
        forms: Names of `GROWTH_FORMS` that differ from the library.
    """

    def __init__(self, model: Model, forms: Collection[str]) -> None:
        super().__init__({})
        unknown = set(forms) - set(GROWTH_FORMS)
        if unknown:
            raise ValueError(f"Unknown growth forms: {', '.join(sorted(unknown))}.")
        self._forms = frozenset(forms)
        self._effects = model.effects
        robot = model.robot
        self._radius_mm = 0.5 * robot.sheath_outer_diameter_mm
        self._catheter_radius_mm = 0.5 * robot.catheter_outer_diameter_mm
        self._length_max_mm = 0.5 * robot.sheath_material_length_mm
        self._fed = self._speed = 0.0
        self._moving = False

    def begin(self, plan: PlannedRun, first: Command, clock: float) -> None:
        self._fed = 2.0 * plan.initial_everted_length_mm
        self._speed = 0.0
        self._moving = False

    def alter_command(self, time: float, dt: float, command: Command, simulator: Simulator) -> Command:
        if simulator.setup == "catheter":
            return command
        feed = 2.0 * command.insertion_velocity if command.tail_feed_velocity is None else command.tail_feed_velocity
        reading = simulator.reading
        length = reading.everted_length / MM
        if feed < 0.0:
            pulled = -feed / MM * dt
            slack = max(self._fed - 2.0 * length, 0.0)
            self._fed -= min(pulled, slack)
            rest = max(pulled - slack, 0.0)
            self._fed -= rest
            self._moving, self._speed = False, 0.0
            return replace(command, tail_feed_velocity=-rest * MM / dt)
        self._fed = max(self._fed, 2.0 * length)
        state = simulator.state
        bends = np.hypot(state.bend[:, 0], state.bend[:, 1])[: int(state.links[0])]
        inside = np.cumsum(state.length[: len(bends)]) <= reading.everted_length + 1e-9
        turn_angle = float(bends[inside].sum())
        push = 0.0
        if reading.catheter_length <= reading.everted_length:
            area = math.pi * (self._radius_mm * MM) ** 2
            push = max(-float(reading.tip_force @ reading.tip_direction), 0.0) / area / KPA
        start = length
        for _ in range(PARTS):
            growth = self._advance(
                length, reading.pressure / KPA, feed / MM, turn_angle, push, reading.catheter_length / MM, dt / PARTS
            )
            length += growth
            self._speed = growth / (dt / PARTS)
        return replace(command, tail_feed_velocity=2.0 * (length - start) * MM / dt)

    def find_stall_length(self, pressure_kpa: float, feed_mm_s: float) -> float:
        """Return the length [mm] to which a straight robot grows at a pressure and feed, its catheter along with it."""
        self._speed, self._moving = 0.0, False
        lengths = np.linspace(0.0, self._length_max_mm, 200)
        grows = [pressure_kpa > self._resist(float(x), pressure_kpa, feed_mm_s, 0.0, float(x)) for x in lengths]
        return float(lengths[int(np.argmin(grows))]) if not all(grows) else self._length_max_mm

    def _advance(
        self, length: float, pressure: float, feed: float, turn: float, push: float, catheter: float, dt: float
    ) -> float:
        """Return the growth [mm] in ``dt``."""
        driving = pressure - push - self._resist(length, pressure, feed, turn, catheter)
        if driving > 0.0 and not self._moving:
            self._moving = True
            driving = pressure - push - self._resist(length, pressure, feed, turn, catheter)
        self._moving = driving > 0.0
        material = 2.0 * self._length_max_mm - self._fed
        fed = max(min(feed * dt, material), 0.0)
        if not self._moving:
            self._fed += fed
            return 0.0
        steeper = self._resist(length + 0.01, pressure, feed, turn, catheter) - (pressure - push - driving)
        hardening = max(steeper / 0.01, 0.0)
        speed = self._rate(driving)
        room = driving / hardening if hardening > 0.0 else math.inf  # nobody grows past the balance
        slack = self._fed - 2.0 * length
        if slack > 1e-9:
            growth = min(speed * dt, room, 0.5 * (slack + fed))
            self._fed += fed
        else:
            growth = min(self._taut(speed, feed) * dt, room, 0.5 * max(material, 0.0))
            self._fed += 2.0 * growth
        return min(growth, self._length_max_mm - length)

    def _resist(self, length: float, pressure: float, feed: float, turn: float, catheter: float) -> float:
        """Return the pressure [kPa] that yield and friction take."""
        effects = self._effects
        kinetic = effects.eversion_yield.kinetic_kpa
        static = max(effects.eversion_yield.static_kpa, kinetic)
        slowness = math.exp(-max(self._speed, 0.0) / STRIBECK_MM_S)
        if "stribeck_yield" in self._forms:
            folding = kinetic + (static - kinetic) * slowness
        else:
            folding = kinetic if self._moving else static
        tail = effects.tail_coulomb_friction
        scale = 1.0
        if tail.speed_exponent > 0.0 and feed > FRICTION_REFERENCE_MM_S:
            scale = (feed / FRICTION_REFERENCE_MM_S) ** -tail.speed_exponent
        loss = scale * length * (tail.gradient_kpa_per_mm + tail.pressure_gradient_per_mm * pressure)
        loss += kinetic * math.expm1(min(scale * tail.yield_growth_per_mm * length, 50.0))
        if "stribeck_tail" in self._forms:
            loss *= 0.75 + 0.5 * slowness
        squeezing = pressure
        if "saturating_squeeze" in self._forms:
            squeezing = SQUEEZE_KPA * math.tanh(pressure / SQUEEZE_KPA)
        overlap = min(length, catheter)
        loss += (
            2.0
            * effects.tail_catheter_friction.mu
            * squeezing
            * self._catheter_radius_mm
            * overlap
            / (self._radius_mm**2)
        )
        turned = effects.tail_capstan_friction.mu * turn
        return (folding + loss) * (1.0 + turned if "linear_capstan" in self._forms else math.exp(turned))

    def _rate(self, driving: float) -> float:
        """Return the speed [mm/s] that a driving pressure [kPa] sustains."""
        viscous = self._effects.viscous_eversion
        if viscous.resistance_kpa_s_mm <= 0.0:
            return math.inf
        if "sinh_rate" in self._forms:
            return SINH_KPA / viscous.resistance_kpa_s_mm * math.sinh(min(driving / SINH_KPA, 10.0))
        return float(driving**viscous.exponent) / viscous.resistance_kpa_s_mm

    def _taut(self, speed: float, feed: float) -> float:
        """Return the speed [mm/s] on a taut tail."""
        slip = self._effects.feed_limit.slip
        pace = 0.5 * (1.0 - slip) * feed
        if pace <= 0.0 or speed <= 0.0:
            return 0.0
        if slip <= 0.0:
            return min(speed, pace)
        power = SLIP_POWER if "sharp_slip" in self._forms else 1.0
        return float((speed**-power + pace**-power) ** (-1.0 / power))
