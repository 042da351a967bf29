"""``evergym dataset check | show | export-paper``, as a user runs them."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from evergym.agents.cli import main


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "paper"
    assert main(["dataset", "export-paper", str(folder)]) == 0
    return folder


def test_check_says_what_is_there(paper: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dataset", "check", str(paper)]) == 0
    text = capsys.readouterr().out
    assert "'mammobot-2023', 32 runs in 9 experiments, 1020.5 s of robot time" in text
    assert "tip_angle_deg" in text
    assert "rows set aside: 0" in text
    assert "fig8-v2-150" in text


def test_check_counts_impossible_rows(paper: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for path in paper.iterdir():
        (tmp_path / path.name).write_text(path.read_text().replace(",102.0,,", ",300.0,,"))
    assert main(["dataset", "check", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert "rows set aside: 1" in text
    assert "everted length of 300.0 mm, but the sheath everts 140.0 mm at most" in text


def test_bad_data_ends_with_a_message_and_writes_nothing(
    paper: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in paper.iterdir():
        (tmp_path / path.name).write_text(path.read_text().replace("tip_angle_deg", "tip_angle", 1))
    for words in (["check"], ["show", "--out", str(tmp_path / "p.png")]):
        assert main(["dataset", *words, str(tmp_path)]) == 1
        error = capsys.readouterr().err
        assert error.startswith("evergym: ")
        assert "'tip_angle'" in error
    assert sorted(path.name for path in tmp_path.iterdir()) == ["dataset.toml", "samples.csv"]


def test_show_draws_runs_and_a_models_prediction(
    paper: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sizes = []
    for name, words in (
        ("two.png", ["--runs", "fig7-1", "fig9"]),
        ("model.png", ["--runs", "fig7-1", "fig9", "--model", "mammobot_2023"]),
        ("more.png", ["--runs", "fig7-1", "fig7-2", "fig7-3", "fig9", "fig10", "fig6-90deg"]),
    ):
        out = tmp_path / name
        assert main(["dataset", "show", str(paper), "--out", str(out), *words]) == 0
        assert capsys.readouterr().out == f"{out}\n"
        with Image.open(out) as picture:
            sizes.append(picture.size)
    assert sizes[0] == sizes[1]
    assert sizes[2][1] > 2 * sizes[0][1]  # 6 runs instead of 2
    with Image.open(tmp_path / "two.png") as one, Image.open(tmp_path / "model.png") as other:
        assert one.tobytes() != other.tobytes()


@pytest.mark.parametrize(
    ("words", "fragment"),
    [
        (["show", "PAPER", "--out", "p.pdf"], "must be a .png file"),
        (["show", "PAPER", "--out", "nowhere/p.png"], "no folder 'nowhere'"),
        (["show", "PAPER", "--out", "p.png", "--runs", "fig7-9"], "no run 'fig7-9' in"),
        (["show", "nowhere", "--out", "p.png"], "There is no folder 'nowhere'"),
        (["check", "PAPER", "--model", "mammobot"], "Unknown model 'mammobot'"),
        (["export-paper", "PAPER"], "is there already"),
        (["export-paper", "new", "--figures", "fig5"], "no figure 'fig5'"),
    ],
)
def test_options_that_cannot_be_used_are_named(
    paper: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    fragment: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["dataset", *(str(paper) if word == "PAPER" else word for word in words)]) == 1
    assert fragment in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_show_does_not_overwrite(paper: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "p.png"
    out.write_bytes(b"mine")
    assert main(["dataset", "show", str(paper), "--out", str(out), "--runs", "fig9"]) == 1
    assert "is there already" in capsys.readouterr().err
    assert out.read_bytes() == b"mine"


def test_check_remarks_a_table_with_its_own_readings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Pull and reading in one row, five seconds apart: what the catheter of Fig. 7 gave."""
    pulls, angles = (0.7, 1.2, 1.8, 2.2, 1.5, 0.9), (20, 32, 49, 57, 40, 27)
    rows = [f"r1,{5 * i},{pull},{angle}" for i, (pull, angle) in enumerate(zip(pulls, angles, strict=True))]
    (tmp_path / "samples.csv").write_text("\n".join(["run,time_s,tendon_pull_mm,tip_angle_deg", *rows]))
    (tmp_path / "dataset.toml").write_text(
        'schema = 1\n[noise]\ntip_angle_deg = 0.5\n[[run]]\nid = "r1"\nsetup = "catheter"\n'
    )
    assert main(["dataset", "check", str(tmp_path)]) == 0
    assert "run 'r1': a row's measurements belong to its own commands" in capsys.readouterr().out
