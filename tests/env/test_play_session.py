"""Driving without a page: hands, who drives, frames, and episodes on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evergym.agents.play.episode import COLUMNS, DRIVERS, Episode
from evergym.agents.play.episode_file import find_episodes, read_episode, write_episode
from evergym.agents.play.hand import HOLD_GAP, KEY_TIME, DriveName, Hand
from evergym.agents.play.session import FRAME_RATE, Session
from evergym.duct_models.duct import Duct
from evergym.duct_models.pegs import PegField
from evergym.envs.drive import DriveLimits
from evergym.errors import ConfigError, GeometryError, RunError
from evergym.units import KPA, MM

LIMITS = DriveLimits(insertion_velocity=2.9 * MM, tendon_pull=4.9 * MM, pressure=50 * KPA)
PLACE = {"family": "held_out", "index": 0}


@pytest.fixture(scope="module")
def driven() -> Session:
    """A duct in which the duty cycle has reached the target, after a second by hand."""
    session = Session()
    session.reset(0, PLACE)
    session.hand.set(DriveName.PULL, 1.0 * MM)
    for _ in range(round(1.0 / session.interval)):
        session.step()
    session.hand_over("duty cycle")
    while not session.ended:
        session.step()
    return session


@pytest.fixture(scope="module")
def pegs() -> Session:
    """Half a second among the paper's pegs, pushed by hand."""
    session = Session("MammobotPegs-v0")
    session.reset(1, {"family": "paper", "index": 0})
    session.hand.set(DriveName.INSERTION, 2.0 * MM)
    session.hand.set(DriveName.PRESSURE, 40.0 * KPA)
    for _ in range(12):
        session.step()
    return session


class Clock:
    """Real time that passes when it is told to."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_a_key_ends_by_itself_and_a_slider_stays() -> None:
    clock = Clock()
    hand = Hand(LIMITS, clock)
    hand.set(DriveName.ROLL, 0.1)
    hand.press(DriveName.INSERTION, 1)
    clock.now += 0.9 * KEY_TIME
    hand.let_go()
    assert hand.value[DriveName.INSERTION] == pytest.approx(2.0 * MM)
    hand.press(DriveName.INSERTION, -1)  # a repeat, the other way: lasts as long again
    clock.now += 0.9 * KEY_TIME
    hand.let_go()
    assert hand.value[DriveName.INSERTION] == pytest.approx(-2.0 * MM)
    clock.now += 0.2 * KEY_TIME
    hand.let_go()
    assert hand.value[DriveName.INSERTION] == 0.0
    assert hand.value[DriveName.ROLL] == pytest.approx(0.1)


@pytest.mark.parametrize("repeats", [12, 40])
def test_a_held_key_moves_at_a_rate(repeats: int) -> None:
    """However often the keyboard repeats it, and whenever it is answered; a tap is a step."""
    clock = Clock()
    hand = Hand(LIMITS, clock)
    start = clock.now
    clock.now += 5.0  # all are answered late, in one go
    hand.press(DriveName.PULL, 1, start)
    assert hand.value[DriveName.PULL] == pytest.approx(0.1 * MM)
    for number in range(1, repeats + 1):
        hand.press(DriveName.PULL, 1, start + number / repeats)
    assert hand.value[DriveName.PULL] == pytest.approx(0.1 * MM + 2.0 * MM)  # a second at 2 mm/s
    hand.press(DriveName.PULL, -1, start + 1.0)
    assert hand.value[DriveName.PULL] == pytest.approx(2.0 * MM)  # the other key: a step back
    hand.press(DriveName.PULL, -1, start + 1.0 + HOLD_GAP)
    assert hand.value[DriveName.PULL] == pytest.approx(1.9 * MM)


def test_speed_does_not_shorten_a_key() -> None:
    """Eight times as fast, a press still lasts its half second of real time."""
    clock = Clock()
    session = Session("MammobotPegs-v0")
    session.hand = Hand(session.env.drive.limits, clock)
    session.reset(1, {"family": "paper", "index": 0})
    session.hand.press(DriveName.INSERTION, 1)
    for _ in range(24):  # a second of the robot's time
        session.step()
    assert session.frames[-1].values["command_insertion_mm_s"] == pytest.approx(2.0)
    clock.now += 1.1 * KEY_TIME
    session.step()
    assert session.frames[-1].values["command_insertion_mm_s"] == 0.0


def test_drives_stay_in_their_range() -> None:
    clock = Clock()
    hand = Hand(LIMITS, clock)
    for _ in range(100):
        clock.now += 0.2
        hand.press(DriveName.PULL, 1)
        hand.press(DriveName.PRESSURE, -1)
    assert hand.value[DriveName.PULL] == pytest.approx(4.9 * MM)
    assert hand.value[DriveName.PRESSURE] == 0.0
    hand.press(DriveName.ROLL, 1)
    hand.stop()
    assert hand.value[DriveName.ROLL] == 0.0
    assert hand.value[DriveName.PULL] == pytest.approx(4.9 * MM)


def test_the_hand_moves_the_robot(pegs: Session) -> None:
    """2 mm/s for 12 frames of 1/24 s: 1 mm of catheter, exactly, since the drive follows the velocity at once."""
    first, last = pegs.frames[0].values, pegs.frames[-1].values
    assert pegs.interval <= 1.0 / FRAME_RATE
    assert last["time_s"] == pytest.approx(12 * pegs.interval)
    assert last["catheter_length_mm"] - first["catheter_length_mm"] == pytest.approx(2.0 * 12 * pegs.interval, rel=1e-6)
    assert last["tip_z_mm"] > first["tip_z_mm"] + 0.5
    assert last["command_pressure_kpa"] == pytest.approx(40.0, abs=1e-4)
    assert set(last) == set(COLUMNS)


def test_the_duty_cycle_takes_over_and_arrives(driven: Session) -> None:
    assert driven.end_reason == "reached"
    assert driven.frames[-1].values["tip_error_mm"] <= driven.success_distance_mm
    drivers = [DRIVERS[int(frame.values["driver"])] for frame in driven.frames]
    second = round(1.0 / driven.interval)
    assert drivers[: second + 1] == ["hand"] * (second + 1)
    assert set(drivers[second + 1 :]) == {"duty cycle"}


def test_a_controller_is_asked_as_often_as_in_an_evaluation(driven: Session) -> None:
    """Its commands change only where its control step begins: every sixth frame after the hand-over."""
    start = round(1.0 / driven.interval) + 1
    commands = np.array([[v for k, v in f.values.items() if k.startswith("command_")] for f in driven.frames[start:]])
    changes = np.flatnonzero(np.any(np.diff(commands, axis=0) != 0.0, axis=1)) + 1
    assert driven.hold == 6
    assert len(changes) > 10
    assert set(changes % driven.hold) == {0}


def test_a_hand_that_takes_back_finds_the_drives_where_they_are() -> None:
    session = Session("MammobotPegs-v0")
    session.reset(0, {"family": "train", "index": 0})
    session.hand_over("duty cycle")
    for _ in range(120):
        session.step()
    pull, pressure = session.env.drive.tendon_pull, session.env.drive.pressure
    assert pull > 0.0
    session.hand_over("hand")
    session.step()
    assert session.env.drive.tendon_pull == pytest.approx(pull, abs=1e-9)
    assert session.env.drive.pressure == pytest.approx(pressure, abs=0.01)
    assert session.frames[-1].values["command_insertion_mm_s"] == 0.0


@pytest.mark.parametrize("stepped", [False, True], ids=["with the step that compiles", "without"])
def test_the_same_seed_is_the_same_episode(pegs: Session, stepped: bool) -> None:
    """Also with the step that is taken before the first episode, so that kernels are compiled."""
    again = Session("MammobotPegs-v0")
    if stepped:
        again._stepped.add(PegField)
    again.reset(1, {"family": "paper", "index": 0})
    assert again.frames[0].values["time_s"] == 0.0
    assert again._stepped == {PegField}
    again.hand.set(DriveName.INSERTION, 2.0 * MM)
    again.hand.set(DriveName.PRESSURE, 40.0 * KPA)
    for _ in range(12):
        again.step()
    for one, other in zip(pegs.frames, again.frames, strict=True):
        assert one.values == other.values
        np.testing.assert_array_equal(one.pose.shape.position, other.pose.shape.position)


def test_kernels_are_compiled_before_the_first_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    """One step where nobody waits with a hand on the keys; none at later resets."""
    session = Session("MammobotPegs-v0")
    count = 0
    step = session._env.step

    def count_step(action: Any) -> Any:
        nonlocal count
        count += 1
        return step(action)

    monkeypatch.setattr(session._env, "step", count_step)
    session.reset(0, {"family": "paper", "index": 0})
    assert count == 1
    session.reset(0, {"family": "train", "index": 0})
    assert count == 1


def test_what_cannot_be_done_is_said(pegs: Session) -> None:
    with pytest.raises(ConfigError, match="Mammobot environment"):
        Session("CartPole-v1")
    with pytest.raises(ConfigError, match="no environment 'MammobotDukt-v0'"):
        Session("MammobotDukt-v0")
    with pytest.raises(ConfigError, match="no policy to hand over to"):
        pegs.hand_over("policy")
    with pytest.raises(RunError, match="does not exist"):
        pegs.load_policy(Path("no/such/run"))
    frames = list(pegs.frames)
    with pytest.raises(ConfigError, match=r"options\['family'\] is 'no_such'; it must be one of"):
        pegs.reset(0, {"family": "no_such"})
    assert pegs.frames == frames  # the episode is still there
    fresh = Session("MammobotPegs-v0")
    with pytest.raises(RunError, match="Reset first"):
        fresh.step()


def check_same(episode: Episode, kept: Episode) -> None:
    assert kept.heading == episode.heading
    assert kept.target == episode.target
    np.testing.assert_array_equal(kept.way, episode.way)
    assert len(kept.frames) == len(episode.frames)
    for one, other in zip(episode.frames, kept.frames, strict=True):
        assert one.values == other.values
        assert one.pose.sheath_radius == other.pose.sheath_radius
        for name in ("position", "tangent", "station", "catheter_direction"):
            # Single precision of a length below 0.2 m, or of a unit vector.
            np.testing.assert_allclose(getattr(one.pose.shape, name), getattr(other.pose.shape, name), atol=1e-7)
        np.testing.assert_array_equal(one.pose.shape.in_sheath, other.pose.shape.in_sheath)
        np.testing.assert_allclose(one.pose.contacts.force, other.pose.contacts.force, rtol=1e-6)


def test_an_episode_in_a_duct_is_kept_whole(driven: Session, tmp_path: Path) -> None:
    episode = driven.episode()
    path = write_episode(episode, tmp_path / "new" / "a.episode.npz")
    kept = read_episode(path)
    check_same(episode, kept)
    assert any(len(frame.pose.contacts.force) for frame in kept.frames)  # the walls were touched
    assert isinstance(kept.scene, Duct)
    assert isinstance(episode.scene, Duct)
    np.testing.assert_array_equal(kept.scene.mesh.vertices, episode.scene.mesh.vertices)
    assert [target.node for target in kept.scene.targets] == [target.node for target in episode.scene.targets]
    assert [item.name for item in path.parent.iterdir()] == ["a.episode.npz"]  # nothing half-written
    assert find_episodes(tmp_path / "new") == (path,)


def test_an_episode_among_pegs_is_kept_whole(pegs: Session, tmp_path: Path) -> None:
    kept = read_episode(write_episode(pegs.episode(), tmp_path / "a.episode.npz"))
    check_same(pegs.episode(), kept)
    np.testing.assert_array_equal(kept.scene.pegs, pegs.scene.pegs)  # type: ignore[union-attr]


def test_files_that_are_no_episodes_are_refused(pegs: Session, tmp_path: Path) -> None:
    path = write_episode(pegs.episode(), tmp_path / "good.episode.npz")
    with pytest.raises(RunError, match="not overwritten"):
        write_episode(pegs.episode(), path)
    with pytest.raises(RunError, match=r"no episode .*Did you mean 'good.episode.npz'"):
        read_episode(tmp_path / "goot.episode.npz")
    for name, content in (("text", b"time,tip\n0,1\n"), ("cut", path.read_bytes()[:3000]), ("empty", b"")):
        broken = tmp_path / f"{name}.npz"
        broken.write_bytes(content)
        with pytest.raises(RunError, match="not an episode, or it is damaged") as raised:
            read_episode(broken)
        assert "pickle" not in str(raised.value)  # advice of numpy's that nobody should follow
    np.savez(tmp_path / "other.npz", numbers=np.arange(3))
    with pytest.raises(RunError, match="not an episode"):
        read_episode(tmp_path / "other.npz")


def test_a_mesh_that_is_missing_leaves_the_episode(driven: Session) -> None:
    count = len(driven.frames)
    with pytest.raises((GeometryError, ConfigError), match=r"no_such\.stl"):
        driven.reset(0, {"duct": "no_such.stl"})
    assert len(driven.frames) == count
    assert driven.options == PLACE
