"""The bench protocols: complete, at rest, converged, and doing what the bench did."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evergym.errors import ConfigError
from evergym.experiments.paper import EXPERIMENTS, READING_LENGTH, load_experiment
from evergym.experiments.protocols import PROTOCOLS, bench, sheath, simulate
from evergym.model import Model, Numerics, load_model
from evergym.units import DEG

MODEL = load_model("mammobot_2023")


def with_kink(model: Model) -> Model:
    """The hinge at the sheath's root as it was read off Fig. 9."""
    kink = replace(model.effects.root_kink, moment_n_m=1.2e-4, pressure_share=0.305)
    return replace(model, effects=replace(model.effects, root_kink=kink))


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_has_a_protocol(name: str) -> None:
    experiment = load_experiment(name)
    values = simulate(MODEL, name)
    # Within what the reading of the worst figure leaves, sign and unit are right.
    assert experiment.compute_error(values) < 0.6 * np.mean(np.abs(experiment.measured)) + 3.0 * experiment.resolution
    assert list(PROTOCOLS) == list(EXPERIMENTS)


def test_an_unknown_experiment_is_named() -> None:
    with pytest.raises(ConfigError, match="Unknown experiment 'fig12'"):
        simulate(MODEL, "fig12")


def test_protocols_repeat_themselves() -> None:
    assert simulate(MODEL, "fig11d").tolist() == simulate(MODEL, "fig11d").tolist()


@pytest.mark.parametrize("name", ["fig6_toward", "fig6_opposite", "fig6_90deg"])
def test_no_load_reads_nothing(name: str) -> None:
    assert simulate(MODEL, name)[0] == 0.0


def test_without_a_tendon_the_catheter_bends_alike_to_both_sides() -> None:
    small = replace(MODEL.effects, pre_curvature=replace(MODEL.effects.pre_curvature, curvature_1_per_m=0.0))
    straight = replace(MODEL, effects=small)
    # What is left of the tendon, 0.1 m/N, still tells the sides apart by some permille.
    toward, opposite = simulate(straight, "fig6_toward"), simulate(straight, "fig6_opposite")
    np.testing.assert_allclose(toward, -opposite, rtol=5e-3)


def test_a_load_across_the_plane_hardly_bends_it() -> None:
    # The load tilts the pre-curved tip; the robot's reading was 1 degree at most, too.
    assert np.abs(simulate(MODEL, "fig6_90deg")).max() < 1.0 * DEG / READING_LENGTH


def test_the_sheaths_growth_does_not_depend_on_the_step(monkeypatch: pytest.MonkeyPatch) -> None:
    coarse = simulate(MODEL, "fig8a")
    monkeypatch.setattr(sheath, "_GROWTH", Numerics(section_length_mm=10.0, step_s=0.05))
    assert simulate(MODEL, "fig8a") == pytest.approx(coarse, abs=0.01)  # mm; measured 0.001


def test_speed_is_length_over_time() -> None:
    times = load_experiment("fig8c").points.end_time
    assert simulate(MODEL, "fig8c").tolist() == pytest.approx(list(simulate(MODEL, "fig8b") / times))


def test_the_sheath_hangs_from_its_kink() -> None:
    angles = simulate(with_kink(MODEL), "fig9")
    # cos(theta) = 2 M_h / (w L^2); a root of 0.5 mm takes off up to 0.4 degrees.
    assert angles == pytest.approx([63.1, 56.5, 49.4, 41.4, 31.9], abs=0.5)


@pytest.mark.parametrize("name", ["fig7", "fig10", "fig11b", "fig11c"])
def test_statics_are_converged(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    values = simulate(MODEL, name)
    monkeypatch.setattr(bench, "STATICS", Numerics(section_length_mm=95.0 / 80.0, step_s=0.5))
    assert simulate(MODEL, name) == pytest.approx(values, abs=0.02)  # 1/m; a fifth of what the readings resolve


def test_tips_of_an_arc_are_those_of_its_angle() -> None:
    values = simulate(MODEL, "tip_position").reshape(-1, 2)
    curvature = simulate(MODEL, "fig10")
    angle = curvature * READING_LENGTH
    arcs = np.column_stack((1.0 - np.cos(angle), np.sin(angle))) / curvature[:, None] * 1e3
    # The bend is not quite uniform: some millimetres, not centimetres, off the arc with the same angle.
    assert np.linalg.norm(values - arcs, axis=1).max() < 4.0
    assert np.all(np.hypot(*values.T) < READING_LENGTH * 1e3)
