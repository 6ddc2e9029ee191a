"""Wrappers: what disturbs a room, what records it, and a curriculum of several envs."""

from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces.utils import is_space_dtype_shape_equiv
from numpy.typing import ArrayLike

from deqmcl_gym.envs import RoomEnv
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.logs import Log
from deqmcl_gym.maps import Lidar
from deqmcl_gym.numerics import Floats, Pose, Singles
from deqmcl_gym.validation import InputError, NoEpisodeError, boolean, integer, number, shown
from deqmcl_gym.world import Stream
from deqmcl_gym.world.rules import StepResult, scan_space


class _Once(gym.Wrapper[Singles, Singles, Singles, Singles], gym.utils.RecordConstructorArgs):
    """Something that happens at one step of every episode; a warning if one ends before."""

    what: str

    def __init__(self, env: gym.Env[Singles, Singles], step: int, **arguments: Any) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, step=step, **arguments)
        super().__init__(env)
        self.room = room_of(env)
        self.due = integer("step", step, low=1)

    def step(self, action: Singles) -> StepResult:
        """Let it happen if it is time, then step; neither if the action is refused."""
        if self.room.elapsed_steps + 1 == self.due:
            self.room.before_step[self] = self.happen
        result = self.env.step(action)
        if (result[2] or result[3]) and self.room.elapsed_steps < self.due:
            gym.logger.warn(
                f"{self.what} was due at step {self.due}, but the episode ended after "
                f"{self.room.elapsed_steps} steps."
            )
        return result

    def happen(self) -> None:
        """Change the room."""
        raise NotImplementedError


class Kidnap(_Once):
    """Carry the robot elsewhere just before a step, from 1; only its scans reveal it.

    Without a pose, a free one is drawn in each episode;
    in a world with a route, as the start of a route to the goal is drawn. Unless it is ``noticed``,
    the plan of a driver stays as it was.
    """

    what = "the kidnapping"

    def __init__(
        self,
        env: gym.Env[Singles, Singles],
        step: int,
        pose: Pose | None = None,
        noticed: bool = True,
    ) -> None:
        super().__init__(env, step, pose=pose, noticed=noticed)
        self._noticed = boolean("noticed", noticed)
        self._pose = None if pose is None else self.room.checked_pose("the pose", pose)
        self._twin = sum(
            isinstance(layer, Kidnap) and layer._pose is None for layer in _layers(env)
        )

    def happen(self) -> None:
        """Carry the robot away."""
        pose = self._pose
        if pose is None:
            pose = self.room.elsewhere(self.room.stream(Stream.KIDNAP, self._twin))
        self.room.place(pose, self._noticed)


class BeamDropout(gym.Wrapper[Singles, Singles, Singles, Singles], gym.utils.RecordConstructorArgs):
    """Lose single beams: each reads +inf ("no return", as in ROS REP 117) with some probability."""

    def __init__(self, env: gym.Env[Singles, Singles], probability: float) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, probability=probability)
        super().__init__(env)
        self._room = room_of(env)
        self._probability = number("probability", probability, low=0, high=1)
        lidar = self._room.lidar
        lossy = gym.spaces.Box(0.0, np.inf, (lidar.beams,), np.float32)
        if env.observation_space not in (scan_space(lidar), lossy):
            raise InputError(
                f"the env's observations are {shown(env.observation_space)}, but beams are lost "
                "from scans: put BeamDropout inside the wrapper that changes the observation, "
                'around an env of observation="scan".'
            )
        self._twin = sum(isinstance(layer, BeamDropout) for layer in _layers(env))
        self.observation_space = lossy

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Singles, dict[str, Any]]:
        """Reset, and lose beams of the first scan."""
        scan, info = self.env.reset(seed=seed, options=options)
        self._rng = self._room.stream(Stream.DROPOUT, self._twin)
        return self._thinned(scan), info

    def step(self, action: Singles) -> StepResult:
        """Step, and lose beams of the scan."""
        scan, reward, terminated, truncated, info = self.env.step(action)
        return self._thinned(scan), reward, terminated, truncated, info

    def _thinned(self, scan: Singles) -> Singles:
        lost = self._rng.random(scan.shape) < self._probability
        return np.where(lost, np.float32(np.inf), scan)


class PlanChange(_Once):
    """Replace the rest of the plan, after a step from 1, by other actions (distance, turn), (k, 2).

    There may be none, which ends the episode there.
    """

    what = "the change of plan"

    def __init__(self, env: gym.Env[Singles, Singles], step: int, actions: ArrayLike) -> None:
        self._actions = room_of(env).checked_plan("actions", actions)
        super().__init__(env, step, actions=np.asarray(actions, np.float64).tolist())

    def happen(self) -> None:
        """Change the plan."""
        self.room.replace_plan(self._actions)


def room_of(env: gym.Env[Any, Singles]) -> RoomEnv:
    """Return the room inside the wrappers of an env, else refuse it."""
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


class RecordLog(gym.Wrapper[Singles, Singles, Singles, Singles], gym.utils.RecordConstructorArgs):
    """Record scans and actions since reset, as ``log``; scans as the wrappers within change them.

    A step takes ``step`` s; with ``truth``, the true poses are the log's reference.
    """

    def __init__(
        self, env: gym.Env[Singles, Singles], step: float = 1.0, truth: bool = True
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, step=step, truth=truth)
        super().__init__(env)
        lidar = getattr(env.unwrapped, "lidar", None)
        if not isinstance(lidar, Lidar) or env.observation_space.shape != (lidar.beams,):
            raise InputError(
                f"the env's observations are {shown(env.observation_space)}, but a log keeps the "
                'scans of deqmcl_gym\'s envs: give one of observation="scan", and put RecordLog '
                "inside wrappers that change the shape of scans."
            )
        self._seconds = number("step", step, low=0, above=True)
        self._truth = boolean("truth", truth)
        self._scans: list[Singles] = []
        self._actions: list[Singles] = []
        self._poses: list[Floats] = []

    @property
    def log(self) -> Log:
        """The log of the episode so far; its odometry is dead reckoning of the commands."""
        if not self._scans:
            raise NoEpisodeError
        room: Any = self.unwrapped
        return Log.of_episode(
            self._scans,
            self._actions,
            self._poses if self._truth else None,
            room.lidar,
            unit=room.log.unit if isinstance(room, LogEnv) else room.floor_plan.unit,
            step=self._seconds,
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Singles, dict[str, Any]]:
        """Reset, and begin a new log."""
        scan, info = self.env.reset(seed=seed, options=options)
        self._scans, self._actions, self._poses = [scan.copy()], [], [_truth(info)]
        return scan, info

    def step(self, action: Singles) -> StepResult:
        """Step, and record the result."""
        result = self.env.step(action)
        self._scans.append(result[0].copy())
        self._actions.append(result[4]["command"].copy())
        self._poses.append(_truth(result[4]))
        return result


def _truth(info: dict[str, Any]) -> Floats:
    """A copy of the true pose, NaN where there is none."""
    truth = np.array(info.get("truth", (np.nan,) * 3))
    return np.where(np.isfinite(truth), truth, np.nan)


def made(envs: Sequence[str], success: float, window: int, **each: Any) -> "Curriculum":
    """Return a curriculum of specs in JSON, for ``gym.make``; ``each`` goes to every env."""
    stages = [gym.make(EnvSpec.from_json(spec), **each) for spec in envs]
    return Curriculum(stages, success=success, window=window)


class Curriculum(gym.Wrapper[Any, Any, Any, Any]):
    """Runs episodes in the first of several envs, and goes on to the next when enough succeed.

    At a reset it goes on if, since the stage began, ``window`` episodes have ended and at least the
    share ``success`` of the last ``window`` was done: ``info["is_success"]`` of the last step or,
    in an env that does not say, termination. The last stage goes on for ever. ``info["stage"]``
    is the number of the stage, from 0. A reset without a seed that goes on seeds the next env
    from the generator of the last one, so a seed of the first reset determines all episodes.

    Action space, which a seed may have, and observation space are the same objects in all stages;
    the bounds of the latter hold in each. Where all envs have a spec, ``gym.make(curriculum.spec)``
    makes the same again.

    Envs are given easiest first, with equal action spaces, and observations of equal shapes.
    """

    def __init__(
        self, envs: Sequence[gym.Env[Any, Any]], *, success: float = 0.8, window: int = 50
    ) -> None:
        self._envs = tuple(envs)
        if not self._envs:
            raise InputError("envs is empty, but a curriculum needs one env or more.")
        super().__init__(self._envs[0])
        self.action_space = self._envs[0].action_space
        self.observation_space = self._envs[0].observation_space
        for place, env in enumerate(self._envs):
            alike = is_space_dtype_shape_equiv(self.observation_space, env.observation_space)
            unlike = "action_space" if alike else "observation_space"
            if not alike or env.action_space != self.action_space:
                raise InputError(
                    f"stage {place} has the {unlike} {getattr(env, unlike)}, but stage 0 has "
                    f"{getattr(self._envs[0], unlike)}: give envs of equal actions, and "
                    "observations of equal shapes, so with as many beams."
                )
            self.observation_space = _union(self.observation_space, env.observation_space)
        self._success = number("success", success, low=0, high=1)
        self._done: deque[bool] = deque(maxlen=integer("window", window, low=1))
        self.stage = 0
        self._asked = {"success": success, "window": window}

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """What ``gym.make`` makes this of again; None if an env has none."""
        specs = [env.spec for env in self._envs if env.spec is not None]
        if len(specs) < len(self._envs):
            return None
        limits = [spec.max_episode_steps or 0 for spec in specs]
        stages = {"envs": [spec.to_json() for spec in specs], **self._asked}
        return EnvSpec(
            id="deqmcl_gym/Curriculum-v0", entry_point=f"{__name__}:made", kwargs=stages,
            max_episode_steps=max(limits) if all(limits) else None,
            order_enforce=False, disable_env_checker=True,  # the envs do both
        )  # fmt: skip

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode, in the next stage if enough were done in this one."""
        done = self._done
        enough = len(done) == done.maxlen and sum(done) >= self._success * len(done)
        if enough and self.stage + 1 < len(self._envs):
            if seed is None:
                seed = int(self.env.unwrapped.np_random.integers(2**31))
            self.stage += 1
            self.env = self._envs[self.stage]
            done.clear()
        seen, info = self.env.reset(seed=seed, options=options)
        return seen, {**info, "stage": np.int64(self.stage)}

    def step(self, action: Any) -> StepResult:
        """Step in the stage's env, and take note of how an episode ends."""
        seen, reward, terminated, truncated, info = self.env.step(action)
        if terminated or truncated:
            self._done.append(bool(info.get("is_success", terminated)))
        return seen, reward, terminated, truncated, {**info, "stage": np.int64(self.stage)}

    def close(self) -> None:
        """Close the envs of all stages."""
        for env in self._envs:
            env.close()


def _union(first: gym.Space[Any], second: gym.Space[Any]) -> gym.Space[Any]:
    """Return the space of what is in either of two with the same shapes."""
    if isinstance(first, gym.spaces.Dict) and isinstance(second, gym.spaces.Dict):
        return gym.spaces.Dict({key: _union(space, second[key]) for key, space in first.items()})
    if isinstance(first, gym.spaces.Box) and isinstance(second, gym.spaces.Box):
        low, high = np.minimum(first.low, second.low), np.maximum(first.high, second.high)
        return gym.spaces.Box(low, high, dtype=first.dtype.type)
    return first
