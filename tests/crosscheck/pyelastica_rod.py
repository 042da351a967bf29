"""The sag case in PyElastica: a Cosserat rod that shears and stretches, by explicit relaxation."""

from __future__ import annotations

import contextlib
import importlib.metadata
import io
import logging
import time

import elastica
import numpy as np

from tests.crosscheck.sag_case import CASE, Result, SagCase

__all__ = ["run_pyelastica"]

STEP_S = 4e-6
"""Just below the stability limit, which the shear of one element sets (5e-6 s with 50 elements)."""

SETTLING_S = 0.5
"""At critical damping, e^-14 of the motion is left (first mode: 28 rad/s)."""


class _Scene(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing, elastica.Damping):  # type: ignore[misc]
    """One rod with a clamp, weight and damping."""


def _create_scene(case: SagCase, elements: int) -> tuple[_Scene, elastica.CosseratRod]:
    # The clamp holds the first element's direction, at its middle: half an element lies behind the clamp.
    size = case.length / (elements - 0.5)
    logging.disable(logging.WARNING)  # it warns of inertias below 1e-12 kg m^2, as thin rods have them
    rod = elastica.CosseratRod.straight_rod(
        elements,
        np.array([-0.5 * size, 0.0, 0.0]),
        np.array([1.0, 0.0, 0.0]),
        np.array([0.0, 0.0, 1.0]),
        elements * size,
        case.radius,
        case.density,
        youngs_modulus=case.modulus,
        shear_modulus=case.modulus / 3.0,
    )
    logging.disable(logging.NOTSET)
    scene = _Scene()
    scene.append(rod)
    scene.constrain(rod).using(elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,))
    scene.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=np.array([0.0, -case.gravity, 0.0]))
    # Near critical for the first mode: 2 x 28 rad/s times a node's mass, and so for an element's spin.
    mass = case.mass_per_length * size
    scene.dampen(rod).using(
        elastica.AnalyticalLinearDamper,
        translational_damping_constant=56.0 * mass,
        rotational_damping_constant=56.0 * mass * case.radius**2 / 4.0,
        time_step=STEP_S,
    )
    scene.finalize()
    return scene, rod


def _advance(scene: _Scene, duration: float) -> None:
    with contextlib.redirect_stdout(io.StringIO()):  # it prints the time at the end
        elastica.integrate(elastica.PositionVerlet(), scene, duration, round(duration / STEP_S), progress_bar=False)


def run_pyelastica(case: SagCase = CASE, elements: int = 50) -> Result:
    """Return what PyElastica says about the rod at rest."""
    _advance(_create_scene(case, elements)[0], 2.0 * STEP_S)  # compiles its kernels
    scene, rod = _create_scene(case, elements)
    start = time.process_time()
    _advance(scene, SETTLING_S)
    seconds = time.process_time() - start
    along, up = rod.position_collection[:2, -1] * 1e3
    version = importlib.metadata.version("pyelastica")
    return Result(f"PyElastica {version}", "Cosserat rod, explicit", elements, (float(along), float(up)), seconds)
