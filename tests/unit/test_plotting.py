"""The figures: what is measured for them, what is in them, and errors before any work is done."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from evergym.agents.arms import Arm
from evergym.agents.cli import main
from evergym.agents.episodes import EpisodeRecord, append_records
from evergym.agents.evaluation import Evaluation
from evergym.agents.learning_curve import CurvePoint, CurveWriter
from evergym.agents.plotting.comparison import draw_comparison
from evergym.agents.plotting.force import draw_force, locate_contacts, measure_force
from evergym.agents.plotting.growth import draw_growth, measure_growth
from evergym.agents.plotting.learning import draw_learning, read_learning
from evergym.agents.plotting.workspace import draw_workspace, measure_workspace
from evergym.agents.run_folder import RunFolder
from evergym.agents.settings import TrainSettings, write_settings
from evergym.envs.rendering.pose import Pose
from evergym.errors import RunError
from evergym.simulator import Contacts, Shape
from evergym.units import KPA, MM

HEAD = {"png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}


def test_workspace(tmp_path: Path) -> None:
    """Pulling bends, letting go lags behind, and the figure names lengths, pressures and units."""
    curves = measure_workspace("mammobot_2023", (30.0, 60.0), (10.0, 50.0), 5)
    assert [(curve.everted_length, curve.pressure) for curve in curves] == [
        (length * MM, pressure * KPA) for length in (30.0, 60.0) for pressure in (10.0, 50.0)
    ]
    for curve in curves:
        assert curve.tip.shape == (9, 2)
        assert curve.pull[4] == curve.pull.max()
        pulled, let_go = curve.angle[:5], curve.angle[4:][::-1]
        tolerance = 1e-6  # rad: the equilibria are found to some 1e-8
        assert (np.diff(pulled) >= -tolerance).all()
        assert (let_go >= pulled - tolerance).all()
        # Nothing of the robot is longer than what is everted, and it does not shrink.
        assert np.linalg.norm(curve.tip, axis=1).max() <= curve.everted_length * 1.02
    by_angle = {(curve.everted_length, curve.pressure): curve.angle[4] for curve in curves}
    assert by_angle[60 * MM, 10 * KPA] > by_angle[30 * MM, 10 * KPA]  # a longer robot bends further
    assert by_angle[60 * MM, 10 * KPA] > by_angle[60 * MM, 50 * KPA]  # pressure stiffens
    text = draw_workspace(curves, tmp_path / "workspace.svg").read_text()
    for word in ("30 mm", "60 mm", "10 kPa", "50 kPa", "let go", "tendon pull [mm]", "tip angle [°]"):
        assert f">{word}<" in text


def test_growth(tmp_path: Path) -> None:
    """Below its yield pressure nothing grows; above, faster with pressure, and never faster than the feed."""
    curves = measure_growth("mammobot_2023", (5.0, 30.0, 50.0), 2.0, 4.0)
    for curve in curves:
        np.testing.assert_allclose(np.sum(curve.growth_rate * np.diff(curve.time)), np.ptp(curve.everted_length))
        assert curve.growth_rate.max() <= curve.fed_rate * 1.0001
    still, slow, fast = (curve.everted_length[-1] - curve.everted_length[0] for curve in curves)
    assert still == 0.0
    assert 0.0 < slow < fast
    text = draw_growth(curves, tmp_path / "growth.svg").read_text()
    for word in ("5 kPa", "30 kPa", "everted length [mm]", "growth rate [mm/s]", "time [s]"):
        assert f">{word}<" in text


def test_contacts_are_located_along_the_robot() -> None:
    """A contact is as far along as its node, in whatever order contacts come."""
    position = np.column_stack([np.zeros(4), np.zeros(4), np.arange(4) * 2 * MM])
    shape = Shape(position, position, np.arange(4) * 2 * MM, np.ones(4, dtype=bool), position)
    force = np.array([[0.0, 0.3, 0.4], [0.0, 0.0, -1.0]])
    station, size = locate_contacts(Pose(shape, Contacts(position[[3, 1]], force), 1.5 * MM, 1.0 * MM))
    np.testing.assert_array_equal(station, [6 * MM, 2 * MM])
    np.testing.assert_allclose(size, [0.5, 1.0])
    empty = locate_contacts(Pose(shape, Contacts(np.zeros((0, 3)), np.zeros((0, 3))), 1.5 * MM, 1.0 * MM))
    assert [len(part) for part in empty] == [0, 0]


def test_force_over_an_episode(tmp_path: Path) -> None:
    """The largest entry of a row is the largest force on one section that the environment reported."""
    episode = measure_force("push_only", None, None, "held_out", 0, 3)
    assert episode.section_max.max() > 0.05
    np.testing.assert_allclose(episode.force.max(axis=1), episode.section_max, rtol=1e-9, atol=1e-12)
    assert len(episode.time) == episode.record.step_count + 1
    text = draw_force(episode, tmp_path / "force.svg").read_text()
    for word in ("time [s]", "force on a section [N]", "(square root scale)", "everted length", "catheter"):
        assert f">{word}<" in text


@pytest.mark.parametrize("kind", HEAD)
def test_an_episode_without_contact_has_a_figure(tmp_path: Path, kind: str) -> None:
    """In every format, whole, with nothing left beside it."""
    episode = measure_force("duty_cycle", "MammobotPegs-v0", ("family=paper",), "paper", 2, 0)
    quiet = episode._replace(force=0.0 * episode.force, section_max=0.0 * episode.section_max)
    path = draw_force(quiet, tmp_path / "a" / f"force.{kind}")
    assert path.read_bytes().startswith(HEAD[kind])
    assert list(path.parent.iterdir()) == [path]


def make_run(folder: Path, seed: int, points: list[CurvePoint], **changes: object) -> Path:
    settings = dataclasses.replace(TrainSettings(), seed=seed, folder=folder, **changes)  # type: ignore[arg-type]
    run = RunFolder.create(folder, settings)
    CurveWriter(run.curve, 0)
    with run.curve.open("a", encoding="utf-8") as file:
        file.writelines(",".join(map(str, dataclasses.astuple(point))) + "\n" for point in points)
    return folder


def test_learning(tmp_path: Path) -> None:
    """Seeds of one method are one curve with its range; another method is another curve."""
    points = [CurvePoint(step, 1.0, 3, 0.1 * step, 50.0, 0.5) for step in (1000, 2000, 3000)]
    runs = [make_run(tmp_path / f"a-seed{seed}", seed, points) for seed in (1, 2)]
    runs.append(make_run(tmp_path / "b", 1, points[:1], total_steps=77))
    groups = read_learning(runs)
    assert [(group.label, len(group.curves)) for group in groups] == [("a, 2 seeds", 2), ("b", 1)]
    assert groups[0].curves[0] == tuple(points)
    text = draw_learning(groups, tmp_path / "learning.svg").read_text()
    for word in ("a, 2 seeds (mean and range)", "b", "environment steps", "targets reached [%]"):
        assert f">{word}<" in text
    again = draw_learning(groups, tmp_path / "again.svg").read_text()
    assert again == text  # no date, no random names
    with pytest.raises(RunError, match="no point of a learning curve yet"):
        read_learning([make_run(tmp_path / "c", 1, [])])


def test_compare(tmp_path: Path) -> None:
    """Every arm and split is named, with the number of episodes."""
    arms = (Arm("duty_cycle", "x:Y"), Arm("push_only", "x:Z"))
    write_settings(
        Evaluation("evergym:MammobotDuct-v0", (), 1, "duty_cycle", "code", arms), tmp_path / "evaluation.toml"
    )
    records = [
        EpisodeRecord(arm.name, split, index, 0, arm.name == "duty_cycle", 20.0 + index, 3.0, 1.1, 0.1, 0.05, 5.0)
        for arm in arms
        for split in ("held_out", "narrow")
        for index in range(4)
    ]
    append_records(tmp_path / "episodes.csv", records)
    text = draw_comparison(tmp_path, tmp_path / "compare.svg").read_text()
    for word in ("duty cycle", "push only", "held out", "narrow", "time to target [s]", "peak wall force [N]"):
        assert f">{word}<" in text
    assert "4 episodes" in text
    assert text.count(">4<") >= 2  # how many reached their target, beside the times of those that did


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["workspace", "--out", "a.jpg"], "'a.jpg' has no ending that names a format: use .png, .pdf, .svg"),
        (["growth", "--out", "there.png"], "exists already"),
        (["growth", "--pressures-kpa", "-1"], "A pressure is -1.0 kPa; it must be between 0 and 1000 kPa"),
        (["workspace", "--pressures-kpa", "10", "10"], "A pressure is given twice: 10, 10 kPa"),
        (["growth", "--duration-s", "0"], "duration_s is 0.0 s"),
        (["learning", "missing"], "Run folder 'missing' does not exist"),
        (["compare", "missing"], "'missing' is not an evaluation folder"),
        (["force", "duty_cicle"], "There is no controller 'duty_cicle'"),
    ],
)
def test_mistakes_are_one_line(
    words: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Said before any work, without a traceback."""
    monkeypatch.chdir(tmp_path)
    Path("there.png").touch()
    assert main(["plot", *words]) == 2
    error = capsys.readouterr().err
    assert error.startswith("evergym plot: ")
    assert message in error
    assert len(error.strip().splitlines()) == 1
