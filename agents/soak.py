"""Run the environments for a long time under random and adversarial actions: nothing may escape, nothing may be NaN."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import json
import math
import os
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from evergym.agents.env_factory import ignore_interrupts, make_env, prepare_workers, probe_env, resolve_env_id
from evergym.agents.progress import ProgressReport
from evergym.agents.settings import parse_options
from evergym.errors import ConfigError

__all__ = ["SCENARIOS", "Soak", "SoakResult"]

_NAN_SHARE = 0.002  # of all steps, a non-finite action comes before
_CHUNK = 1000  # steps between reports of a worker
_FAILURES_KEPT = 20


Actions = Iterator[NDArray[np.float64]]
"""The actions of an episode, which may lie outside -1..1.

Components: insertion velocity, roll rate, tendon pull, pressure (-1 is none for the last two)."""


def _random(generator: np.random.Generator) -> Actions:
    while True:
        yield generator.uniform(-1.0, 1.0, 4)


def _held(generator: np.random.Generator) -> Actions:
    while True:
        action = generator.uniform(-1.0, 1.0, 4)
        for _ in range(25):
            yield action


def _bang_bang(generator: np.random.Generator) -> Actions:
    while True:
        yield generator.choice([-1.0, 1.0], 4)


def _out_of_range(generator: np.random.Generator) -> Actions:
    while True:
        yield generator.choice([-1e30, -50.0, -1.0, 1.0, 50.0, 1e30], 4)


def _insertion_without_pressure(generator: np.random.Generator) -> Actions:
    while True:
        yield np.array([1.0, *generator.uniform(-1.0, 1.0, 2), -1.0])


def _roll_at_full_pull(generator: np.random.Generator) -> Actions:
    while True:
        insertion, roll = generator.uniform(0.0, 1.0), generator.choice([-1.0, 1.0])
        for _ in range(40):
            yield np.array([insertion, roll, 1.0, 1.0])


def _pressure_jumps(generator: np.random.Generator) -> Actions:
    while True:
        for pressure in (-1.0, -1.0, 1.0, 1.0):
            yield np.array([1.0, generator.uniform(-0.2, 0.2), generator.uniform(-1.0, 1.0), pressure])


def _retraction(generator: np.random.Generator) -> Actions:
    while True:  # grow, then pull everything back, at whatever pressure
        for _ in range(100):
            yield np.array([1.0, 0.0, generator.uniform(-1.0, 1.0), 1.0])
        pressure = generator.uniform(-1.0, 1.0)
        for _ in range(100):
            yield np.array([-1.0, 0.0, generator.uniform(-1.0, 1.0), pressure])


SCENARIOS: dict[str, Callable[[np.random.Generator], Actions]] = {
    "random": _random,
    "held": _held,
    "bang_bang": _bang_bang,
    "out_of_range": _out_of_range,
    "insertion_without_pressure": _insertion_without_pressure,
    "roll_at_full_pull": _roll_at_full_pull,
    "pressure_jumps": _pressure_jumps,
    "retraction": _retraction,
}
"""How the actions of an episode are chosen."""


@dataclasses.dataclass
class SoakResult:
    """Counts of a part of the soak; parts add up."""

    steps: int = 0
    episodes: int = 0
    handled_bad_actions: int = 0
    """Non-finite actions that raised ValueError, as they must."""
    step_seconds_max: float = 0.0
    end_reasons: Counter[str] = dataclasses.field(default_factory=Counter)
    scenario_steps: Counter[str] = dataclasses.field(default_factory=Counter)
    failures: list[str] = dataclasses.field(default_factory=list)
    """What went wrong, with what is needed to repeat it."""

    def add(self, other: SoakResult) -> None:
        """Add the counts of another part."""
        self.steps += other.steps
        self.episodes += other.episodes
        self.handled_bad_actions += other.handled_bad_actions
        self.step_seconds_max = max(self.step_seconds_max, other.step_seconds_max)
        self.end_reasons += other.end_reasons
        self.scenario_steps += other.scenario_steps
        self.failures += other.failures


@dataclasses.dataclass(frozen=True)
class Soak:
    """Run random and adversarial actions over both tasks; the exit code is 1 if anything goes wrong."""

    steps: int = 200_000
    """Environment steps in all."""
    envs: tuple[str, ...] = ("MammobotDuct-v0", "MammobotPegs-v0")
    """Environment ids that share the steps."""
    env_options: tuple[str, ...] = ()
    """Arguments of the environments as key=value."""
    seed: int = 0
    """Seed of anatomies and actions."""
    workers: int = 0
    """Processes (0: one per core)."""

    def run(self) -> int:
        """Run the soak, print the counts as JSON; returns the exit code."""
        if self.steps < 1 or not self.envs:
            raise ConfigError(f"A soak needs at least 1 step and 1 environment; got {self.steps} and {len(self.envs)}.")
        results = self._run_parts()
        total = SoakResult()
        for result in results.values():
            total.add(result)
        shown = {"ok": not total.failures, "total": _to_plain(total)}
        shown["environments"] = {name: _to_plain(result) for name, result in results.items()}
        print(json.dumps(shown, indent=2))
        return 1 if total.failures else 0

    def _run_parts(self) -> dict[str, SoakResult]:
        names = [resolve_env_id(name) for name in self.envs]
        for name in names:
            probe_env(name, parse_options(self.env_options))
        per_env = math.ceil(self.steps / len(names))
        counts = [min(_CHUNK, per_env - start) for start in range(0, per_env, _CHUNK)]
        parts = [
            (name, self.env_options, [self.seed, number, part], count)
            for part, count in enumerate(counts)
            for number, name in enumerate(names)
        ]
        results = {name: SoakResult() for name in names}
        workers = min(self.workers or os.cpu_count() or 1, len(parts))
        with ProgressReport("Soak", per_env * len(names)) as report:
            for name, result in _map_parts(parts, workers):
                results[name].add(result)
                done = sum(item.steps for item in results.values())
                report.update(done, f"{sum(len(item.failures) for item in results.values())} failures")
        return results


def _map_parts(parts: list[Any], workers: int) -> Any:
    if workers == 1:
        for part in parts:
            yield part[0], soak_part(*part)
        return
    context = prepare_workers("evergym.agents.soak")
    with concurrent.futures.ProcessPoolExecutor(workers, context, ignore_interrupts) as pool:
        futures = {pool.submit(soak_part, *part): part[0] for part in parts}
        try:
            for future in concurrent.futures.as_completed(futures):
                yield futures[future], future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def soak_part(name: str, env_options: tuple[str, ...], seed: list[int], steps: int) -> SoakResult:
    """Run a number of steps in one process; after a failure the rest of the part goes on in a new episode."""
    generator = np.random.default_rng(seed)
    env = make_env(name, parse_options(env_options))
    result = SoakResult()
    try:
        while result.steps < steps and len(result.failures) < _FAILURES_KEPT:
            scenario = str(generator.choice(list(SCENARIOS)))
            _soak_episode(env, scenario, generator, f"{name}, part {seed}, scenario {scenario}", steps, result)
    finally:
        env.close()
    return result


def _soak_episode(
    env: gymnasium.Env[Any, Any],
    scenario: str,
    generator: np.random.Generator,
    where: str,
    steps: int,
    result: SoakResult,
) -> None:
    reset_seed = int(generator.integers(2**31))
    where = f"{where}, reset seed {reset_seed}"
    actions = SCENARIOS[scenario](generator)
    step_limit = (
        300 if generator.random() < 0.8 else 1_000_000
    )  # so that all scenarios come up often, and some to the end
    number = 0
    try:
        observation, info = env.reset(seed=reset_seed)
        problems = _check(env, observation, 0.0, info)
        ended = False
        while not (ended or problems) and result.steps < steps and number < step_limit:
            if generator.random() < _NAN_SHARE:
                problems += _try_bad_action(env, generator, result)
            action = next(actions).astype(np.float32)
            begin = time.perf_counter()
            observation, reward, terminated, truncated, info = env.step(action)
            result.step_seconds_max = max(result.step_seconds_max, time.perf_counter() - begin)
            number += 1
            result.steps += 1
            result.scenario_steps[scenario] += 1
            problems += _check(env, observation, reward, info)
            ended = terminated or truncated
            if ended:
                result.end_reasons[str(info.get("end_reason", ""))] += 1
        result.failures += [f"{where}, step {number}: {problem}" for problem in problems]
    except Exception:  # noqa: BLE001 (whatever escapes is what the soak looks for)
        result.steps += 1  # the failed step counts, so that the soak ends
        result.failures.append(f"{where}, step {number + 1}: {traceback.format_exc(limit=-3)}")
    result.episodes += 1


def _try_bad_action(env: gymnasium.Env[Any, Any], generator: np.random.Generator, result: SoakResult) -> list[str]:
    action = generator.uniform(-1.0, 1.0, 4).astype(np.float32)
    action[generator.integers(4)] = generator.choice([np.nan, np.inf, -np.inf])
    try:
        env.step(action)
    except ValueError:
        result.handled_bad_actions += 1
        return []
    return [f"the non-finite action {action} was accepted"]


def _check(env: gymnasium.Env[Any, Any], observation: Any, reward: Any, info: Mapping[str, Any]) -> list[str]:
    problems = []
    if not env.observation_space.contains(observation):
        problems.append(f"the observation is not in its space: {observation}")
    if not math.isfinite(reward):
        problems.append(f"the reward is {reward}")
    for key, value in info.items():
        if isinstance(value, float | np.ndarray | np.floating) and not np.all(np.isfinite(value)):
            problems.append(f"info[{key!r}] is {value}")
    return problems


def _to_plain(result: SoakResult) -> dict[str, Any]:
    plain = {field.name: getattr(result, field.name) for field in dataclasses.fields(result)}
    plain["failures"] = result.failures[:_FAILURES_KEPT]
    plain["failure_count"] = len(result.failures)
    return plain
