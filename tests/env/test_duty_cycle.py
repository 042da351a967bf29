"""The duty cycle reaches targets, backs out of wrong branches, spares the wall, and keeps SB3's interface."""

from __future__ import annotations

import pickle
from importlib import resources
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from evergym.agents.duty_cycle import (
    CERTAIN,
    DutyCycleController,
    DutyCycleSettings,
    Memory,
    Phase,
    load_tuned_settings,
)
from evergym.agents.observer import Observer, Seen
from evergym.agents.reference import PushOnlyPolicy
from evergym.envs.observation import inverse_scales, term_slices
from evergym.errors import ConfigError
from evergym.units import KPA, MM

KNOWN = DutyCycleSettings()  # the tests of single decisions do not depend on the tuned values


def drive(env: gymnasium.Env[Any, Any], policy: Any, observation: Any, info: dict[str, Any]) -> dict[str, Any]:
    """Drive to the end of the episode; returns the last info, with the largest attempts counter as "attempts"."""
    state: Any = None
    ended = False
    while not ended:
        action, state = policy.predict(observation, state)
        observation, _, terminated, truncated, info = env.step(action)
        ended = terminated or truncated
    if isinstance(policy, DutyCycleController):
        info["attempts"] = state[0].attempts
    return info


def count_successes(env: gymnasium.Env[Any, Any], policy: Any, count: int) -> int:
    """Drive in the first ``count`` anatomies of the family."""
    ends = [drive(env, policy, *env.reset(seed=index, options={"index": index})) for index in range(count)]
    return sum(end["is_success"] for end in ends)


@pytest.mark.slow
def test_reaches_ducts_where_pushing_does_not() -> None:
    env = gymnasium.make("MammobotDuct-v0", family="train")
    reached = count_successes(env, DutyCycleController(env), 6)
    assert reached >= 5
    assert count_successes(env, PushOnlyPolicy(env), 6) < reached


@pytest.mark.slow
def test_reaches_targets_among_pegs_where_pushing_does_not() -> None:
    env = gymnasium.make("MammobotPegs-v0", family="train")
    reached = count_successes(env, DutyCycleController(env), 6)
    assert reached >= 5
    assert count_successes(env, PushOnlyPolicy(env), 6) < reached


def test_reaches_a_narrow_duct_with_the_robot_of_2021() -> None:
    env = gymnasium.make("MammobotDuct-v0", family="true_scale_train", model="mammobot_2021")
    assert count_successes(env, DutyCycleController(env), 2) == 2


def test_backs_out_of_a_wrong_branch() -> None:
    """At the end of one branch it is asked for the target of another one."""
    env = gymnasium.make("MammobotDuct-v0", family="train")
    controller = DutyCycleController(env)
    env.reset(seed=1, options={"index": 1, "target": 0})
    task: Any = env.unwrapped
    other = len(task.duct.targets) - 1
    branches = [task.duct.centreline.branch[task.duct.targets[target].node] for target in (0, other)]
    assert branches[0] != branches[1]
    assert drive(env, controller, *env.reset(seed=1, options={"index": 1, "target": 0}))["is_success"]
    everted = task._reading.everted_length
    task.target_index = other
    task._route = task._seen_route = task._make_route(task._reading.tip_position)
    task._step_count, task._end_reason = 0, ""
    end = drive(env, controller, task._observe(), {})
    assert everted > 25.0 * MM
    assert end["is_success"]
    assert end["attempts"] >= 1


def test_presses_no_wall_in_when_it_cannot_see_the_way() -> None:
    """Without a map it goes straight on: into a wall, from which it withdraws, instead of through it."""
    env = gymnasium.make("MammobotDuct-v0", family="train", hide_map=True)
    options = {"index": 0, "target": 0}
    assert drive(env, PushOnlyPolicy(env), *env.reset(seed=0, options=options))["end_reason"] == "perforated"
    assert drive(env, DutyCycleController(env), *env.reset(seed=0, options=options))["end_reason"] == "time"


# Stable-Baselines3's interface


def test_a_batch_gets_the_actions_of_its_rows() -> None:
    env = gymnasium.make("MammobotDuct-v0")
    controller = DutyCycleController(env)
    first, _ = env.reset(seed=1, options={"index": 0})
    states: list[Any] = [None, None]
    together: Any = None
    second = env.step(np.array([1.0, 0.3, 0.5, 1.0], np.float32))[0]
    for _ in range(12):
        rows = np.stack([first, second])
        actions, together = controller.predict(rows, together)
        assert actions.shape == (2, 4)
        assert actions.dtype == np.float32
        for index in range(2):
            action, states[index] = controller.predict(rows[index], states[index])
            assert action.tolist() == actions[index].tolist()
        second = env.step(actions[1])[0]


def test_goal_environments_are_driven_alike() -> None:
    plain = gymnasium.make("MammobotDuct-v0")
    goal = gymnasium.make("MammobotDuctGoal-v0")
    controllers = DutyCycleController(plain), DutyCycleController(goal)
    observation = plain.reset(seed=4, options={"index": 1})[0]
    with_goals = goal.reset(seed=4, options={"index": 1})[0]
    state = state_with_goals = None
    for _ in range(10):
        action, state = controllers[0].predict(observation, state)
        action_with_goals, state_with_goals = controllers[1].predict(with_goals, state_with_goals)
        assert action.tolist() == action_with_goals.tolist()
        batch = {key: value[None] for key, value in with_goals.items()}
        assert controllers[1].predict(batch, state_with_goals)[0].shape == (1, 4)
        observation, with_goals = plain.step(action)[0], goal.step(action)[0]
    assert DutyCycleController(gymnasium.make("MammobotPegsGoal-v0")).observer.task == "pegs"


def test_the_state_is_a_value() -> None:
    """It survives pickling, and predicting changes nothing in it."""
    env = gymnasium.make("MammobotDuct-v0")
    controller = DutyCycleController(env)
    observation, _ = env.reset(seed=2, options={"index": 0})
    state: Any = None
    for _ in range(8):
        action, state = controller.predict(observation, state)
        observation = env.step(action)[0]
    kept = pickle.loads(pickle.dumps(state))
    assert kept == state
    action, _ = controller.predict(observation, state)
    assert kept == state
    again, _ = DutyCycleController(env).predict(observation, kept)
    assert again.tolist() == action.tolist()


def test_a_new_episode_forgets_only_its_own_past() -> None:
    env = gymnasium.make("MammobotDuct-v0")
    controller = DutyCycleController(env, KNOWN)
    rows = np.stack([env.reset(seed=2, options={"index": 0})[0]] * 2)
    past = (Memory(Phase.GROW, time=0.5, attempts=2), Memory(Phase.GROW, time=0.5, attempts=2))
    _, state = controller.predict(rows, past, episode_start=np.array([True, False]))
    assert [memory.attempts for memory in state] == [0, 2]


@pytest.mark.slow
def test_evaluate_policy_takes_it_unchanged() -> None:
    envs = DummyVecEnv([lambda: Monitor(gymnasium.make("MammobotDuct-v0", pool_size=1)) for _ in range(2)])
    envs.seed(0)
    controller: Any = DutyCycleController(gymnasium.make("MammobotDuct-v0"))
    rewards: Any
    lengths: Any
    rewards, lengths = evaluate_policy(controller, envs, n_eval_episodes=2, return_episode_rewards=True)
    assert min(rewards) > 5.0  # the reward for success; way and time add less
    assert max(lengths) < 1200


def test_other_environments_are_refused() -> None:
    with pytest.raises(ConfigError, match="not CartPoleEnv"):
        DutyCycleController(gymnasium.make("CartPole-v1"))


# Single decisions, from made-up observations


class Scene:
    """Observations of a duct environment with some terms set, in SI units."""

    def __init__(self) -> None:
        env = gymnasium.make("MammobotDuct-v0")
        self.controller = DutyCycleController(env, KNOWN)
        task: Any = env.unwrapped
        self.places, self.factors = term_slices(task.terms), inverse_scales(task.terms, hide_map=False)
        self.size = len(self.factors)
        self.control_step: float = task.settings.control_step_s

    def observe(self, *, length: float = 30.0 * MM, everted: float = 30.0 * MM, **terms: Any) -> NDArray[np.float32]:
        straight = [[0.0, 0.0, distance * MM] for distance in (3, 6, 10, 15, 20)]
        values = {
            "everted_length": everted,
            "protrusion": length - everted,
            "roll": [0.0, 1.0],
            "pressure": 5.0 * KPA,
            "way_ahead": straight,
            "distance_to_go": 40.0 * MM,
            **terms,
        }
        row = np.zeros(self.size)
        for name, value in values.items():
            row[self.places[name]] = np.ravel(value)
        return (row * self.factors).astype(np.float32)

    def read(self, **terms: Any) -> Seen:
        return self.controller.observer.read(self.observe(**terms).astype(np.float64))

    def decide(self, memory: Memory, **terms: Any) -> tuple[NDArray[np.float32], Memory]:
        action, state = self.controller.predict(self.observe(**terms), (memory,))
        return action, state[0]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene()


def test_goes_round_the_cycle(scene: Scene) -> None:
    action, memory = scene.decide(Memory(), pressure=40.0 * KPA)
    assert memory.phase is Phase.STEER  # the pressure has to drop first
    assert action[0] == 0.0
    action, memory = scene.decide(memory)
    assert memory.phase is Phase.ADVANCE
    assert memory.goal == pytest.approx((30.0 + KNOWN.step_mm) * MM, rel=1e-6)  # float32 observations
    assert action[0] > 0.0
    assert action[3] == pytest.approx(2.0 * KNOWN.pressure_low_kpa / 50.0 - 1.0)
    action, memory = scene.decide(memory, length=35.1 * MM)
    assert memory.phase is Phase.GROW
    assert action[0] == 0.0
    assert action[3] == pytest.approx(2.0 * KNOWN.pressure_high_kpa / 50.0 - 1.0)
    _, memory = scene.decide(memory, length=35.1 * MM, everted=35.0 * MM, growth_rate=1.0 * MM)
    assert memory.phase is Phase.STEER


def test_a_stalled_sheath_is_not_left_behind(scene: Scene) -> None:
    """Growth that has stopped ends the phase; the catheter then keeps short of the drive's interlock."""
    growing = Memory(Phase.GROW, time=2.0)
    assert scene.decide(growing, length=34.0 * MM, growth_rate=0.5 * MM)[1].phase is Phase.GROW
    _, memory = scene.decide(growing, length=34.0 * MM, growth_rate=0.01 * MM)
    assert memory.phase is Phase.STEER
    _, memory = scene.decide(memory, length=38.5 * MM)
    assert memory.phase is Phase.ADVANCE
    assert memory.goal < 30.0 * MM + scene.controller.observer.limits.protrusion


def test_the_last_step_ends_at_the_target(scene: Scene) -> None:
    _, memory = scene.decide(Memory(), distance_to_go=2.0 * MM)
    assert memory.phase is Phase.ADVANCE
    assert memory.goal == pytest.approx(32.0 * MM, rel=1e-6)


@pytest.mark.parametrize("phase", [Phase.ADVANCE, Phase.GROW])
def test_withdraws_from_a_force_on_the_tip(scene: Scene, phase: Phase) -> None:
    memory = Memory(phase, goal=33.0 * MM)
    light, hard = 0.5 * KNOWN.force_limit_n, 1.5 * KNOWN.force_limit_n
    assert scene.decide(memory, length=32.0 * MM, growth_rate=1e-3, tip_force=[0, 0, -light])[1].phase is phase
    assert scene.decide(memory, length=32.0 * MM, growth_rate=1e-3, tip_force=[0, 0, hard])[1].phase is phase
    action, memory = scene.decide(memory, length=32.0 * MM, tip_force=[0, 0, -hard])
    assert memory.phase is Phase.WITHDRAW
    assert memory.goal == pytest.approx((32.0 - KNOWN.relief_mm) * MM, rel=1e-6)
    assert memory.attempts == 0  # not lost, only pressed
    assert action[0] < 0.0
    assert scene.decide(memory, length=memory.goal - 1e-6)[1].phase is Phase.STEER


def make_wrong_way(depth: float) -> list[list[float]]:
    """Points of a way that leads back by ``depth`` [m] before it goes ahead."""
    return [[0.0, 0.0, abs(distance * MM - depth) - depth] for distance in (3, 6, 10, 15, 20)]


def test_measures_how_far_it_is_astray(scene: Scene) -> None:
    for depth in (1.0 * MM, 4.0 * MM, 8.0 * MM):
        seen = scene.read(astray=1.0, way_ahead=make_wrong_way(depth))
        assert seen.astray == pytest.approx(depth, abs=1e-6)
        assert not seen.is_past
    assert scene.read(way_ahead=make_wrong_way(4.0 * MM)).astray == 0.0


def test_backs_out_when_it_is_sure_to_be_astray(scene: Scene) -> None:
    deep = {"astray": 1.0, "way_ahead": make_wrong_way((KNOWN.astray_mm + 1.0) * MM)}
    mouth = {"astray": 1.0, "way_ahead": make_wrong_way(0.5 * KNOWN.astray_mm * MM)}
    memory = Memory(Phase.ADVANCE, goal=40.0 * MM)
    _, memory = scene.decide(memory, **deep)
    assert memory.phase is Phase.ADVANCE  # one observation may be noise
    _, memory = scene.decide(memory, **mouth)
    assert memory.doubt == 0.0
    for _ in range(round(CERTAIN / scene.control_step)):
        action, memory = scene.decide(memory, **deep)
    assert memory.phase is Phase.WITHDRAW
    assert memory.attempts == 1
    assert action[0] < 0.0
    # As long as the way leads back, the margin is counted from where it is.
    _, memory = scene.decide(memory, length=26.0 * MM, everted=26.0 * MM, **mouth)
    assert memory.goal == pytest.approx((26.0 - KNOWN.back_out_mm) * MM, rel=1e-5)
    assert scene.decide(memory, length=24.0 * MM, everted=24.0 * MM)[1].phase is Phase.WITHDRAW
    assert scene.decide(memory, length=19.9 * MM, everted=19.9 * MM)[1].phase is Phase.STEER


def test_backs_out_farther_at_every_attempt(scene: Scene) -> None:
    past = {"way_ahead": [[0.0, 0.0, -1.0 * MM]] * 5, "distance_to_go": 1.0 * MM}
    margins = []
    for attempts in range(KNOWN.retries + 2):
        memory = Memory(Phase.ADVANCE, doubt=CERTAIN, goal=40.0 * MM, attempts=attempts)
        _, memory = scene.decide(memory, **past)
        assert memory.attempts == attempts + 1
        margins.append((30.0 * MM - memory.goal) / MM)
    grown = [KNOWN.back_out_mm * factor for factor in range(1, KNOWN.retries + 2)]
    assert margins == pytest.approx([*grown, KNOWN.back_out_mm], rel=1e-5)


def test_pulls_neither_under_pressure_nor_a_buckled_sheath(scene: Scene) -> None:
    memory = Memory(Phase.WITHDRAW, goal=20.0 * MM)
    assert scene.decide(memory, pressure=30.0 * KPA)[0][0] == 0.0
    assert scene.decide(memory)[0][0] < 0.0
    action, _ = scene.decide(memory, buckled=1.0)
    assert action[0] > 0.0
    assert action[3] < -0.5


def test_steers_towards_the_way(scene: Scene) -> None:
    """Where the way bends is where the catheter bends, whatever its roll."""
    for angle in np.linspace(-3.0, 3.0, 7):
        for roll in (-2.0, 0.0, 1.0):
            aside = [2.0 * MM * np.cos(angle - roll), 2.0 * MM * np.sin(angle - roll)]
            way = [[*aside, 10.0 * MM]] * 5
            pull = scene.controller.observer.find_pull(2.5)
            terms = {"roll": [np.sin(roll), np.cos(roll)], "tendon_pull": pull, "way_ahead": way}
            _, memory = scene.decide(Memory(), **terms)
            gain = np.array(memory.bend) - 2.5 * np.array([np.cos(roll), np.sin(roll)])
            # Going on with the bend that it has brings it a part of the way.
            wanted = 2.0 * MM * np.array([np.cos(angle), np.sin(angle)])
            wanted -= 0.5 * 2.5 * (10.0 * MM) ** 2 * np.array([np.cos(roll), np.sin(roll)])
            across = gain[0] * wanted[1] - gain[1] * wanted[0]
            assert abs(across) < 1e-4 * np.linalg.norm(gain) * np.linalg.norm(wanted)  # float32 observations
            assert gain @ wanted > 0.0


def test_lets_go_of_the_tendon_while_it_points_the_wrong_way(scene: Scene) -> None:
    """A bent tip that is turned round sweeps the lumen: it is straightened first."""
    memory = Memory(Phase.GROW, bend=(-8.0, 0.0))
    action, _ = scene.decide(memory, length=34.0 * MM, tendon_pull=3.5 * MM)
    assert action[2] == -1.0
    assert abs(action[1]) == 1.0
    action, _ = scene.decide(memory, length=34.0 * MM, tendon_pull=3.5 * MM, roll=[0.0, -1.0])
    assert action[2] > 0.0


def test_pull_and_curvature_are_inverse() -> None:
    observer = Observer(gymnasium.make("MammobotDuct-v0"))
    for curvature in (3.0, 6.0, 11.0):
        assert observer.find_curvature(observer.find_pull(curvature)) == pytest.approx(curvature)
    assert observer.find_pull(100.0) == observer.limits.tendon_pull
    assert observer.find_pull(0.0) == 0.0


@pytest.mark.parametrize("task", ["duct", "pegs"])
def test_tuned_settings_ship_and_were_tuned_on_training_anatomies(task: str) -> None:
    text = (resources.files("evergym.agents") / "tuned" / f"duty_cycle_{task}.toml").read_text(encoding="utf-8")
    assert text.startswith(f"# Made by: evergym tune --task {task}")
    assert "on family 'train' only" in text
    assert load_tuned_settings(task) != KNOWN
