"""Plans made in a model and carried out on a robot that is not watched: as good as the model, no better.

A controller that sees the tip all the time corrects what its model gets wrong. Where nothing shows the tip, as in a
duct without imaging, the way can only be rehearsed beforehand in the model's environment, and the drives then repeat
what they did there. `compare_models` does so with several models on the same robot and the same anatomies.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from evergym.agents.arms import Policy, find_controller_arm, make_policy
from evergym.agents.env_factory import make_env
from evergym.agents.episodes import EpisodeRecord, Step, run_episode
from evergym.agents.evaluation import derive_episode_seed
from evergym.agents.statistics import Comparison, Estimate, compare_paired, compute_wilson, resample_mean

__all__ = [
    "PairedResult",
    "Plan",
    "ReplayPolicy",
    "Trial",
    "carry_out",
    "compare_models",
    "compare_trials",
    "describe_trials",
    "rehearse",
]


SETTLING_S = 10.0
"""For how long the robot is given to come to rest where a plan has left it [s]."""


class Plan(NamedTuple):
    """What the drives did in a rehearsal."""

    actions: NDArray[np.float32]
    """One row for each control step, shape (k, 4)."""
    rehearsal: EpisodeRecord
    """How the rehearsal ended."""


@dataclasses.dataclass(frozen=True)
class Trial:
    """Plans made in one model, carried out on the robot."""

    model: str
    rehearsals: tuple[EpisodeRecord, ...]
    """In the model."""
    episodes: tuple[EpisodeRecord, ...]
    """On the robot."""

    @property
    def successes(self) -> list[bool]:
        """Whether each episode on the robot reached its target."""
        return [record.success for record in self.episodes]

    @property
    def tip_errors(self) -> NDArray[np.float64]:
        """Distance to the target at the end of each episode on the robot [mm], (n,)."""
        return np.array([record.tip_error_mm for record in self.episodes])


class ReplayPolicy:
    """Repeats a plan without looking; when it is over, holds pull and pressure and moves nothing.

    Args:
        actions: One row for each control step, shape (k, 4).
    """

    def __init__(self, actions: NDArray[np.float32]) -> None:
        last = actions[-1].copy()
        last[:2] = 0.0  # rates; the other two are set points
        self._actions = np.vstack((actions, last))

    def predict(
        self,
        observation: Any,  # noqa: ARG002
        state: Any = None,
        episode_start: Any = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the plan's next action, and the number of the one after it."""
        number = 0 if state is None else int(state)
        return self._actions[min(number, len(self._actions) - 1)], number + 1


def carry_out(
    env: gymnasium.Env[Any, Any], plan: Plan, *, arm: str, split: str, index: int, seed: int
) -> EpisodeRecord:
    """Run a plan on the robot without looking, until it arrives or `SETTLING_S` after the plan's end."""
    step: float = env.unwrapped.settings.control_step_s  # type: ignore[attr-defined]
    last = len(plan.actions) + math.ceil(SETTLING_S / step)
    limited: gymnasium.Env[Any, Any] = gymnasium.wrappers.TimeLimit(env, max_episode_steps=last)
    return run_episode(limited, ReplayPolicy(plan.actions), arm=arm, split=split, index=index, seed=seed)


def rehearse(env: gymnasium.Env[Any, Any], policy: Policy, *, split: str, index: int, seed: int) -> Plan:
    """Run an episode in a model's environment and return what the drives did."""
    actions: list[NDArray[np.float32]] = []

    def keep(step: Step) -> None:
        if step.action is not None:
            actions.append(np.asarray(step.action, np.float32))

    record = run_episode(env, policy, arm="rehearsal", split=split, index=index, seed=seed, observe=keep)
    return Plan(np.array(actions), record)


def compare_models(
    env: str,
    robot: str,
    models: Sequence[str],
    *,
    episodes: int,
    controller: str = "duty_cycle",
    split: str = "held_out",
    seed: int = 1_000_000,
    options: Mapping[str, Any] | None = None,
    on_episode: Callable[[int], None] | None = None,
) -> list[Trial]:
    """Rehearse the same episodes in each model and carry the plans out on the robot.

    Args:
        env: Environment id.
        robot: Model file that stands for the robot.
        models: Model files to plan with (or names of shipped models).
        episodes: Anatomies.
        controller: What drives in the rehearsals, with the model's data sheet and everything in sight.
        split: Family of anatomies.
        seed: Seed of targets and noise.
        options: Further arguments of the environment.
        on_episode: Called with the number of episodes done.
    """
    given = dict(options or {})
    arm = find_controller_arm(controller)
    real = make_env(env, {**given, "model": robot})
    trials = []
    done = 0
    try:
        for model in models:
            planned = make_env(env, {**given, "model": model})
            rehearsals, carried_out = [], []
            try:
                for index in range(episodes):
                    where = {"split": split, "index": index, "seed": derive_episode_seed(seed, split, index)}
                    plan = rehearse(planned, make_policy(arm, planned), **where)  # type: ignore[arg-type]
                    rehearsals.append(plan.rehearsal)
                    carried_out.append(carry_out(real, plan, arm=model, **where))  # type: ignore[arg-type]
                    done += 1
                    if on_episode is not None:
                        on_episode(done)
            finally:
                planned.close()
            trials.append(Trial(model, tuple(rehearsals), tuple(carried_out)))
    finally:
        real.close()
    return trials


class PairedResult(NamedTuple):
    """The last model's plans against the first model's, on the same episodes."""

    success: Comparison
    tip_error_mm: Estimate
    """Mean difference, last minus first, with its paired-bootstrap interval."""
    tip_error_p_value: float
    """Wilcoxon's signed-rank test, two-sided."""


def compare_trials(first: Trial, last: Trial) -> PairedResult:
    """Compare two trials of the same episodes.

    Source: of the test: Wilcoxon 1945, doi 10.2307/3001968; computed by scipy.
    """
    from scipy.stats import wilcoxon

    difference = last.tip_errors - first.tip_errors
    p_value = float(wilcoxon(difference).pvalue) if np.any(difference != 0.0) else 1.0
    return PairedResult(compare_paired(last.successes, first.successes), resample_mean(difference), p_value)


def describe_trials(trials: Sequence[Trial], names: Sequence[str] | None = None) -> str:
    """Return a table of the trials, and the last compared with the first."""
    names = [trial.model for trial in trials] if names is None else names
    width = max(len("plan made in"), *map(len, names))
    lines = [f"{'plan made in':<{width}}  {'rehearsed':>9}  {'on the robot':>12}  {'95 %':>10}  {'tip error [mm]':>22}"]
    for name, trial in zip(names, trials, strict=True):
        count = len(trial.episodes)
        rate = compute_wilson(sum(trial.successes), count)
        error = resample_mean(trial.tip_errors)
        rehearsed = f"{sum(record.success for record in trial.rehearsals)}/{count}"
        arrived = f"{sum(trial.successes)}/{count}"
        span = f"{100.0 * rate.low:.0f}-{100.0 * rate.high:.0f}"
        lines.append(
            f"{name:<{width}}  {rehearsed:>9}  {arrived:>12}  {span:>10}"
            f"  {error.value:>8.2f} ({error.low:.2f} to {error.high:.2f})"
        )
    if len(trials) > 1:
        paired = compare_trials(trials[0], trials[-1])
        reached, tip = paired.success, paired.tip_error_mm
        gain = ", ".join(f"{100.0 * value:+.0f}" for value in reached.difference[1:])
        span = f"{tip.low:+.2f}, {tip.high:+.2f}"
        lines.append(f"{names[-1]} against {names[0]}, {len(trials[0].episodes)} pairs, 95 % in brackets:")
        lines.append(
            f"  reached: {100.0 * reached.difference.value:+.0f} points ({gain}); {reached.first_only} gained,"
            f" {reached.second_only} lost, p = {reached.p_value:.2g} (McNemar)"
        )
        lines.append(f"  tip error: {tip.value:+.2f} mm ({span}), p = {paired.tip_error_p_value:.2g} (Wilcoxon)")
    return "\n".join(lines)
