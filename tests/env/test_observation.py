"""The observation: documented, bounded, in the frame it says, hidden and noisy where asked."""

from __future__ import annotations

import inspect

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evergym.envs.duct import MammobotDuctEnv
from evergym.envs.goal import MammobotDuctGoalEnv, MammobotPegsGoalEnv
from evergym.envs.observation import (
    DUCT_TERMS,
    PEG_TERMS,
    ObservationTerm,
    compute_tip_frame,
    make_observation_space,
    observation_table,
    term_slices,
)
from evergym.envs.pegs import MammobotPegsEnv

DUCT = term_slices(DUCT_TERMS)
PEGS = term_slices(PEG_TERMS)
UNIT = st.floats(-1.0, 1.0)


@pytest.mark.parametrize(
    ("env_class", "terms"), [(MammobotDuctEnv, DUCT_TERMS), (MammobotPegsEnv, PEG_TERMS)], ids=["duct", "pegs"]
)
def test_docstring_lists_every_term(env_class: type, terms: tuple[ObservationTerm, ...]) -> None:
    """The table in the docstring is the one made from the terms, so it cannot go stale."""
    assert observation_table(terms) in (inspect.getdoc(env_class) or "")
    assert make_observation_space(terms).shape == (sum(term.size for term in terms),)
    assert len({term.name for term in terms}) == len(terms)


@given(st.tuples(UNIT, UNIT, UNIT), st.tuples(UNIT, UNIT, UNIT))
def test_tip_frame_is_a_rotation(direction: tuple[float, float, float], side: tuple[float, float, float]) -> None:
    """Right-handed and orthonormal for any direction, even with a side along it."""
    if np.linalg.norm(direction) < 1e-3:
        direction = (0.0, 0.0, 1.0)
    frame = np.array(compute_tip_frame(direction, side)).reshape(3, 3)
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-6)  # 1e-9 of side left after 1e-3 of direction
    assert np.linalg.det(frame) == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(frame[2], np.array(direction) / np.linalg.norm(direction), atol=1e-12)


def test_start_shows_the_way_ahead() -> None:
    """At the start the tip looks along +z, so points ahead lie along the tip frame's third axis, at their distances."""
    env = gymnasium.make("MammobotDuct-v0")
    observation, info = env.reset(seed=0, options={"index": 0, "target": 0})
    # Pre-curvature bends a tip of 10 mm by some 1.3 degrees.
    np.testing.assert_allclose(observation[DUCT["tip_direction"]], (0.0, 0.0, 1.0), atol=0.06)
    np.testing.assert_allclose(observation[DUCT["tip_position"]] * 100.0, (0.0, 0.0, 10.0), atol=0.5)
    way = observation[DUCT["way_ahead"]].reshape(-1, 3) * 25.0
    # Chords: the way bends, and the first branch turns by up to 18 degrees.
    np.testing.assert_allclose(np.linalg.norm(way, axis=1), (3.0, 6.0, 10.0, 15.0, 20.0), rtol=0.1)
    assert (way[:, 2] > 0.9 * np.linalg.norm(way, axis=1)).all()
    assert observation[DUCT["distance_to_go"]][0] * 100.0 == pytest.approx(info["distance_to_go_mm"], rel=1e-6)
    assert observation[DUCT["time_left"]][0] == 1.0
    assert np.linalg.norm(observation[DUCT["roll"]]) == pytest.approx(1.0)


def test_pulling_bends_towards_the_tendon_side() -> None:
    """The frame means what it says: after a pull the tip has moved to the side that the observation named."""
    env = gymnasium.make("MammobotPegs-v0")
    observation, _ = env.reset(seed=0, options={"everted_length_mm": 30.0})
    relaxed = observation
    for _ in range(20):
        observation, *_ = env.step(np.array([0.0, 0.0, 1.0, 1.0], dtype=np.float32))
    moved = (observation - relaxed)[PEGS["tip_position"]]
    side = relaxed[PEGS["tendon_side"]]
    assert moved @ side * 100.0 > 1.0  # mm; full pull turns 30 mm by some 15 degrees
    assert abs(moved @ side) > 3.0 * np.linalg.norm(moved - (moved @ side) * side)


def test_hidden_map_is_zero_and_nothing_else_changes() -> None:
    """The other terms are bit for bit those of the open map."""
    hidden, _ = gymnasium.make("MammobotDuct-v0", hide_map=True, pool_size=1).reset(seed=1)
    shown, _ = gymnasium.make("MammobotDuct-v0", pool_size=1).reset(seed=1)
    for term in DUCT_TERMS:
        place = DUCT[term.name]
        if term.is_map:
            assert not hidden[place].any()
        else:
            np.testing.assert_array_equal(hidden[place], shown[place])
    assert shown[DUCT["way_ahead"]].any()


def test_localisation_noise_has_its_size_and_spares_the_truth() -> None:
    """The position scatters by the standard deviation asked for; reward and info do not see it."""
    noisy = gymnasium.make("MammobotDuct-v0", localisation_noise_mm=1.0, pool_size=1)
    exact = gymnasium.make("MammobotDuct-v0", pool_size=1)
    error = []
    noisy.reset(seed=2)
    exact.reset(seed=2, options={"target": noisy.unwrapped.target_index})  # type: ignore[attr-defined]
    for _ in range(100):
        action = np.array([0.0, 0.0, -1.0, -1.0], dtype=np.float32)
        seen, *_, info = noisy.step(action)
        true, *_, true_info = exact.step(action)
        error.append((seen - true)[DUCT["tip_position"]] * 100.0)
        assert info["tip_error_mm"] == true_info["tip_error_mm"]
    # 300 draws: the standard deviation's own standard error is 4 %.
    assert np.std(error) == pytest.approx(1.0, rel=0.15)
    assert abs(np.mean(error)) < 0.2


def test_goal_observation_holds_the_plain_one() -> None:
    """The goal ids add goals and change nothing in the observation."""
    for goal_class, plain_class in ((MammobotDuctGoalEnv, MammobotDuctEnv), (MammobotPegsGoalEnv, MammobotPegsEnv)):
        with_goal, _ = goal_class(pool_size=1).reset(seed=3)
        plain, _ = plain_class(pool_size=1).reset(seed=3)
        np.testing.assert_array_equal(with_goal["observation"], plain)
