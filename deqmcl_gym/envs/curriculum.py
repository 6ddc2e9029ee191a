"""Curriculum: training that goes on to harder worlds when the robot succeeds in easier ones."""

from collections import deque
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces.utils import is_space_dtype_shape_equiv

from deqmcl_gym.validation import InputError, integer, number
from deqmcl_gym.world.rules import StepResult


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
            self.observation_space = _both(self.observation_space, env.observation_space)
        self._success = number("success", success, low=0, high=1)
        self._done: deque[bool] = deque(maxlen=integer("window", window, low=1))
        self.stage = 0
        self._specs = [env.spec for env in self._envs]
        self._asked = {"success": success, "window": window}

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """What ``gym.make`` makes this of again; None if an env has none."""
        specs = [spec for spec in self._specs if spec is not None]
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


def _both(one: gym.Space[Any], other: gym.Space[Any]) -> gym.Space[Any]:
    """Return the space of what is in either of two with the same shapes."""
    if isinstance(one, gym.spaces.Dict) and isinstance(other, gym.spaces.Dict):
        return gym.spaces.Dict({key: _both(space, other[key]) for key, space in one.items()})
    if isinstance(one, gym.spaces.Box) and isinstance(other, gym.spaces.Box):
        low, high = np.minimum(one.low, other.low), np.maximum(one.high, other.high)
        return gym.spaces.Box(low, high, dtype=one.dtype.type)
    return one
