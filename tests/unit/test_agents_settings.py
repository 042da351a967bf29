"""Settings, command line and suggestions."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import pytest
import tomli_w

from evergym.agents import cli
from evergym.agents.settings import (
    Algorithm,
    LearningRateSchedule,
    PpoSettings,
    TrainSettings,
    parse_options,
    read_settings,
    write_settings,
)
from evergym.agents.suggest import suggest
from evergym.errors import ConfigError, RunError


def test_settings_survive_the_file(tmp_path: Path) -> None:
    settings = TrainSettings(
        env_options=("control_step_s=0.5", "hide_map=true"),
        algorithm=Algorithm.TQC,
        learning_rate_schedule=LearningRateSchedule.LINEAR,
        learning_rate=1e-3,
        hidden=(8, 16),
        normalise_rewards=False,
        ppo=PpoSettings(clip_range=0.1),
        time_budget_min=2.0,
        folder=tmp_path / "x",
    )
    write_settings(settings, tmp_path / "settings.toml")
    assert read_settings(TrainSettings, tmp_path / "settings.toml") == settings
    assert [item.name for item in tmp_path.iterdir()] == ["settings.toml"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"totl_steps": 3}, r"unknown key 'totl_steps'. Did you mean 'total_steps'"),
        ({"ppo": {"clip_rang": 0.1}}, r"ppo: unknown key 'clip_rang'. Did you mean 'clip_range'"),
        ({"total_steps": "many"}, r"total_steps' must be of type int, not 'many'"),
        ({"total_steps": True}, r"total_steps' must be of type int, not True"),
        ({"algorithm": "pqo"}, r"algorithm' has the value 'pqo'"),
        ({"ppo": 3}, r"ppo' must be a table"),
    ],
)
def test_bad_settings_files_are_explained(tmp_path: Path, change: dict[str, object], message: str) -> None:
    path = tmp_path / "settings.toml"
    path.write_text(tomli_w.dumps(change))
    with pytest.raises(ConfigError, match=message):
        read_settings(TrainSettings, path)
    path.write_text("total_steps = = 3")
    with pytest.raises(ConfigError, match=r"is not a TOML file"):
        read_settings(TrainSettings, path)


@pytest.mark.parametrize(
    "change",
    [
        {"total_steps": 0},
        {"seed": -1},
        {"discount": 1.5},
        {"learning_rate": 0.0},
        {"learning_rate": float("nan")},
        {"env_count": 0},
        {"time_budget_min": -1.0},
        {"ppo": PpoSettings(epochs=0)},
    ],
)
def test_impossible_values_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match=r"must be"):
        dataclasses.replace(TrainSettings(), **change)  # type: ignore[arg-type]


def test_options_are_read_as_toml_values() -> None:
    options = parse_options(("step=0.5", "count=3", "flag=true", "model=robot_a", 'text="3"', "list=[1, 2]", "a-b=c=d"))
    assert options == {
        "step": 0.5,
        "count": 3,
        "flag": True,
        "model": "robot_a",
        "text": "3",
        "list": [1, 2],
        "a_b": "c=d",
    }
    for bad in (("step",), ("=3",), ("a b=3",), ("a=1", "a=2")):
        with pytest.raises(ConfigError):
            parse_options(bad)


def test_suggestions() -> None:
    assert suggest("Duty_cicle", ["duty_cycle", "random"]) == ". Did you mean 'duty_cycle'?"
    assert suggest("xyz", ["duty_cycle", "random"]) == "; known: duty_cycle, random."
    assert suggest("xyz", []) == "; no name is known there."


def test_help_lists_commands_and_is_light(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--help"]) == 0
    shown = capsys.readouterr().out
    for name in ("train", "evaluate", "report", "rollout", "soak"):
        assert f"  {name} " in shown
    code = "import sys; from evergym.agents.cli import main; main(['train', '--help'])"
    check = "; print([m for m in ('torch', 'numba', 'stable_baselines3', 'matplotlib', 'scipy') if m in sys.modules])"
    code = code.replace("main([", "\ntry:\n    main([") + "\nexcept SystemExit:\n    pass\n" + check[2:]
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "--total-steps" in result.stdout
    assert result.stdout.strip().endswith("[]")


def test_mistyped_commands_and_options(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["trian"]) == 2
    assert "Did you mean 'train'?" in capsys.readouterr().err
    with pytest.raises(SystemExit) as exit_info:
        cli.main(["train", "--total-stepps", "3"])
    assert exit_info.value.code == 2
    assert "--total-steps" in capsys.readouterr().err
    assert cli.main(["train", "--seed", "-1"]) == 1
    assert capsys.readouterr().err == "evergym: Training setting 'seed' is -1; it must be 0 or above.\n"


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (RunError("It is gone."), 1, "evergym: It is gone.\n"),
        (KeyboardInterrupt("Continue with: x"), 130, "\nInterrupted. Continue with: x\n"),
    ],
)
def test_errors_and_interrupts_become_exit_codes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], error: BaseException, code: int, message: str
) -> None:
    def fail(settings: TrainSettings) -> int:
        raise error

    monkeypatch.setattr(TrainSettings, "run", fail)
    assert cli.main(["train"]) == code
    assert capsys.readouterr().err == message


def test_commands_of_missing_modules_are_left_out(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(cli.COMMANDS, "fly", cli.CommandEntry("evergym.agents.wings", "Fly", "fly away"))
    assert cli.main([]) == 0
    assert "fly" not in capsys.readouterr().out
    assert cli.main(["fly"]) == 2


def test_every_command_has_its_dataclass() -> None:
    for name, entry in cli.COMMANDS.items():
        try:
            module = __import__(entry.module, fromlist=[entry.name])
        except ModuleNotFoundError as error:
            assert str(error.name).startswith("evergym."), name
            continue
        kind = getattr(module, entry.name)
        assert dataclasses.is_dataclass(kind)
        assert kind.__doc__
        assert callable(kind.run)
