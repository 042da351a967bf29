"""One robot in one environment, driven in small steps by a hand, the duty cycle or a policy; no page, no clock.

A session belongs to one thread. What other threads want of it goes through ``evergym.agents.play.loop``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evergym.agents.arms import Arm, Policy, find_controller_arm, find_run_arm, make_policy
from evergym.agents.env_factory import make_env, resolve_env_id
from evergym.agents.play.episode import COLUMNS, DRIVERS, Episode, Frame, Heading
from evergym.agents.play.hand import DriveName, Hand
from evergym.duct_models.duct import Duct
from evergym.duct_models.pegs import PegField
from evergym.envs.base import MammobotEnv
from evergym.envs.rendering.pose import read_pose
from evergym.errors import ConfigError, RunError
from evergym.simulator import Simulator
from evergym.units import DEG, KPA, MM

__all__ = ["FRAME_RATE", "Session"]

FRAME_RATE = 24.0
"""Frames per second of robot time, at least."""

_HAND, _DUTY_CYCLE, _POLICY = range(3)


class Session:
    """A robot that is driven, and the record of the episode so far.

    The environment advances in parts of the control step for which its policies are made, so that the picture moves
    smoothly; a controller or policy is asked as often as in an evaluation, and its action held between.

    Args:
        env: Environment id.
        options: Arguments of the environment.
        policy: Run folder of a policy that can be handed the robot.

    Raises:
        ConfigError: unknown environment or argument, or an environment of another package.
        RunError: no such run, or a policy for another environment.
    """

    def __init__(
        self, env: str = "MammobotDuct-v0", options: Mapping[str, Any] | None = None, policy: Path | None = None
    ) -> None:
        self.env_id = resolve_env_id(env)
        # Policies and controllers see this one: its control step is theirs. It is never stepped.
        self._reference = make_env(self.env_id, options)
        base = self._reference.unwrapped
        if not isinstance(base, MammobotEnv):
            raise ConfigError(f"'{env}' has no robot of this package to drive. Choose a Mammobot environment.")
        step = base.settings.control_step_s
        self.hold = max(1, math.ceil(step * FRAME_RATE - 1e-9))
        """Frames for which an action of a controller or policy is held."""
        self.interval = step / self.hold
        """Robot time between two frames [s]."""
        self._env = make_env(self.env_id, {**(options or {}), "control_step_s": self.interval})
        unwrapped = self._env.unwrapped
        assert isinstance(unwrapped, MammobotEnv)  # as the reference is
        self._base = unwrapped
        self.hand = Hand(self._base.drive.limits)
        self.policy_folder: Path | None = None
        self._arms: dict[int, Arm] = {_DUTY_CYCLE: find_controller_arm("duty_cycle")}
        if policy is not None:
            self.load_policy(policy)
        self.seed = 0
        self.options: dict[str, Any] = {}
        self.driver = _HAND
        self.frames: list[Frame] = []
        self._steerer: Policy | None = None
        self._stepped: set[type] = set()

    @property
    def env(self) -> MammobotEnv:
        """The environment."""
        return self._base

    @property
    def drivers(self) -> tuple[str, ...]:
        """Who can drive, of ``DRIVERS``."""
        return DRIVERS if _POLICY in self._arms else DRIVERS[:_POLICY]

    @property
    def ended(self) -> bool:
        """Whether the episode is over."""
        return self.end_reason != ""

    @property
    def end_reason(self) -> str:
        """Why the episode is over; empty while it lasts."""
        return self._base._end_reason if self.frames else ""

    def load_policy(self, folder: Path) -> None:
        """Let a run's latest policy drive from now on where "policy" is asked for.

        Raises:
            RunError: no such run, no checkpoint, or a policy for another environment.
        """
        arm = find_run_arm(folder)
        make_policy(arm, self._reference)  # checks the spaces
        self._arms[_POLICY] = arm
        self.policy_folder = folder

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> Frame:
        """Start an episode, in the hands of a person.

        Args:
            seed: Of place, target and noise; None: the last one.
            options: Of the environment's reset; None: the last ones.

        Raises:
            ConfigError, GeometryError: an unknown option, an impossible value, or a mesh that cannot be used. The
                episode before is then still there.
        """
        new_seed = self.seed if seed is None else seed
        if new_seed < 0:
            raise ConfigError(f"The seed is {new_seed}; it must be 0 or above.")
        new_options = dict(self.options if options is None else options)
        self._observation, info = self._env.reset(seed=new_seed, options=new_options or None)
        if type(self.scene) not in self._stepped:
            # The kernels of a first step are compiled here, where people expect to wait, and not under their hands.
            self._env.step(np.zeros(4, dtype=np.float32))
            self._stepped.add(type(self.scene))
            self._observation, info = self._env.reset(seed=new_seed, options=new_options or None)
        self.seed, self.options = new_seed, new_options
        self._info = info
        self.hand.reset()
        self.driver, self._steerer = _HAND, None
        self._action = self._hand_action()
        self.frames = []
        self.frames.append(self._read(0.0))
        return self.frames[-1]

    @property
    def scene(self) -> Duct | PegField:
        """The place."""
        scene: Duct | PegField = self._base._scene
        return scene

    @property
    def target(self) -> tuple[float, float, float]:
        """Where to go [m]."""
        return self._base._route.target

    @property
    def way(self) -> NDArray[np.float64]:
        """The way to the target from the port [m], shape (k, 3)."""
        return np.array(self._base._start_path())

    @property
    def anatomy(self) -> dict[str, Any]:
        """Name, family, index and target of the place."""
        return dict(self._base._anatomy)

    @property
    def success_distance_mm(self) -> float:
        """Tip error at which the target counts as reached."""
        return self._base.settings.success_distance_mm

    def hand_over(self, driver: str) -> None:
        """Let one of ``DRIVERS`` drive; a hand that takes over finds its sliders where the drives are.

        Raises:
            ConfigError: there is no policy to hand over to.
        """
        number = DRIVERS.index(driver)
        if number == self.driver:
            return
        if number == _HAND:
            drive = self._base.drive
            self.hand.reset()
            self.hand.set(DriveName.PULL, drive.tendon_pull)
            self.hand.set(DriveName.PRESSURE, drive.pressure)
            self._steerer = None
        else:
            if number not in self._arms:
                raise ConfigError("There is no policy to hand over to. Name a run folder: evergym play --policy FOLDER")
            self._steerer = make_policy(self._arms[number], self._reference)
            self._steerer_state: Any = None
            self._held = 0
        self.driver = number

    def step(self) -> Frame:
        """Advance by one interval and return the frame, which is also kept.

        Raises:
            RunError: the episode is over, or there is none yet.
        """
        if not self.frames or self.ended:
            raise RunError("There is no episode to go on with. Reset first.")
        self.hand.let_go()
        self._action = self._hand_action() if self._steerer is None else self._ask()
        self._observation, reward, _, _, self._info = self._env.step(self._action)
        frame = self._read(float(reward))
        self.frames.append(frame)
        return frame

    def commands(self) -> dict[DriveName, float]:
        """Return what the drives are set to by whoever drives, SI units."""
        limits = self._base.drive.limits
        scale = np.array([limits.insertion_velocity, limits.roll_rate, 0.5 * limits.tendon_pull, 0.5 * limits.pressure])
        action = self._action.astype(float) + np.array([0.0, 0.0, 1.0, 1.0])
        return dict(zip(DriveName, (action * scale).tolist(), strict=True))

    def episode(self) -> Episode:
        """Return the episode so far."""
        heading = Heading(
            env=self.env_id.rpartition(":")[2],
            model=self._base.model.name,
            anatomy=str(self.anatomy.get("anatomy", "")),
            interval_s=self.interval,
            seed=self.seed,
            options={
                key: value if isinstance(value, int | float) else str(value) for key, value in self.options.items()
            },
            policy="" if self.policy_folder is None else self.policy_folder.resolve().name,
            end_reason=self.end_reason,
            success_distance_mm=self.success_distance_mm,
        )
        return Episode(heading, self.scene, self.target, self.way, tuple(self.frames))

    def close(self) -> None:
        """Free the environments."""
        self._env.close()
        self._reference.close()

    def _hand_action(self) -> NDArray[np.float32]:
        return self._base.drive.action_for(*(self.hand.value[drive] for drive in DriveName))

    def _ask(self) -> NDArray[np.float32]:
        """Return the action of the controller or policy, asked anew when the last one was held for a control step."""
        assert self._steerer is not None  # step() asks only then
        if self._held == 0:
            start = np.array([self._steerer_state is None])
            action, self._steerer_state = self._steerer.predict(
                self._observation, state=self._steerer_state, episode_start=start, deterministic=True
            )
            self._asked = np.asarray(action, dtype=np.float32)
        self._held = (self._held + 1) % self.hold
        return self._asked

    def _read(self, reward: float) -> Frame:
        """Return the frame of the current state."""
        simulator = self._base._simulator
        assert isinstance(simulator, Simulator)  # reset() made it
        reading, info = self._base._reading, self._info
        commands = self.commands()
        numbers = {name: float(info[name]) for name in COLUMNS if name in info}
        tip, side = reading.tip_position / MM, reading.tendon_side
        values = {
            **numbers,
            "tip_x_mm": float(tip[0]),
            "tip_y_mm": float(tip[1]),
            "tip_z_mm": float(tip[2]),
            "tendon_side_x": float(side[0]),
            "tendon_side_y": float(side[1]),
            "tendon_side_z": float(side[2]),
            "roll_deg": reading.roll / DEG,
            "buckled": float(reading.buckled),
            "burst": float(reading.burst),
            "driver": float(self.driver),
            "command_insertion_mm_s": commands[DriveName.INSERTION] / MM,
            "command_roll_rate_deg_s": commands[DriveName.ROLL] / DEG,
            "command_pull_mm": commands[DriveName.PULL] / MM,
            "command_pressure_kpa": commands[DriveName.PRESSURE] / KPA,
            "reward": reward,
        }
        return Frame(read_pose(simulator), values)
