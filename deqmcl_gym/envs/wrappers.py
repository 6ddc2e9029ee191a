"""Disturbances, one wrapper each: kidnapping, beam drop-out, a change of plan."""

from collections.abc import Iterator
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym import validation
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.numerics.types import Singles
from deqmcl_gym.validation import InputError, integer, number
from deqmcl_gym.world.path import Pose
from deqmcl_gym.world.streams import Stream

Action = Singles
StepResult = tuple[Singles, SupportsFloat, bool, bool, dict[str, Any]]


class Kidnap(gym.Wrapper[Singles, Action, Singles, Action], gym.utils.RecordConstructorArgs):
    """Carry the robot elsewhere just before it takes a step; only its scans can tell.

    Args:
        env: a RoomEnv, or wrappers around one.
        step: before which step, from 1.
        pose: where to (x, y, θ); None draws a free pose anew in each episode.
    """

    def __init__(self, env: gym.Env[Singles, Action], step: int, pose: Pose | None = None) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, step=step, pose=pose)
        super().__init__(env)
        self._room = _room(env)
        self._step = integer("step", step, low=1)
        self._pose = None if pose is None else self._room.checked_pose("the pose", pose)
        self._twin = sum(isinstance(layer, Kidnap) and layer.draws for layer in _layers(env))

    @property
    def draws(self) -> bool:
        """Whether the pose is random."""
        return self._pose is None

    def step(self, action: Action) -> StepResult:
        """Kidnap if it is time, then step."""
        if self._room.elapsed_steps + 1 == self._step:
            self._room.place(self._drawn_pose() if self._pose is None else self._pose)
        return self.env.step(action)

    def _drawn_pose(self) -> Pose:
        rng = self._room.stream(Stream.KIDNAP, self._twin)
        x0, y0, x1, y1 = self._room.floor_plan.bounds
        while True:  # a floor plan has free space, and the robot stands in some of it
            x, y = rng.uniform((x0, y0), (x1, y1)).tolist()
            if self._room.floor_plan.free([(x, y)], self._room.world.robot.radius)[0]:
                return x, y, float(rng.uniform(-np.pi, np.pi))


class BeamDropout(gym.Wrapper[Singles, Action, Singles, Action], gym.utils.RecordConstructorArgs):
    """Lose single beams: each reads +inf ("no return", as in ROS REP 117) with some probability.

    Args:
        env: a RoomEnv, or wrappers around one.
        probability: of each beam in each scan, in [0, 1].
    """

    def __init__(self, env: gym.Env[Singles, Action], probability: float) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, probability=probability)
        super().__init__(env)
        self._room = _room(env)
        self._probability = number("probability", probability, low=0, high=1)
        self._twin = sum(isinstance(layer, BeamDropout) for layer in _layers(env))
        self.observation_space = gym.spaces.Box(0.0, np.inf, (self._room.lidar.beams,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Singles, dict[str, Any]]:
        """Reset, and lose beams of the first scan."""
        scan, info = self.env.reset(seed=seed, options=options)
        self._rng = self._room.stream(Stream.DROPOUT, self._twin)
        return self._thinned(scan), info

    def step(self, action: Action) -> StepResult:
        """Step, and lose beams of the scan."""
        scan, reward, terminated, truncated, info = self.env.step(action)
        return self._thinned(scan), reward, terminated, truncated, info

    def _thinned(self, scan: Singles) -> Singles:
        lost = self._rng.random(scan.shape) < self._probability
        return np.where(lost, np.float32(np.inf), scan)


class PlanChange(gym.Wrapper[Singles, Action, Singles, Action], gym.utils.RecordConstructorArgs):
    """Replace the rest of the plan: after a given step, other actions are planned.

    Args:
        env: a RoomEnv, or wrappers around one.
        step: after which step the new plan is shown and begins, from 1.
        actions: (distance, turn), (k, 2); may be empty, which ends the episode there.
    """

    def __init__(self, env: gym.Env[Singles, Action], step: int, actions: ArrayLike) -> None:
        given = validation.actions("actions", actions)
        gym.utils.RecordConstructorArgs.__init__(self, step=step, actions=given.tolist())
        super().__init__(env)
        self._room = _room(env)
        self._step = integer("step", step, low=1)
        self._actions = self._room.checked_plan("actions", given)

    def step(self, action: Action) -> StepResult:
        """Change the plan if it is time, then step."""
        if self._room.elapsed_steps + 1 == self._step:
            self._room.replace_plan(self._actions)
        return self.env.step(action)


def _room(env: gym.Env[Singles, Action]) -> RoomEnv:
    room = env.unwrapped
    if not isinstance(room, RoomEnv):
        raise InputError(f"the env is {room!r}, but this wrapper needs deqmcl_gym/Room-v0.")
    return room


def _layers(env: gym.Env[Any, Any]) -> Iterator[gym.Env[Any, Any]]:
    """Every wrapper of an env, from the outermost, then the env itself."""
    while isinstance(env, gym.Wrapper):
        yield env
        env = env.env
    yield env
