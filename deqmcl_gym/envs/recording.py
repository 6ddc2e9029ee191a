"""RecordLog: a wrapper that keeps the episode as a log."""

from typing import Any, SupportsFloat

import gymnasium as gym

from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.logs import Log
from deqmcl_gym.numerics.types import Singles
from deqmcl_gym.validation import InputError, number, shown


class RecordLog(gym.Wrapper[Singles, Singles, Singles, Singles], gym.utils.RecordConstructorArgs):
    """Keep what the robot saw and was told since reset, as ``log``.

    Args:
        env: deqmcl_gym's, or wrappers around one: what they do to scans is recorded.
        step: how long a step takes, s.
        truth: whether the true poses are the log's reference.
    """

    def __init__(
        self, env: gym.Env[Singles, Singles], step: float = 1.0, truth: bool = True
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, step=step, truth=truth)
        super().__init__(env)
        if not isinstance(env.observation_space, gym.spaces.Box):
            raise InputError(
                f"the env's observations are {shown(env.observation_space)}, but a log keeps "
                'scans: give an env of observation="scan".'
            )
        self._seconds, self._truth = number("step", step, low=0, above=True), truth
        self._scans: list[Singles] = []
        self._infos: list[dict[str, Any]] = []

    @property
    def log(self) -> Log:
        """The log of the episode so far; its odometry is what the robot was told.

        Raises:
            RuntimeError: there is no episode.
        """
        if not self._scans:
            raise RuntimeError("the episode has not begun: call reset() first.")
        room: Any = self.unwrapped
        nowhere = (float("nan"),) * 3
        return Log.of_episode(
            self._scans,
            [info["action"] for info in self._infos[1:]],
            [info.get("truth", nowhere) for info in self._infos] if self._truth else None,
            room.lidar,
            unit=room.log.unit if isinstance(room, LogEnv) else room.floor_plan.unit,
            step=self._seconds,
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Singles, dict[str, Any]]:
        """Reset, and begin a new log."""
        scan, info = self.env.reset(seed=seed, options=options)
        self._scans, self._infos = [scan.copy()], [info.copy()]
        return scan, info

    def step(self, action: Singles) -> tuple[Singles, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step, and keep what came of it."""
        said = self.env.step(action)
        self._scans.append(said[0].copy())
        self._infos.append(said[4].copy())
        return said
