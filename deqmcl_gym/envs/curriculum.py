"""Curriculum: training that goes on to harder worlds when the robot succeeds in easier ones."""

import json
from collections import deque
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec

from deqmcl_gym.validation import InputError, integer, number

StepResult = tuple[Any, Any, bool, bool, dict[str, Any]]


def made(envs: Sequence[Any], success: float, window: int, **each: Any) -> "Curriculum":
    """Return a curriculum of specs, for ``gym.make``; ``each`` goes to every env."""
    return Curriculum([_made(env, **each) for env in envs], success=success, window=window)


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

    Attributes:
        stage: number of the env in use, from 0.

    Args:
        envs: easiest first, with equal action spaces, and observations of equal shapes.
        success: share, in [0, 1].
        window: episodes, 1 or more.
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
            shown = _both(self.observation_space, env.observation_space)
            unlike = "observation_space" if shown is None else "action_space"
            if shown is None or env.action_space != self.action_space:
                raise InputError(
                    f"stage {place} has the {unlike} {getattr(env, unlike)}, but stage 0 has "
                    f"{getattr(self._envs[0], unlike)}: give envs of equal actions, and "
                    "observations of equal shapes, so with as many beams."
                )
            self.observation_space = shown
        self._success = number("success", success, low=0, high=1)
        self._done: deque[bool] = deque(maxlen=integer("window", window, low=1))
        self.stage = 0
        self._spec = self._of_envs(success, window)

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """What ``gym.make`` makes this of again; None if it cannot."""
        return self._spec

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
        return seen, {**info, "stage": np.array(self.stage)}

    def step(self, action: Any) -> StepResult:
        """Step in the stage's env, and take note of how an episode ends."""
        seen, reward, terminated, truncated, info = self.env.step(action)
        if terminated or truncated:
            self._done.append(bool(info.get("is_success", terminated)))
        return seen, reward, terminated, truncated, {**info, "stage": np.array(self.stage)}

    def close(self) -> None:
        """Close the envs of all stages."""
        for env in self._envs:
            env.close()

    def _of_envs(self, success: float, window: int) -> EnvSpec | None:
        specs = [env.spec for env in self._envs]
        if None in specs:
            return None
        limits = [spec.max_episode_steps or 0 for spec in specs if spec is not None]
        return EnvSpec(
            id="deqmcl_gym/Curriculum-v0",
            entry_point=f"{__name__}:made",
            max_episode_steps=max(limits) if all(limits) else None,
            order_enforce=False,  # as the envs do
            disable_env_checker=True,
            kwargs={"envs": specs, "success": success, "window": window},
        )


def _made(spec: EnvSpec | dict[str, Any], **further: Any) -> gym.Env[Any, Any]:
    """Return the env of a spec, or of one that went through JSON within another."""
    if isinstance(spec, dict):
        derived = "namespace", "name", "version"
        spec = EnvSpec.from_json(json.dumps({k: v for k, v in spec.items() if k not in derived}))
    return gym.make(spec, **further)


def _both(one: gym.Space[Any], other: gym.Space[Any]) -> gym.Space[Any] | None:
    """Return the space of what is in either; None if their shapes differ."""
    if isinstance(one, gym.spaces.Dict) and isinstance(other, gym.spaces.Dict):
        if one.keys() != other.keys():
            return None
        parts = {key: _both(space, other[key]) for key, space in one.items()}
        known = {key: space for key, space in parts.items() if space is not None}
        return gym.spaces.Dict(known) if len(known) == len(parts) else None
    if isinstance(one, gym.spaces.Box) and isinstance(other, gym.spaces.Box):
        if (one.shape, one.dtype) != (other.shape, other.dtype):
            return None
        low, high = np.minimum(one.low, other.low), np.maximum(one.high, other.high)
        return gym.spaces.Box(low, high, dtype=one.dtype.type)
    return one if one == other else None
