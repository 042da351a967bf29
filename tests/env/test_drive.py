"""Actions: scaled to the robot's limits, clipped, limited in rate, refused where they are not finite."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evergym.envs.drive import Drive, DriveLimits, check_action
from evergym.robot import RobotConfig
from evergym.units import KPA, MM

LIMITS = DriveLimits.from_robot(RobotConfig())


def test_limits_of_the_default_robot() -> None:
    """The catheter moves at half of the tail's 5.8 mm/s; 4.9 mm of pull; 50 kPa."""
    assert LIMITS.insertion_velocity == pytest.approx(2.9 * MM)
    assert LIMITS.tendon_pull == pytest.approx(4.9 * MM)
    assert LIMITS.pressure == pytest.approx(50.0 * KPA)


def test_velocity_acts_at_once_and_set_points_follow() -> None:
    """Full pull takes its rate's time, neither more nor less."""
    drive = Drive(LIMITS)
    duration = 0.25
    full = [1.0, 0.0, 1.0, 1.0]
    first = drive.command(full, duration, 0.01, 0.01)
    assert first.insertion_velocity == LIMITS.insertion_velocity
    assert first.tendon_pull == pytest.approx(LIMITS.tendon_pull_rate * duration)
    assert first.pressure == pytest.approx(LIMITS.pressure_rate * duration)
    steps = int(np.ceil(LIMITS.tendon_pull / (LIMITS.tendon_pull_rate * duration)))
    for _ in range(steps - 2):
        assert drive.command(full, duration, 0.01, 0.01).tendon_pull < LIMITS.tendon_pull
    assert drive.command(full, duration, 0.01, 0.01).tendon_pull == LIMITS.tendon_pull
    assert drive.command([0.0, 0.0, -1.0, 0.0], duration, 0.01, 0.01).tendon_pull < LIMITS.tendon_pull


def test_the_tail_is_coupled() -> None:
    """No tail velocity of its own: the simulator feeds twice the insertion, in both directions."""
    assert Drive(LIMITS).command([-1.0, 0.0, 0.0, 0.0], 0.25, 0.01, 0.01).tail_feed_velocity is None


def test_catheter_is_not_withdrawn_beyond_the_port() -> None:
    """The velocity is what brings its end to the port, not more."""
    command = Drive(LIMITS).command([-1.0, 0.0, 0.0, 0.0], 0.5, 0.2 * MM, 10.0 * MM)
    assert command.insertion_velocity == pytest.approx(-0.4 * MM)


@given(st.lists(st.floats(-1.0, 1.0, width=32), min_size=4, max_size=4))
def test_action_for_inverts_the_scaling(action: list[float]) -> None:
    """A controller that thinks in SI gets the action that commands its values."""
    drive = Drive(LIMITS)
    velocity = action[0] * LIMITS.insertion_velocity
    pull, pressure = (
        0.5 * (a + 1.0) * top for a, top in zip(action[2:], (LIMITS.tendon_pull, LIMITS.pressure), strict=True)
    )
    found = drive.action_for(velocity, action[1] * LIMITS.roll_rate, pull, pressure)
    np.testing.assert_allclose(found, action, atol=1e-6)


@pytest.mark.parametrize("index", range(4))
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_actions_that_are_not_finite_name_their_component(index: int, value: float) -> None:
    """The message says which of the four it was."""
    action = np.zeros(4, dtype=np.float32)
    action[index] = value
    with pytest.raises(ValueError, match=rf"action\[{index}\]"):
        check_action(action)


@pytest.mark.parametrize("action", [np.zeros(3), np.zeros((1, 4)), 0.5, []], ids=["3", "1x4", "scalar", "empty"])
def test_actions_of_another_shape_are_refused(action: object) -> None:
    """Broadcasting would hide a mistake."""
    with pytest.raises(ValueError, match="shape"):
        check_action(action)


def test_out_of_range_is_clipped() -> None:
    """Far out of range is the same, to the bit, as at the limit."""
    wild, tame = (gymnasium.make("MammobotPegs-v0").unwrapped for _ in range(2))
    wild.reset(seed=0)
    tame.reset(seed=0)
    first = wild.step(np.array([7.0, -9.0, 3.0, 1e9]))[0]
    second = tame.step(np.array([1.0, -1.0, 1.0, 1.0]))[0]
    np.testing.assert_array_equal(first, second)


def test_long_control_steps_keep_ramps() -> None:
    """One step of 1 s is four of 0.25 s: set points ramp inside it, they do not jump."""
    slow = gymnasium.make("MammobotPegs-v0", control_step_s=1.0).unwrapped
    fast = gymnasium.make("MammobotPegs-v0").unwrapped
    slow.reset(seed=0)
    fast.reset(seed=0)
    action = np.array([0.5, 0.3, 0.4, 1.0], dtype=np.float32)
    *_, slow_info = slow.step(action)
    for _ in range(4):
        *_, fast_info = fast.step(action)
    for key in ("everted_length_mm", "pressure_kpa", "tendon_pull_mm", "time_s"):
        assert slow_info[key] == fast_info[key]


def test_the_interlock_holds_a_catheter_that_is_far_ahead_and_feeds_the_tail_on() -> None:
    drive = Drive(LIMITS)
    free = drive.command([1.0, 0.0, 0.0, 0.0], 0.25, 0.015, 0.010)
    assert free.insertion_velocity == LIMITS.insertion_velocity and free.tail_feed_velocity is None
    held = drive.command([1.0, 0.0, 0.0, 0.0], 0.25, 0.010 + LIMITS.protrusion, 0.010)
    assert held.insertion_velocity == 0.0
    assert held.tail_feed_velocity == 2.0 * LIMITS.insertion_velocity
    back = drive.command([-1.0, 0.0, 0.0, 0.0], 0.25, 0.010 + LIMITS.protrusion, 0.010)
    assert back.insertion_velocity == -LIMITS.insertion_velocity and back.tail_feed_velocity is None
