"""What both tasks share: how an episode starts, advances and ends, and what is reported."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from evergym.envs.drive import ACTION_NAMES, HOLD_MAX, Drive, DriveLimits, check_action
from evergym.envs.observation import (
    Frame,
    ObservationTerm,
    compute_observation,
    compute_tip_frame,
    inverse_scales,
    make_observation_space,
)
from evergym.envs.randomisation import draw_model
from evergym.envs.rendering.endoscope import ENDOSCOPE_SIZE, EndoscopeView
from evergym.envs.rendering.view import View, make_view
from evergym.envs.reward import REWARD_TERMS, compute_reward_terms
from evergym.envs.route import Route
from evergym.envs.settings import EpisodeSettings, PictureSettings, RewardSettings, check_keys
from evergym.errors import ConfigError, SimulationDiverged
from evergym.model import load_model
from evergym.simulator import Command, Reading, Simulator
from evergym.units import KPA, MM
from evergym.world import World

__all__ = ["MammobotEnv"]

_RETRY_PARTS = 8
_REWARD_KEYS = tuple(f"reward/{term}" for term in REWARD_TERMS)


class MammobotEnv(gymnasium.Env[Any, NDArray[np.float32]]):
    """One robot on the way to one target; a subclass says where it is and what its map shows."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 4}  # noqa: RUF012 (gymnasium's declaration)
    terms: ClassVar[tuple[ObservationTerm, ...]]
    option_names: ClassVar[tuple[str, ...]]
    has_wall: ClassVar[bool] = True
    """Whether there is tissue that the robot can perforate."""

    def __init__(
        self,
        settings: EpisodeSettings,
        reward: Mapping[str, float] | None,
        render_mode: str | None,
        picture: PictureSettings,
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ConfigError(
                f"render_mode is {render_mode!r}; it must be None or one of {self.metadata['render_modes']}."
            )
        self.render_mode = render_mode
        self.settings = settings
        self.picture = picture
        self.reward_settings = RewardSettings.from_mapping(reward)
        self.model = load_model(settings.model)
        self.action_space = spaces.Box(-1.0, 1.0, (len(ACTION_NAMES),), np.float32)
        self.has_image = settings.observation == "state+image"
        self.observation_space: spaces.Space[Any] = self._make_space()
        self.drive = Drive(DriveLimits.from_robot(self.model.robot))
        self._factors = inverse_scales(self.terms, hide_map=settings.hide_map)
        self._holds = max(1, math.ceil(settings.control_step_s / HOLD_MAX - 1e-9))
        self._hold = settings.control_step_s / self._holds
        self._view: View | None = None
        self._eye: EndoscopeView | None = None
        self._world: World | None = None
        self._anatomy: dict[str, Any] = {}
        self._simulator: Simulator | None = None

    # What a task adds

    @abstractmethod
    def _select(self, options: Mapping[str, Any]) -> tuple[World, dict[str, Any], Any]:
        """Choose where the episode takes place.

        Returns:
            The world (the same object if the place is the same), what ``info`` says about it, and what is drawn.
        """

    @abstractmethod
    def _start_path(self) -> NDArray[np.float64]:
        """Return the way to the selected target [m], shape (k, 3), along which the robot is laid at the start."""

    @abstractmethod
    def _make_route(self, start: NDArray[np.float64]) -> Route:
        """Return the way to the selected target for a tip at ``start`` [m]."""

    # gymnasium's interface

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; see the class for the options."""
        super().reset(seed=seed)
        options = options or {}
        check_keys(options, self.option_names, where="reset(options=...)")
        length = options.get("everted_length_mm", self.settings.everted_length_mm)
        if isinstance(length, bool) or not isinstance(length, int | float) or not 0.0 < length < math.inf:
            raise ConfigError(f"options['everted_length_mm'] is {length!r}; it must be a positive number in mm.")
        world, self._anatomy, scene = self._select(options)
        if self.settings.model_randomisation > 0.0:
            model = draw_model(self.model, self.np_random, self.settings.model_randomisation)
            self._simulator = Simulator(model, world)
        elif self._simulator is None or world is not self._world:
            self._simulator = Simulator(self.model, world)
        self._world = world
        self._scene = scene
        self.drive.reset()
        reading = self._simulator.reset(everted_length=length * MM, path=self._start_path())
        self._reading = reading
        self._route = self._make_route(reading.tip_position)
        self._seen_route = self._route.copy() if self.settings.localisation_noise_mm > 0.0 else self._route
        self._step_count = 0
        self._travel = 0.0
        self._way_start = self._route.distance_to_go
        self._end_reason = ""
        observation = self._observe()
        return observation, self._make_info()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Hold the commands of ``action`` for one control step.

        Raises:
            ValueError: If the action has the wrong shape or a component that is not finite.
        """
        if self._simulator is None:
            raise gymnasium.error.ResetNeeded("step() was called before reset(). Call reset() first.")
        values = check_action(action)
        settings = self.settings
        route = self._route
        distance_before = route.distance_to_go
        tip_before = self._reading.tip_position.tolist()
        diverged = not self._advance(values)
        self._step_count += 1
        reading = self._reading
        route.locate(reading.tip_position)
        self._travel += math.dist(reading.tip_position.tolist(), tip_before)

        burst = bool(reading.burst)
        perforated = self.has_wall and bool(reading.penetration_max > settings.perforation_depth_mm * MM)
        reached = not (burst or perforated or diverged) and route.tip_error <= settings.success_distance_mm * MM
        late = self._step_count * settings.control_step_s >= settings.time_limit_s - 1e-9
        if burst:
            self._end_reason = "burst"
        elif perforated:
            self._end_reason = "perforated"
        elif diverged:
            self._end_reason = "diverged"
        elif reached:
            self._end_reason = "reached"
        elif late:
            self._end_reason = "time"
        terminated = burst or perforated or reached
        truncated = not terminated and (diverged or late)
        self._failed = burst or perforated
        observation = self._observe()
        reward_terms = self._reward_terms(observation, distance_before)
        info = self._make_info()
        info.update(reward_terms)
        return observation, sum(reward_terms.values()), terminated, truncated, info

    def render(self) -> Any:
        """Return the current picture as an RGB array (height, width, 3) of uint8, or None without a render mode."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() does nothing without render_mode='rgb_array' in gymnasium.make(...).")
            return None
        if self._simulator is None:
            raise gymnasium.error.ResetNeeded("render() was called before reset(). Call reset() first.")
        target = self._route.target
        if self._view is None:
            self._view = make_view(self.picture.view, self._scene, target, self.picture.width, self.picture.height)
        self._view.place(self._scene, target)
        return self._view.frame(self._simulator, self._describe())

    def close(self) -> None:
        """Free the view; the environment can be closed more than once."""
        if self._view is not None:
            self._view.close()
            self._view = None

    def _describe(self) -> str:
        """Return the caption of a picture."""
        reading, route = self._reading, self._route
        end = f"   {self._end_reason}" if self._end_reason else ""
        return (
            f"{reading.time:.1f} s   {reading.pressure / KPA:.0f} kPa   pull {reading.tendon_pull / MM:.1f} mm   "
            f"to go {route.distance_to_go / MM:.1f} mm   force {reading.wall_force_max:.2f} N{end}"
        )

    # One step

    def _advance(self, action: list[float]) -> bool:
        """Advance by one control step; return whether the simulator could."""
        for _ in range(self._holds):
            command = self.drive.command(
                action, self._hold, self._reading.catheter_length, self._reading.everted_length
            )
            if not self._hold_command(command, self._hold):
                return False
        return True

    def _hold_command(self, command: Command, duration: float) -> bool:
        """Hold one command; a diverged step is retried in halves, quarters and eighths."""
        assert self._simulator is not None  # step() and reset() made it
        simulator = self._simulator
        end = self._reading.time + duration
        part = duration
        while True:
            left = end - simulator.reading.time if part < duration else duration
            if left <= 1e-9 * duration:
                return True
            try:
                self._reading = simulator.advance(command, min(part, left))
            except SimulationDiverged:
                self._reading = simulator.reading
                part *= 0.5
                if part * _RETRY_PARTS < 0.999 * duration:
                    return False
                continue
            if part == duration:
                return True

    def _make_space(self) -> spaces.Space[Any]:
        """Return the space of `_observe`."""
        state = make_observation_space(self.terms)
        if not self.has_image:
            return state
        width, height = ENDOSCOPE_SIZE
        return spaces.Dict({"state": state, "endoscope": spaces.Box(0, 255, (height, width, 3), np.uint8)})

    def _observe(self) -> Any:
        """Return the observation of the current state."""
        state = self._observe_state()
        return {"state": state, "endoscope": self._observe_image()} if self.has_image else state

    def _observe_image(self) -> NDArray[np.uint8]:
        """Return what the endoscope sees; where the target lies belongs to the map, and is hidden with it."""
        assert self._simulator is not None  # step() and reset() made it
        target = None if self.settings.hide_map else self._route.target
        if self._eye is None:
            self._eye = EndoscopeView(self._scene, target)
        self._eye.place(self._scene, target)
        return self._eye.frame(self._simulator)

    def _observe_state(self) -> NDArray[np.float32]:
        """Return the state's part of the observation."""
        assert self._simulator is not None  # step() and reset() made it
        reading: Reading = self._reading
        position: list[float] = reading.tip_position.tolist()
        frame: Frame = compute_tip_frame(reading.tip_direction.tolist(), reading.tendon_side.tolist())
        noise = self.settings.localisation_noise_mm * MM
        if noise > 0.0:
            position, frame = self._localise(position, frame, noise)
            self._seen_route.locate(np.array(position))
        time_left = 1.0 - self._step_count * self.settings.control_step_s / self.settings.time_limit_s
        return compute_observation(reading, self.drive, position, frame, self._seen_route, time_left, self._factors)

    def _localise(self, position: list[float], frame: Frame, noise: float) -> tuple[list[float], Frame]:
        """Return tip position and frame as a noisy localisation sees them.

        The direction is taken to be found from two points 10 mm apart, so its noise is the position's over 10 mm.
        """
        draw = self.np_random.standard_normal(9).tolist()
        tilt = noise / (10.0 * MM)
        seen = [value + noise * error for value, error in zip(position, draw[:3], strict=True)]
        side = [value + tilt * error for value, error in zip(frame[0:3], draw[3:6], strict=True)]
        direction = [value + tilt * error for value, error in zip(frame[6:9], draw[6:9], strict=True)]
        return seen, compute_tip_frame(direction, side)

    def _reward_terms(self, observation: Any, distance_before: float) -> dict[str, float]:
        """Return the terms of the reward of the step that led to ``observation``, as ``info`` shows them."""
        del observation  # of use where the observation holds the goals
        terms = compute_reward_terms(
            self.reward_settings,
            distance_before=distance_before,
            distance_after=self._route.distance_to_go,
            wall_force=self._reading.wall_force_max,
            duration=self.settings.control_step_s,
            reached=self._end_reason == "reached",
            failed=self._failed,
        )
        return dict(zip(_REWARD_KEYS, terms, strict=True))

    def _make_info(self) -> dict[str, Any]:
        """Return a fresh info dictionary: plain Python values, no NaN, no wall-clock value."""
        reading, route, settings = self._reading, self._route, self.settings
        cost_wall_force = 1.0 if reading.wall_force_max > settings.wall_force_limit_n else 0.0
        cost_burst = 1.0 if reading.burst else 0.0
        cost_buckling = 1.0 if reading.buckled else 0.0
        fx, fy, fz = reading.tip_force.tolist()
        return {
            "is_success": self._end_reason == "reached",
            "end_reason": self._end_reason,
            "cost": cost_wall_force + cost_burst + cost_buckling,
            "cost_wall_force": cost_wall_force,
            "cost_burst": cost_burst,
            "cost_buckling": cost_buckling,
            "tip_error_mm": route.tip_error / MM,
            "distance_to_go_mm": route.distance_to_go / MM,
            "wall_force_n": reading.wall_force_sum,
            "wall_force_max_n": reading.wall_force_max,
            "tip_force_n": math.sqrt(fx * fx + fy * fy + fz * fz),
            "contact_count": reading.contact_count,
            "penetration_mm": reading.penetration_max / MM,
            "time_s": reading.time,
            "everted_length_mm": reading.everted_length / MM,
            "catheter_length_mm": reading.catheter_length / MM,
            "pressure_kpa": reading.pressure / KPA,
            "tendon_pull_mm": reading.tendon_pull / MM,
            "path_ratio": (self._travel + route.distance_to_go) / max(self._way_start, MM),
            **self._anatomy,
        }
