"""Elasticity comes from the fibres and from nothing else: softening one of them bends the body as beam theory says."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from evergym.simulator import Command, Simulator

LENGTH = 0.095
NO_GROWTH = {"eversion_yield.static_kpa": 1000.0, "eversion_yield.kinetic_kpa": 1000.0}

Create = Callable[..., Simulator]


@pytest.mark.parametrize("fibres", [12, 31])
@pytest.mark.parametrize("softer", [0.1, 0.5])
def test_softened_fibre_bends_a_pressurised_sheath(create_robot: Create, fibres: int, softer: float) -> None:
    """A composite beam: the thrust p A acts on the axis, the stiffness is centred away from the soft fibre."""
    pressure, radius = 40e3, 1.5e-3
    sheath = create_robot(NO_GROWTH, setup="sheath", fibres=fibres)
    soft = 3
    bundle = sheath.parameters.robot.sheath_bundle
    rigidity = bundle[soft, 0]
    direction = bundle[soft, 1:3] / radius
    bundle[soft, 0] *= 1.0 - softer
    sheath.reset(everted_length=LENGTH, pressure=pressure)
    reading = sheath.advance(Command(pressure=pressure), 5.0)
    # Sums over the fibres, written out: n of rigidity k on a circle, one of them (1 - s) k.
    total = (fibres - softer) * rigidity
    centre = -softer * rigidity * radius / total
    second = (0.5 * fibres - softer) * rigidity * radius**2 - total * centre**2
    thrust = pressure * math.pi * radius**2
    curvature = thrust * abs(centre) / second
    # The softened side is the outside of the bend.
    angle = curvature * LENGTH
    across = (1.0 - math.cos(angle)) / curvature
    expected = np.append(-across * direction, math.sin(angle) / curvature)
    assert angle > 1e-3
    # A uniform bend: only the polygon's error remains, h^2 kappa^2 / 24 < 1e-6 of the length.
    np.testing.assert_allclose(reading.tip_position, expected, atol=1e-6 * LENGTH)


@pytest.mark.parametrize("softer", [0.25, 0.75])
@pytest.mark.parametrize("fibre", [0, 1, 2, 3])
def test_softened_fibre_changes_the_catheters_stiffness(create_robot: Create, fibre: int, softer: float) -> None:
    """EI of what the fibres make: each EA times the square of its distance from their common centre."""
    catheter = create_robot()
    bundle = catheter.parameters.robot.flexible_bundle
    bundle[fibre, 0] *= 1.0 - softer
    for axis in (0, 1):
        rigidity, offset = bundle[:, 0], bundle[:, 1 + axis]
        centre = (rigidity @ offset) / rigidity.sum()
        stiffness = rigidity @ (offset - centre) ** 2
        load = 0.005 * stiffness / LENGTH**2
        tip_load = [0.0, 0.0, 0.0]
        tip_load[axis] = load
        catheter.reset()
        reading = catheter.advance(Command(tip_load=tuple(tip_load)), 5.0)
        # 0.1 %: as B1, at a load of which the elastica makes 4e-6.
        assert reading.tip_position[axis] == pytest.approx(load * LENGTH**3 / (3.0 * stiffness), rel=1e-3)


def test_pre_curvature_is_the_fibres_rest_length(create_robot: Create) -> None:
    catheter = create_robot({"pre_curvature.curvature_1_per_m": -2.2})
    reading = catheter.advance(Command(), 5.0)
    assert math.atan2(reading.tip_direction[0], reading.tip_direction[2]) == pytest.approx(-2.2 * LENGTH, rel=1e-9)
    # Fibres of equal length again: straight. (The tendon, fitted to the bent catheter, is slack then.)
    catheter.parameters.robot.flexible_bundle[:, 3] = 0.0
    catheter.reset()
    assert catheter.advance(Command(), 5.0).tip_position[0] == pytest.approx(0.0, abs=1e-12)
