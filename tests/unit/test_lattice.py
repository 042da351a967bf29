"""Bundles of fibres: stiffness from springs alone, mean strain in balance, derivatives of one energy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evergym.effects.bending_anisotropy import BendingAnisotropy
from evergym.effects.catalogue import Effects
from evergym.effects.pre_curvature import PreCurvature
from evergym.effects.root_kink import RootKink
from evergym.effects.wall_wrinkling import WallWrinkling
from evergym.lattice import build_catheter_bundle, build_proximal_bundle, build_sheath_bundle, compute_bundle
from evergym.robot import RobotConfig

LENGTH = 2e-3
ROBOT = RobotConfig()
SHEATH = build_sheath_bundle(ROBOT, Effects(), 12)
CATHETER = build_catheter_bundle(ROBOT, Effects())
THRUST = 30e3 * math.pi * 1.5e-3**2


def _bend(bundle: np.ndarray, thrust: float, x: float, y: float) -> np.ndarray:
    out = np.zeros(7)
    compute_bundle(bundle, thrust, x, y, LENGTH, out)
    return out


def test_sheath_is_as_stiff_as_its_film() -> None:
    assert SHEATH[:, 0].sum() == pytest.approx(3e8 * 2.0 * math.pi * 1.5e-3 * 35e-6, rel=1e-12)
    out = _bend(SHEATH, THRUST, 0.0, 0.0)
    stiffness = 3e8 * math.pi * 1.5e-3**3 * 35e-6
    assert out[3] * LENGTH == pytest.approx(stiffness, rel=1e-12)
    assert out[5] * LENGTH == pytest.approx(stiffness, rel=1e-12)
    assert out[4] * LENGTH == pytest.approx(0.0, abs=1e-12 * stiffness)
    assert stiffness == pytest.approx(1.1e-4, rel=0.02)  # the catalogue's two digits


def test_sheath_takes_the_strain_that_carries_the_thrust() -> None:
    assert _bend(SHEATH, THRUST, 0.0, 0.0)[6] == pytest.approx(THRUST / SHEATH[:, 0].sum(), rel=1e-12)


def test_catheter_has_a_soft_plane_with_the_tendon_and_a_stiff_one() -> None:
    out = _bend(CATHETER, 0.0, 0.0, 0.0)
    assert out[5] * LENGTH == pytest.approx(4.23e-4, rel=1e-12)  # about y: towards x, where the tendon lies
    assert out[3] * LENGTH == pytest.approx(15.0 * 4.23e-4, rel=1e-12)
    assert _bend(build_proximal_bundle(ROBOT), 0.0, 0.0, 0.0)[[3, 5]] * LENGTH == pytest.approx(6.5e-3, rel=1e-12)


def test_catheter_without_anisotropy_is_soft_all_round() -> None:
    bundle = build_catheter_bundle(ROBOT, Effects(bending_anisotropy=BendingAnisotropy(enabled=False)))
    assert _bend(bundle, 0.0, 0.0, 0.0)[[3, 5]] * LENGTH == pytest.approx(4.23e-4, rel=1e-12)


@pytest.mark.parametrize("curvature", [2.2, -1.0])
def test_pre_curved_catheter_rests_bent_towards_the_tendon(curvature: float) -> None:
    bundle = build_catheter_bundle(ROBOT, Effects(pre_curvature=PreCurvature(curvature_1_per_m=curvature)))
    at_rest = _bend(bundle, 0.0, 0.0, curvature * LENGTH)  # about +y: towards +x
    assert np.abs(at_rest[1:3]).max() < 1e-15
    assert at_rest[0] == pytest.approx(0.0, abs=1e-18)


@given(x=st.floats(-0.2, 0.2), y=st.floats(-0.2, 0.2), pressure=st.floats(1e3, 5e4))
def test_moment_is_the_energys_derivative(x: float, y: float, pressure: float) -> None:
    thrust = pressure * math.pi * 1.5e-3**2
    step = 1e-6
    for bundle, force in ((SHEATH, thrust), (CATHETER, 0.0)):
        out = _bend(bundle, force, x, y)
        by_x = (_bend(bundle, force, x + step, y)[0] - _bend(bundle, force, x - step, y)[0]) / (2.0 * step)
        by_y = (_bend(bundle, force, x, y + step)[0] - _bend(bundle, force, x, y - step)[0]) / (2.0 * step)
        # Rounding of an energy of up to 0.1 J over 2e-6, and half a stiffness times the step where a fibre goes slack.
        tolerance = 1e-15 * abs(out[0]) / step + 0.5 * step * max(out[3], out[5]) + 1e-12
        assert out[1] == pytest.approx(by_x, abs=10.0 * tolerance)
        assert out[2] == pytest.approx(by_y, abs=10.0 * tolerance)


@given(x=st.floats(-0.5, 0.5), y=st.floats(-0.5, 0.5), pressure=st.floats(0.0, 5e4))
def test_stiffness_is_symmetric_positive_and_the_fibres_balance(x: float, y: float, pressure: float) -> None:
    thrust = pressure * math.pi * 1.5e-3**2
    out = _bend(SHEATH, thrust, x, y)
    stiffness = np.array([[out[3], out[4]], [out[4], out[5]]])
    assert np.linalg.eigvalsh(stiffness).min() >= -1e-12 * SHEATH[:, 0].sum() * 1.5e-3**2 / LENGTH
    strain = out[6] + (x * SHEATH[:, 2] - y * SHEATH[:, 1]) / LENGTH
    force = SHEATH[:, 0] * np.maximum(strain, 0.0)
    if thrust > 0.0:
        assert force.sum() == pytest.approx(thrust, rel=1e-9)
    # The film carries at most the collapse moment pi p R^3, whatever the bend.
    assert math.hypot(out[1], out[2]) <= thrust * 1.5e-3 * (1.0 + 1e-9) + 1e-15


def test_braces_add_up_to_the_torsional_stiffness() -> None:
    def sum_braces(bundle: np.ndarray) -> float:
        return float(bundle[:, 5] @ np.square(bundle[:, 1:3]).sum(axis=1))

    assert sum_braces(CATHETER) == pytest.approx(7.4e-4, rel=1e-12)
    assert sum_braces(build_proximal_bundle(ROBOT)) == pytest.approx(4.9e-3, rel=0.01)  # row 17's two digits
    assert sum_braces(SHEATH) == 0.0  # the sheath does not twist


def test_two_sided_fibres_do_not_wrinkle() -> None:
    bundle = build_sheath_bundle(ROBOT, Effects(wall_wrinkling=WallWrinkling(enabled=False)), 12)
    small, large = _bend(bundle, THRUST, 1e-6, 0.0), _bend(bundle, THRUST, 0.2, 0.0)
    assert large[1] / small[1] == pytest.approx(2e5, rel=1e-9)


def test_film_with_a_resistance_of_its_own_carries_it_without_pressure() -> None:
    """M_0 of the root kink: what a thin ring carries when all its fibres have buckled on one side and give on the
    other.
    """
    effects = Effects(root_kink=RootKink(moment_n_m=1.2e-4))
    bundle = build_sheath_bundle(ROBOT, effects, 60)
    out = _bend(bundle, 0.0, 2.0, 0.0)
    assert out[1] > 0.5 * 1.2e-4
    assert _bend(build_sheath_bundle(ROBOT, Effects(), 60), 0.0, 2.0, 0.0)[1] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("count", [4, 7, 12, 62])
def test_fibre_count_does_not_change_the_taut_tube(count: int) -> None:
    bundle = build_sheath_bundle(ROBOT, Effects(), count)
    reference = _bend(SHEATH, THRUST, 1e-4, 2e-4)
    np.testing.assert_allclose(_bend(bundle, THRUST, 1e-4, 2e-4), reference, rtol=1e-9, atol=1e-15)
