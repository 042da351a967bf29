"""The two deployments of the paper's Fig. 12, driven by the duty cycle and timed.

Wu et al. 2023 simulated the robot among pegs (266 s of robot time in 35 minutes of computing) and in a duct with a
change of branch by retraction (177 s in 20 minutes). Their exact drives are not published: here the scripted controller
drives, at a pace (a prior) that makes the deployments as long as theirs.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evergym.agents.duty_cycle import DutyCycleController, Phase, load_tuned_settings
from evergym.config import check
from evergym.envs.base import MammobotEnv
from evergym.envs.duct import MammobotDuctEnv
from evergym.envs.pegs import MammobotPegsEnv
from evergym.envs.route import LumenRoute
from evergym.errors import ConfigError
from evergym.units import MM

__all__ = ["DUCT", "PEGS", "Deployment", "DeploymentEvent", "DeploymentPlan", "RedirectedDuctEnv", "deploy"]

TRACE_KEYS = (
    "time_s",
    "everted_length_mm",
    "catheter_length_mm",
    "pressure_kpa",
    "tendon_pull_mm",
    "distance_to_go_mm",
    "wall_force_max_n",
    "penetration_mm",
    "contact_count",
    "cost_buckling",
)
"""What the trace takes from the env's info."""


@dataclass(frozen=True)
class DeploymentPlan:
    """Where the robot is sent and how fast.

    Attributes:
        name: Name of the scenario.
        family: Family of anatomies.
        index: Number of the anatomy in the family.
        pace_mm_s: Insertion velocity of the catheter while it advances [mm/s].
        step_mm: Advance per duty cycle [mm].
        paper_robot_s: Robot time of the paper's deployment [s].
        paper_computing_s: What its simulation took the paper's simulator [s].
        target: Number of the duct's target; without meaning among pegs, where the index chooses it.
        wrong_target: The target to which the robot is sent first; None: it is sent to the right one at once.
        wrong_depth_mm: How far behind the bifurcation it notices [mm].
    """

    name: str
    family: str
    index: int
    pace_mm_s: float
    step_mm: float
    paper_robot_s: float
    paper_computing_s: float
    target: int = 0
    wrong_target: int | None = None
    wrong_depth_mm: float = 15.0

    @property
    def paper_factor(self) -> float:
        """Robot time over computing time in the paper."""
        return self.paper_robot_s / self.paper_computing_s


PEGS = DeploymentPlan("pegs", "paper", 0, pace_mm_s=0.2, step_mm=3.0, paper_robot_s=266.0, paper_computing_s=2100.0)
"""The slalom among the four pegs."""
DUCT = DeploymentPlan(
    "duct",
    "held_out",
    1,
    pace_mm_s=0.43,
    step_mm=5.0,
    paper_robot_s=177.0,
    paper_computing_s=1200.0,
    target=1,
    wrong_target=0,
)
"""Into the wrong daughter of the second bifurcation, back, and into the other one."""


@dataclass(frozen=True)
class DeploymentEvent:
    """Something that happened, and when [s of robot time]."""

    time_s: float
    what: str


@dataclass(frozen=True)
class Deployment:
    """A deployment that was run.

    Attributes:
        plan: What was to be done.
        anatomy: Name of the place.
        reached: Whether the target was reached.
        end_reason: How it ended.
        robot_s: Robot time [s].
        wall_s: Time that simulator and controller took [s], without loading compiled code and without pictures.
        cpu_s: CPU time of the same [s].
        duty_cycles: Times that the controller raised the pressure to grow.
        events: What happened, in order.
        trace: One row of quantities per control step, with units in their names.
    """

    plan: DeploymentPlan
    anatomy: str
    reached: bool
    end_reason: str
    robot_s: float
    wall_s: float
    cpu_s: float
    duty_cycles: int
    events: tuple[DeploymentEvent, ...]
    trace: tuple[dict[str, Any], ...]

    @property
    def factor(self) -> float:
        """Robot time over computing time."""
        return self.robot_s / self.wall_s


class RedirectedDuctEnv(MammobotDuctEnv):
    """A duct in which the surgeon can change the target on the way."""

    _route: LumenRoute

    def redirect(self, target: int) -> Any:
        """Send the robot to another target of the duct from where it is; returns the observation."""
        self.target_index = target
        self._route = self._make_route(self._reading.tip_position)
        self._seen_route = self._route.copy() if self.settings.localisation_noise_mm > 0.0 else self._route
        self._end_reason = ""
        return self._observe()

    def find_split(self, target: int, other: int) -> float:
        """Return the station of the bifurcation that parts the ways to two targets [m]."""
        line = self.duct.centreline
        ways = [line.path_to(self.duct.targets[number].node) for number in (target, other)]
        shared = sum(int(a == b) for a, b in zip(*ways, strict=False))
        return float(line.station[ways[0][shared - 1]])

    def find_place(self) -> tuple[int, float]:
        """Return the branch in which the tip is, and its station [m]."""
        location = self._route.location
        return int(location.branch), float(location.station)


def deploy(
    plan: DeploymentPlan,
    *,
    model: str = "mammobot_2023",
    look: Callable[[float, NDArray[np.uint8]], None] | None = None,
    look_interval_s: float = 5.0,
) -> Deployment:
    """Run a deployment to its end.

    Args:
        plan: Where to and how fast.
        model: Name or file of the model.
        look: Called with the robot time [s] and a picture at the start, every ``look_interval_s`` and at the end.
        look_interval_s: Robot time between pictures [s].

    Raises:
        ConfigError: The model, the anatomy or a target does not exist, or the two targets are the same.
    """
    if plan.wrong_target is not None and plan.wrong_target == plan.target:
        raise ConfigError(f"The wrong target and the target are both number {plan.target}. Choose two targets.")
    render_mode = None if look is None else "rgb_array"
    arguments: dict[str, Any] = {"family": plan.family, "model": model, "render_mode": render_mode}
    arguments["time_limit_s"] = max(300.0, 4.0 * plan.paper_robot_s)
    env = MammobotPegsEnv(**arguments) if plan.name == "pegs" else RedirectedDuctEnv(**arguments)
    try:
        return _Run(plan, env, look, look_interval_s).finish()
    finally:
        env.close()


class _Run:
    """One deployment while it runs."""

    def __init__(
        self,
        plan: DeploymentPlan,
        env: MammobotEnv,
        look: Callable[[float, NDArray[np.uint8]], None] | None,
        look_interval_s: float,
    ) -> None:
        self.plan, self.env, self.look, self.look_interval = plan, env, look, look_interval_s
        task = "pegs" if plan.name == "pegs" else "duct"
        settings = replace(load_tuned_settings(task), insertion_mm_s=plan.pace_mm_s, step_mm=plan.step_mm)
        check(settings, f"deployment {plan.name}")
        self.controller = DutyCycleController(env, settings)
        self.options: dict[str, Any] = {"index": plan.index}
        if task == "duct":
            self.options["target"] = plan.target if plan.wrong_target is None else plan.wrong_target
        self.events: list[DeploymentEvent] = []
        self.trace: list[dict[str, Any]] = []
        self.wall = self.cpu = 0.0
        self.duty_cycles = 0
        self.is_astray = plan.wrong_target is not None
        self.place = "before"
        self.next_look = 0.0

    def finish(self) -> Deployment:
        env, controller = self.env, self.controller
        # Compiled code is loaded, and the solver warm, before the clock runs; and a target that is not there is named.
        last = {"target": self.plan.target} if "target" in self.options else {}
        env.reset(seed=0, options={**self.options, **last})
        env.step(np.array([0.0, 0.0, -1.0, -1.0], np.float32))
        observation, info = env.reset(seed=0, options=self.options)
        memory: Any = None
        phase, ended = Phase.STEER, False
        self._show(info)
        while not ended:
            wall, cpu = time.perf_counter(), time.process_time()
            action, memory = controller.predict(observation, memory)
            observation, _, terminated, truncated, info = env.step(action)
            self.wall += time.perf_counter() - wall
            self.cpu += time.process_time() - cpu
            ended = terminated or truncated
            self._follow_phase(phase, memory[0].phase, info)
            phase = memory[0].phase
            self._record(phase, info)
            if isinstance(env, RedirectedDuctEnv) and self.plan.wrong_target is not None:
                self._follow_branch(env, self.plan.wrong_target, info)
                if self.is_astray and (self._is_deep(env) or info["is_success"]):
                    observation, ended, self.is_astray = env.redirect(self.plan.target), False, False
                    self._note(info, "seen to be the wrong branch: sent to the other target")
            if ended:
                self._note(info, "target reached" if info["is_success"] else f"ended: {info['end_reason']}")
            self._show(info)
        return Deployment(
            plan=self.plan,
            anatomy=str(info["anatomy"]),
            reached=bool(info["is_success"]),
            end_reason=str(info["end_reason"]),
            robot_s=float(info["time_s"]),
            wall_s=self.wall,
            cpu_s=self.cpu,
            duty_cycles=self.duty_cycles,
            events=tuple(self.events),
            trace=tuple(self.trace),
        )

    def _note(self, info: dict[str, Any], what: str) -> None:
        self.events.append(DeploymentEvent(float(info["time_s"]), what))
        self.next_look = float(info["time_s"])

    def _follow_phase(self, before: Phase, now: Phase, info: dict[str, Any]) -> None:
        if now is before:
            return
        if now is Phase.GROW:
            self.duty_cycles += 1
        if now is Phase.WITHDRAW:
            self._note(info, "pressure down, retraction begins")
        elif before is Phase.WITHDRAW:
            self._note(info, "retraction ends, steering")

    def _follow_branch(self, env: RedirectedDuctEnv, wrong: int, info: dict[str, Any]) -> None:
        line, targets = env.duct.centreline, env.duct.targets
        split = env.find_split(wrong, self.plan.target)
        branch, station = env.find_place()
        sides = {
            number: {
                int(line.branch[node]) for node in line.path_to(targets[number].node) if line.station[node] > split
            }
            for number in (wrong, self.plan.target)
        }
        place = "before"
        if station > split and branch in sides[wrong]:
            place = "wrong"
        elif station > split and branch in sides[self.plan.target]:
            place = "right"
        if place != self.place:
            words = {"before": "back before the bifurcation", "wrong": "wrong branch", "right": "target's branch"}
            self._note(info, words[place] if place == "before" else f"past the bifurcation into the {words[place]}")
            self.place = place

    def _is_deep(self, env: RedirectedDuctEnv) -> bool:
        assert self.plan.wrong_target is not None
        split = env.find_split(self.plan.wrong_target, self.plan.target)
        return env.find_place()[1] > split + self.plan.wrong_depth_mm * MM

    def _record(self, phase: Phase, info: dict[str, Any]) -> None:
        self.trace.append({"phase": phase.name.lower(), **{key: info[key] for key in TRACE_KEYS}})

    def _show(self, info: dict[str, Any]) -> None:
        if self.look is not None and info["time_s"] >= self.next_look:
            self.next_look = info["time_s"] + self.look_interval
            self.look(float(info["time_s"]), self.env.render())
