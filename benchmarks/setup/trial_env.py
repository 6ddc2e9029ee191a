"""What a trial needs of an env, be it a room or a recorded log."""

from typing import Any, Protocol

import gymnasium as gym

from deqmcl_gym.maps import Lidar, Map

Pose = tuple[float, float, float]


class TrialEnv(Protocol):
    """An env that localizers can be tried in.

    Its ``info`` has ``action``, ``planned_actions``, ``planned_count``, ``collided`` and, at every
    step, ``truth``: see ``deqmcl_gym.envs.room``.
    """

    @property
    def floor_plan(self) -> Map:
        """The map m."""
        ...

    @property
    def lidar(self) -> Lidar:
        """The sensor."""
        ...

    @property
    def radius(self) -> float:
        """Of the robot's disc."""
        ...

    @property
    def expected_start(self) -> Pose:
        """Where the episode begun last was to begin (x, y, θ): what a local prior is around."""
        ...

    @property
    def unwrapped(self) -> gym.Env[Any, Any]:
        """The env itself, for ``reset`` and ``step``."""
        ...
