"""How episodes start and end, what options select, and what a diverged step does."""

from __future__ import annotations

import dataclasses
from typing import Any

import gymnasium
import numpy as np
import pytest

from evergym.duct_models.duct import generate_duct
from evergym.duct_models.pegs import paper_pegs
from evergym.effects.burst_limit import BurstLimit
from evergym.envs.base import MammobotEnv
from evergym.envs.duct import MammobotDuctEnv
from evergym.envs.pegs import MammobotPegsEnv
from evergym.envs.route import LumenRoute
from evergym.errors import ConfigError, GeometryError, SimulationDiverged
from evergym.model import load_model, save_model
from evergym.units import MM

STAY = np.array([0.0, 0.0, -1.0, -1.0], dtype=np.float32)
PUSH = np.array([1.0, 0.0, -1.0, 1.0], dtype=np.float32)


def run(env: gymnasium.Env[Any, Any], action: Any, limit: int = 1000) -> tuple[bool, bool, dict[str, Any], float]:
    total = 0.0
    for _ in range(limit):
        _, reward, terminated, truncated, info = env.step(action)
        total += float(reward)
        if terminated or truncated:
            return terminated, truncated, info, total
    raise AssertionError("the episode did not end")


def test_time_truncates_exactly() -> None:
    """300 s in steps of 2.5 s are 120 steps; the 120th is truncated, not terminated."""
    env = MammobotPegsEnv(control_step_s=2.5)
    env.reset(seed=0)
    for step in range(1, 121):
        _, _, terminated, truncated, info = env.step(STAY)
        assert not terminated
        assert truncated == (step == 120)
    assert info["end_reason"] == "time"
    assert info["time_s"] == pytest.approx(300.0)
    assert not info["is_success"]


def test_reached_terminates_and_pays_once() -> None:
    """Pushing straight at a target on the axis reaches it, and the shaping telescopes over the episode."""
    field = paper_pegs(0)
    straight = type(field)(pegs=np.zeros((0, 7)), target=np.array([0.0, 0.0, 30.0]) * MM, name="free")
    env = MammobotPegsEnv()
    _, start = env.reset(seed=0, options={"pegs": straight})
    terminated, truncated, info, total = run(env, PUSH)
    assert (terminated, truncated) == (True, False)
    assert info["end_reason"] == "reached"
    assert info["is_success"] is True
    assert info["tip_error_mm"] <= 5.0
    assert info["reward/success"] == 5.0
    progress = 0.1 * (start["distance_to_go_mm"] - info["distance_to_go_mm"])
    assert total == pytest.approx(progress + 5.0 - 0.005 * info["time_s"], abs=1e-9)
    assert info["path_ratio"] == pytest.approx(1.0, abs=0.1)


def test_discounted_shaping_is_the_documented_potential() -> None:
    """With a discount, each step's term is gamma phi(s') - phi(s) with phi = -w d."""
    env = MammobotPegsEnv(reward={"discount": 0.9, "progress_per_mm": 0.2})
    _, before = env.reset(seed=0)
    *_, after = env.step(PUSH)
    expected = 0.9 * (-0.2 * after["distance_to_go_mm"]) + 0.2 * before["distance_to_go_mm"]
    assert after["reward/progress"] == pytest.approx(expected, rel=1e-9)


def test_neighbouring_branch_behind_a_wall_is_no_success() -> None:
    """A point of another branch that is near the target in space is far from it along the lumen."""
    for index in range(4):
        duct = generate_duct("deep", index)
        line = duct.centreline
        for target in duct.targets:
            # Branches side by side: neither on the way to the target nor the target's own end beyond it.
            away = [
                branch for branch in set(line.branch.tolist()) if branch not in line.branch[line.path_to(target.node)]
            ]
            others = np.flatnonzero(np.isin(line.branch, away))
            gap = np.linalg.norm(line.position[others] - target.position, axis=1)
            node = int(others[np.argmin(gap)])
            route = LumenRoute(line, target.node, line.position[0])
            for step in line.path_to(node):
                route.locate(line.position[step])
            assert route.location.branch == line.branch[node]
            assert route.tip_error > 2.0 * gap.min()
            assert route.tip_error > 15.0 * MM
            assert route.warning == 1.0


def test_along_the_lumen_within_5_mm_is_success_and_beyond_is_none() -> None:
    """The tip error of points of the way itself is their distance along it."""
    duct = generate_duct("train", 0)
    line, target = duct.centreline, duct.targets[0]
    route = LumenRoute(line, target.node, line.position[0])
    for node in line.path_to(target.node):
        route.locate(line.position[node])
        assert route.tip_error == pytest.approx(target.station - line.station[node], abs=1e-9)
        assert route.warning == 0.0


def test_burst_terminates(tmp_path: Any) -> None:
    """A sheath that bursts at 20 kPa ends the episode when the pressure passes it."""
    model = load_model("mammobot_2023")
    weak = dataclasses.replace(model, effects=dataclasses.replace(model.effects, burst_limit=BurstLimit(20.0)))
    save_model(weak, tmp_path / "weak.toml")
    env = MammobotPegsEnv(model=str(tmp_path / "weak.toml"))
    env.reset(seed=0)
    terminated, truncated, info, _ = run(env, np.array([0.0, 0.0, -1.0, 1.0]))
    assert (terminated, truncated) == (True, False)
    assert info["end_reason"] == "burst"
    assert info["cost_burst"] == 1.0
    assert info["reward/failure"] == -5.0
    assert 0.25 <= info["time_s"] <= 1.0  # the set point passes 20 kPa after 0.4 s, the pressure lags by some 0.15 s
    assert info["pressure_kpa"] == 0.0


def test_perforation_terminates() -> None:
    """Pushing on into the wall passes a small depth limit, and the info shows how deep it was."""
    env = MammobotDuctEnv(perforation_depth_mm=0.05, pool_size=1)
    env.reset(seed=0)
    terminated, _, info, _ = run(env, PUSH)
    assert terminated
    assert info["end_reason"] == "perforated"
    assert info["penetration_mm"] > 0.05
    assert info["wall_force_n"] >= info["wall_force_max_n"] > 0.0


def test_wall_force_costs_above_its_limit_only() -> None:
    """The cost is 1 exactly where the largest force is above the limit."""
    env = MammobotDuctEnv(wall_force_limit_n=0.02, pool_size=1)
    env.reset(seed=0)
    costs = set()
    for _ in range(200):
        _, _, terminated, truncated, info = env.step(PUSH)
        assert info["cost_wall_force"] == float(info["wall_force_max_n"] > 0.02)
        costs.add(info["cost_wall_force"])
        if terminated or truncated:
            break
    assert costs == {0.0, 1.0}


class _Faulty:
    """A simulator that diverges on parts longer than it can take."""

    def __init__(self, simulator: Any, longest: float) -> None:
        self._simulator = simulator
        self._longest = longest
        self.calls: list[float] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._simulator, name)

    def advance(self, command: Any, duration: float) -> Any:
        self.calls.append(duration)
        if duration > self._longest:
            raise SimulationDiverged("too long a step, on purpose")
        return self._simulator.advance(command, duration)


def test_diverged_step_is_retried_in_parts() -> None:
    """A step of 0.25 s that only works in quarters takes one half and four quarters, and loses no time."""
    env = MammobotPegsEnv()
    env.reset(seed=0)
    faulty = _Faulty(env._simulator, longest=0.07)
    env._simulator = faulty  # type: ignore[assignment]
    _, _, terminated, truncated, info = env.step(PUSH)
    assert (terminated, truncated) == (False, False)
    assert faulty.calls == pytest.approx([0.25, 0.125, 0.0625, 0.0625, 0.0625, 0.0625])
    assert info["time_s"] == pytest.approx(0.25)


def test_hopeless_divergence_truncates_with_a_finite_observation() -> None:
    """If even an eighth fails, the episode ends as diverged; the observation is the last good state's."""
    env = MammobotPegsEnv()
    env.reset(seed=0)
    env._simulator = _Faulty(env._simulator, longest=0.0)  # type: ignore[assignment]
    observation, reward, terminated, truncated, info = env.step(PUSH)
    assert (terminated, truncated) == (False, True)
    assert info["end_reason"] == "diverged"
    assert np.isfinite(observation).all()
    assert np.isfinite(reward)
    observation, _ = env.reset(seed=1)
    assert observation in env.observation_space


def test_options_select_place_target_and_start() -> None:
    """What is asked for is what info and observation show."""
    env = MammobotDuctEnv()
    _, info = env.reset(seed=0, options={"family": "held_out", "index": 3, "target": 1, "everted_length_mm": 8.0})
    assert (info["anatomy_family"], info["anatomy_index"], info["target_index"]) == ("held_out", 3, 1)
    assert info["everted_length_mm"] == pytest.approx(8.0)
    duct = generate_duct("train", 1)
    _, info = env.reset(seed=0, options={"duct": duct, "target": 0})
    assert info["anatomy"] == duct.name
    pegs = MammobotPegsEnv()
    _, info = pegs.reset(seed=0, options={"family": "paper", "index": 2})
    assert (info["anatomy_family"], info["anatomy_index"]) == ("paper", 2)


def test_a_long_start_lies_in_the_branch_of_the_target() -> None:
    """The robot is laid along the way, so what it looks at ahead is the target and not a wall."""
    env = MammobotDuctEnv()
    for target in range(2):
        _, info = env.reset(seed=0, options={"index": 1, "target": target, "everted_length_mm": 45.0})
        assert info["everted_length_mm"] == pytest.approx(45.0)
        assert info["distance_to_go_mm"] < 10.0  # some 72 mm in the neighbouring branch


def test_mesh_file_is_a_duct(tmp_path: Any) -> None:
    """A path in the options is read as a mesh in millimetres."""
    import trimesh

    tube = trimesh.creation.capsule(height=60.0, radius=5.0)
    tube.export(tmp_path / "tube.stl")
    env = MammobotDuctEnv()
    _, info = env.reset(seed=0, options={"duct": str(tmp_path / "tube.stl")})
    assert info["anatomy"] == "tube"
    assert 20.0 < info["distance_to_go_mm"] < 70.0
    env.step(PUSH)


@pytest.mark.parametrize(
    ("env_class", "options", "message"),
    [
        (MammobotDuctEnv, {"idnex": 3}, "Did you mean 'index'"),
        (MammobotDuctEnv, {"family": "trian"}, "Did you mean 'train'"),
        (MammobotDuctEnv, {"index": -1}, "at least 0"),
        (MammobotDuctEnv, {"index": 0, "target": 99}, "targets 0.."),
        (MammobotDuctEnv, {"duct": 3}, "must be a Duct"),
        (MammobotDuctEnv, {"duct": "x.stl", "index": 0}, "both 'duct' and 'index'"),
        (MammobotDuctEnv, {"everted_length_mm": "long"}, "positive number"),
        (MammobotDuctEnv, {"everted_length_mm": 500.0}, "everted length"),
        (MammobotPegsEnv, {"pegs": "paper"}, "must be a PegField"),
        (MammobotPegsEnv, {"target": 0}, "Unknown key 'target'"),
    ],
)
def test_wrong_options_say_what_to_do(env_class: type[MammobotEnv], options: dict[str, Any], message: str) -> None:
    """Nothing is ignored silently."""
    env: Any = env_class(pool_size=1)  # type: ignore[call-arg]
    with pytest.raises(ConfigError, match=message):
        env.reset(seed=0, options=options)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"control_step": 0.1}, "Did you mean 'control_step_s'"),
        ({"control_step_s": 0.0}, "above 0 s"),
        ({"control_step_s": float("nan")}, "finite"),
        ({"time_limit_s": 299.0}, "at least 300 s"),
        ({"localisation_noise_mm": -1.0}, "at least 0 mm"),
        ({"family": "heldout"}, "Did you mean 'held_out'"),
        ({"pool_size": 0}, "at least 1"),
        ({"model": "mammobot_2024"}, "mammobot_2023"),
        ({"reward": {"succes": 1.0}}, "Did you mean 'success'"),
        ({"reward": {"discount": 1.5}}, "0..1"),
        ({"render_mode": "human"}, "render_mode"),
    ],
)
def test_wrong_arguments_say_what_to_do(arguments: dict[str, Any], message: str) -> None:
    """Constructor arguments are checked when the environment is made, not when it is used."""
    with pytest.raises(ConfigError, match=message):
        MammobotDuctEnv(**arguments)


@pytest.mark.parametrize(("env_class", "where"), [(MammobotDuctEnv, "at station"), (MammobotPegsEnv, "has room")])
def test_a_robot_that_does_not_fit_is_refused(env_class: Any, where: str, tmp_path: Any) -> None:
    """A sheath of 6 mm has no way through a lumen of some 5 mm, nor between the pegs."""
    model = load_model("mammobot_2023")
    thick = dataclasses.replace(model, robot=dataclasses.replace(model.robot, sheath_outer_diameter_mm=6.0))
    save_model(thick, tmp_path / "thick.toml")
    with pytest.raises(GeometryError, match=where):
        env_class(model=str(tmp_path / "thick.toml"), pool_size=1).reset(seed=0)


def test_step_before_reset_is_an_error() -> None:
    """Also without gymnasium's order-enforcing wrapper."""
    with pytest.raises(gymnasium.error.ResetNeeded):
        MammobotPegsEnv().step(STAY)
