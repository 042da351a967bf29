"""The spring lattices of catheter and sheath: fibres that join neighbouring sections.

Every elastic property comes from these line springs. A *bundle* is the set of fibres of one body; between two sections
it is stretched by the mean strain e and bent by the rotation phi (about the section's x and y axes), so that the fibre
anchored at (x, y) has the strain e + (phi_x y - phi_y x) / l - rest. A fibre has its stiffness down to a buckling
strain, beyond which it carries no more: zero for a film (tension only), infinite for a solid. The mean strain is
eliminated: it takes the value at which the fibres balance the axial force (the pressure thrust p A for the sheath,
none for the catheter). Diagonal braces, tangential at the anchors, resist twist. No bending or torsional stiffness is
entered in a kernel: wrinkling, stiffening by pressure, and bending by a softened fibre emerge.
"""

from __future__ import annotations

import math

import numpy as np

from evergym.effects.catalogue import Effects
from evergym.jit import njit
from evergym.robot import RobotConfig
from evergym.units import MM, MPA, UM

__all__ = ["FibreBundle", "build_catheter_bundle", "build_proximal_bundle", "build_sheath_bundle", "compute_bundle"]

FibreBundle = np.ndarray
"""Fibres of one body, shape (n, 6): rigidity EA [N], anchor x and y [m], rest strain [1], buckling strain [1], and the
rigidity of the diagonal brace at the anchor [N], which resists that the next section turns about the axis."""


NITINOL_POISSON_RATIO = 0.33
"""Of the uncut tube: G J = E I / (1 + nu) gives 4.9e-3 N m^2 for the 2023 robot."""

FIBRE_COUNT_MAX = 62
"""The kernel keeps the set of taut fibres in the bits of one integer."""


def build_sheath_bundle(robot: RobotConfig, effects: Effects, fibre_count: int) -> FibreBundle:
    """Return ``fibre_count`` equal fibres around the sheath whose rigidities add up to that of the film."""
    radius = 0.5 * robot.sheath_outer_diameter_mm * MM
    rigidity = robot.sheath_modulus_mpa * MPA * 2.0 * math.pi * radius * robot.sheath_wall_um * UM
    # Half a step of rotation keeps the fibres off the axes, so that no load in an axis plane meets a single outermost
    # fibre.
    angle = 2.0 * math.pi * (np.arange(fibre_count) + 0.5) / fibre_count
    bundle = np.zeros((fibre_count, 6))
    bundle[:, 0] = rigidity / fibre_count
    bundle[:, 1] = radius * np.cos(angle)
    bundle[:, 2] = radius * np.sin(angle)
    if not effects.wall_wrinkling.enabled:
        bundle[:, 4] = math.inf
    elif effects.root_kink.moment_n_m > 0.0:
        # A film that resists a moment M_0 without pressure: a thin ring yielding on both sides carries 4 R T / 2 pi of
        # it.
        bundle[:, 4] = effects.root_kink.moment_n_m * math.pi / (2.0 * radius * rigidity)
    return bundle


def _build_four_fibres(soft: float, stiff: float, torsion: float, radius: float, curvature: float) -> FibreBundle:
    """Return a soft and a stiff pair of fibres; the soft plane holds the x axis (the tendon's side)."""
    bundle = np.zeros((4, 6))
    bundle[:, 0] = np.array([soft, stiff, soft, stiff]) / (2.0 * radius**2)
    bundle[:, 1] = radius * np.array([1.0, 0.0, -1.0, 0.0])
    bundle[:, 2] = radius * np.array([0.0, 1.0, 0.0, -1.0])
    # Bending towards +x shortens the fibres there.
    bundle[:, 3] = -curvature * bundle[:, 1]
    bundle[:, 4] = math.inf
    bundle[:, 5] = torsion / (4.0 * radius**2)
    return bundle


def build_catheter_bundle(robot: RobotConfig, effects: Effects) -> FibreBundle:
    """Return the four fibres of the notched, flexible part of the catheter."""
    soft = robot.catheter_bending_stiffness_n_m2
    stiff = soft * (robot.catheter_anisotropy if effects.bending_anisotropy.enabled else 1.0)
    radius = 0.5 * robot.catheter_outer_diameter_mm * MM
    torsion = robot.catheter_torsional_stiffness_n_m2
    return _build_four_fibres(soft, stiff, torsion, radius, effects.pre_curvature.curvature_1_per_m)


def build_proximal_bundle(robot: RobotConfig) -> FibreBundle:
    """Return the four equal fibres of the uncut tube that is fed behind the flexible part."""
    stiffness = robot.catheter_proximal_stiffness_n_m2
    torsion = stiffness / (1.0 + NITINOL_POISSON_RATIO)
    return _build_four_fibres(stiffness, stiffness, torsion, 0.5 * robot.catheter_outer_diameter_mm * MM, 0.0)


@njit
def compute_bundle(
    bundle: FibreBundle, axial_force: float, bend_x: float, bend_y: float, length: float, out: FibreBundle
) -> None:
    """Bend a bundle of fibres between two sections, with its mean strain in balance.

    Args:
        bundle: Fibres, shape (n, 6), see `FibreBundle`.
        axial_force: Force that stretches the bundle [N].
        bend_x: Rotation between the sections about x [rad].
        bend_y: Rotation about y [rad].
        length: Rest length of the fibres [m].
        out: Overwritten, shape (7,): energy less the work of the axial force [J]; moment x, y [N m]; stiffness xx, xy,
            yy [N m]; mean strain [1].
    """
    n = bundle.shape[0]
    kx = bend_x / length
    ky = bend_y / length
    strain = 0.0
    previous_taut = -1
    s0 = sx = sy = 0.0
    for _ in range(2 * n + 4):
        s0 = sx = sy = force = 0.0
        taut = 0
        for i in range(n):
            offset = kx * bundle[i, 2] - ky * bundle[i, 1] - bundle[i, 3]
            # The first sweep takes every fibre as taut; then Newton on a convex, piecewise quadratic energy ends in
            # few.
            if previous_taut < 0 or strain + offset > -bundle[i, 4]:
                s0 += bundle[i, 0]
                sx += bundle[i, 0] * bundle[i, 2]
                sy -= bundle[i, 0] * bundle[i, 1]
                force += bundle[i, 0] * offset
                taut |= 1 << i
            else:
                force -= bundle[i, 0] * bundle[i, 4]
        if s0 == 0.0:
            break
        strain = (axial_force - force) / s0
        if taut == previous_taut:
            break
        previous_taut = taut
    energy = -axial_force * strain
    mx = my = kxx = kxy = kyy = 0.0
    for i in range(n):
        a = bundle[i, 2]
        b = -bundle[i, 1]
        stretch = strain + kx * a + ky * b - bundle[i, 3]
        if stretch > -bundle[i, 4]:
            force = bundle[i, 0] * stretch
            energy += 0.5 * force * stretch
            kxx += bundle[i, 0] * a * a
            kxy += bundle[i, 0] * a * b
            kyy += bundle[i, 0] * b * b
        else:
            force = -bundle[i, 0] * bundle[i, 4]
            energy += force * (stretch + 0.5 * bundle[i, 4])
        mx += force * a
        my += force * b
    if s0 > 0.0:
        kxx -= sx * sx / s0
        kxy -= sx * sy / s0
        kyy -= sy * sy / s0
    out[0] = energy * length
    out[1] = mx
    out[2] = my
    out[3] = kxx / length
    out[4] = kxy / length
    out[5] = kyy / length
    out[6] = strain
