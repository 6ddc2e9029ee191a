"""RecordLog: a wrapper that records the episode as a log."""

from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np

from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.logs import Log
from deqmcl_gym.maps import Lidar
from deqmcl_gym.numerics.types import Floats, Singles
from deqmcl_gym.validation import InputError, boolean, number, shown


class RecordLog(gym.Wrapper[Singles, Singles, Singles, Singles], gym.utils.RecordConstructorArgs):
    """Record scans and actions since reset, as ``log``.

    Args:
        env: one of deqmcl_gym's, or one in wrappers; scans are recorded as these change them.
        step: duration of a step, s.
        truth: whether to record the true poses, as the log's reference.
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
        """The log of the episode so far; its odometry is dead reckoning of the commands.

        Raises:
            RuntimeError: the episode has not begun.
        """
        if not self._scans:
            raise RuntimeError("the episode has not begun: call reset() first.")
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

    def step(self, action: Singles) -> tuple[Singles, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step, and record the result."""
        said = self.env.step(action)
        self._scans.append(said[0].copy())
        self._actions.append(said[4]["action"].copy())
        self._poses.append(_truth(said[4]))
        return said


def _truth(info: dict[str, Any]) -> Floats:
    """A copy of the true pose, NaN where there is none."""
    return np.array(info.get("truth", (np.nan,) * 3))
