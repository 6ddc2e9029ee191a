"""Curriculum: training that goes on to harder worlds when the robot succeeds in easier ones."""

from collections import deque
from collections.abc import Sequence
from typing import Any

import gymnasium as gym

from deqmcl_gym.validation import InputError, integer, number

StepResult = tuple[Any, Any, bool, bool, dict[str, Any]]


class Curriculum(gym.Wrapper[Any, Any, Any, Any]):
    """Runs episodes in the first of several envs, and goes on to the next when enough succeed.

    At a reset it goes on if, since the stage began, ``window`` episodes have ended and at least the
    share ``success`` of the last ``window`` was done: ``info["is_success"]`` of the last step or,
    in an env that does not say, termination. The last stage goes on for ever. ``info["stage"]``
    is the number of the stage, from 0. A reset without a seed that goes on seeds the next env
    from the generator of the last one, so a seed of the first reset determines all episodes.

    Attributes:
        stage: number of the env in use, from 0.

    Args:
        envs: easiest first, with equal spaces.
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
        for place, env in enumerate(self._envs):
            for space in ("observation_space", "action_space"):
                first, own = getattr(self._envs[0], space), getattr(env, space)
                if own != first:
                    raise InputError(
                        f"stage {place} has the {space} {own}, but stage 0 has {first}: give "
                        "envs that differ in neither, so with as many beams of one largest range."
                    )
        self._success = number("success", success, low=0, high=1)
        self._done: deque[bool] = deque(maxlen=integer("window", window, low=1))
        self.stage = 0

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
        return seen, {**info, "stage": self.stage}

    def step(self, action: Any) -> StepResult:
        """Step in the stage's env, and take note of how an episode ends."""
        seen, reward, terminated, truncated, info = self.env.step(action)
        if terminated or truncated:
            self._done.append(bool(info.get("is_success", terminated)))
        return seen, reward, terminated, truncated, {**info, "stage": self.stage}

    def close(self) -> None:
        """Close the envs of all stages."""
        for env in self._envs:
            env.close()
