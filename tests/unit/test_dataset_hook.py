"""Effects of the user's own: the documented example works, and what is incomplete is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evergym.discrepancy.data.columns import CHANNELS, COMMANDS
from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.hook import UserEffect, load_user_effects
from evergym.discrepancy.simulate import simulate_run
from evergym.errors import ConfigError
from evergym.model import load_model

MODEL = load_model("mammobot_2023")


@pytest.fixture(scope="module")
def effects(checkout: Path) -> dict[str, UserEffect]:
    return {effect.name: effect for effect in load_user_effects(checkout / "docs" / "examples" / "own_effects.py")}


def make_run() -> Run:
    time = np.arange(0.0, 4.01, 0.1)
    commands = np.zeros((len(time), len(COMMANDS)))
    commands[:, COMMANDS.index("tail_feed_mm_s")] = np.nan
    commands[:, COMMANDS.index("tendon_pull_mm")] = np.where(time < 0.95, 1.0, 3.0)
    return Run(
        "r",
        "catheter",
        (0.0, -9.81, 0.0),
        "e",
        "free",
        10.0,
        time,
        commands,
        np.full((len(time), len(CHANNELS)), np.nan),
    )


def test_the_example_holds_two_effects(effects: dict[str, UserEffect]) -> None:
    assert list(effects) == ["slow_tendon_drive", "tilted_camera"]


@pytest.mark.parametrize("name", ["slow_tendon_drive", "tilted_camera"])
def test_an_effect_that_is_off_changes_nothing(effects: dict[str, UserEffect], name: str) -> None:
    """But for the step: with hooks no rows are joined beyond it."""
    off = simulate_run(MODEL, make_run(), hooks=[effects[name].create_hook(effects[name].off)])
    np.testing.assert_allclose(off, simulate_run(MODEL, make_run()), atol=0.01)


def test_a_command_is_transformed_before_the_robot(effects: dict[str, UserEffect]) -> None:
    hook = effects["slow_tendon_drive"].create_hook({"time_s": 0.5})
    x = simulate_run(MODEL, make_run(), hooks=[hook])[:, 0]
    plain = simulate_run(MODEL, make_run())[:, 0]
    step = plain[-1] - plain[0]
    assert step > 30.0
    assert abs(x[-1] - plain[-1]) < 0.2  # six time constants later
    half = int(np.argmax(x > plain[0] + 0.5 * step))
    assert 1.2 < make_run().time_s[half] < 1.5  # half of the pull after 0.35 s, and the row before shows the rest
    again = simulate_run(MODEL, make_run(), hooks=[hook])[:, 0]
    np.testing.assert_array_equal(again, x)  # reset() forgets


def test_a_channel_is_transformed_after_the_robot(effects: dict[str, UserEffect]) -> None:
    plain = simulate_run(MODEL, make_run())
    seen = simulate_run(MODEL, make_run(), hooks=[effects["tilted_camera"].create_hook({"angle_deg": 90.0})])
    np.testing.assert_allclose(seen[:, 0], -plain[:, 2], atol=0.01)
    np.testing.assert_allclose(seen[:, 2], plain[:, 0], atol=0.01)


def test_hooks_act_in_order(effects: dict[str, UserEffect]) -> None:
    camera = effects["tilted_camera"]
    twice = [camera.create_hook({"angle_deg": 45.0}), camera.create_hook({"angle_deg": 45.0})]
    once = [camera.create_hook({"angle_deg": 90.0})]
    np.testing.assert_allclose(
        simulate_run(MODEL, make_run(), hooks=twice), simulate_run(MODEL, make_run(), hooks=once), atol=1e-9
    )


GOOD = """\
from evergym.config import ParameterInfo
from evergym.discrepancy.hook import PassiveHook, UserEffect
class Mine(PassiveHook):
    def __init__(self, a): self.a = a
EFFECTS = [UserEffect("mine", Mine, {"a": ParameterInfo(low=0.0, high=1.0)}, off={"a": 0.0}, typical={"a": 0.5})]
"""


def test_the_shortest_effect_loads(tmp_path: Path) -> None:
    (tmp_path / "e.py").write_text(GOOD)
    (effect,) = load_user_effects(tmp_path / "e.py")
    assert effect.name == "mine"


@pytest.mark.parametrize(
    ("old", "new", "fragment"),
    [
        ("EFFECTS = ", "OTHER = ", "defines no list EFFECTS"),
        ("EFFECTS = [UserEffect", "EFFECTS = []\n[UserEffect", "defines no list EFFECTS"),
        ("EFFECTS = [UserEffect", "EFFECTS = [dict()]\n[UserEffect", "EFFECTS holds a dict"),
        ('off={"a": 0.0}', "off={}", "parameter 'a' of the effect 'mine' needs a value 'off', .*: got None"),
        ('off={"a": 0.0}', 'off={"a": "x"}', "needs a value 'off', at least 0 and at most 1: got 'x'"),
        ('typical={"a": 0.5}', 'typical={"a": 0.0}', "does at its typical values what it does when off"),
        ('{"a": 0.5}', '{"a": 5.0}', "needs a value 'typical', at least 0 and at most 1: got 5"),
        ("high=1.0", "high=float('inf')", "needs finite limits: low below high"),
        ("ParameterInfo(low=0.0, high=1.0)", "0.5", "is a float, but must be a ParameterInfo"),
        ('UserEffect("mine"', 'UserEffect("my.effect"', "an effect is named 'my.effect'"),
        ("class Mine", "raise SystemExit(3)\nclass Mine", "fails when it is run: SystemExit"),
        ("high=1.0", "", "needs finite limits: low below high"),
        ('{"a": ParameterInfo(low=0.0, high=1.0)}', "{}", "has no parameters"),
        ("def __init__(self, a): self.a = a", "def __init__(self, b): self.a = b", "cannot be made with a: TypeError"),
        ("class Mine", "1 / 0\nclass Mine", "fails when it is run: ZeroDivisionError"),
        ("class Mine(", "class Mine", "fails when it is run: SyntaxError"),
    ],
)
def test_what_is_incomplete_is_named(tmp_path: Path, old: str, new: str, fragment: str) -> None:
    assert old in GOOD
    (tmp_path / "e.py").write_text(GOOD.replace(old, new))
    with pytest.raises(ConfigError, match=fragment):
        load_user_effects(tmp_path / "e.py")


def test_two_effects_of_one_name_are_refused(tmp_path: Path) -> None:
    (tmp_path / "e.py").write_text(GOOD + "EFFECTS = 2 * EFFECTS")
    with pytest.raises(ConfigError, match="two effects are named 'mine'"):
        load_user_effects(tmp_path / "e.py")


def test_an_effect_of_the_catalogues_name_is_refused(tmp_path: Path) -> None:
    (tmp_path / "e.py").write_text(GOOD.replace('"mine"', '"tendon_backlash"'))
    with pytest.raises(ConfigError, match="'tendon_backlash' is an effect of the catalogue"):
        load_user_effects(tmp_path / "e.py")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="does not exist"):
        load_user_effects(tmp_path / "e.py")
