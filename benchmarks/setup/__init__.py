"""What a trial is set up from; here what it needs of a world's env, and of the agent in it."""

from typing import Any, Protocol

import gymnasium as gym

from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.numerics import Pose, Reals
from localizers import Belief


class TrialEnv(Protocol):
    """An env that localizers can be tried in.

    Its ``info`` has ``command``, ``planned_actions``, ``planned_count``, ``collided`` and, at every
    step, ``truth``: see ``deqmcl_gym.envs``.
    """

    @property
    def floor_plan(self) -> Map:
        """The map m."""

    @property
    def lidar(self) -> Lidar:
        """The sensor."""

    @property
    def radius(self) -> float:
        """Of the robot's disc."""

    @property
    def expected_start(self) -> Pose:
        """Where the episode begun last was to begin (x, y, θ): what a local prior is around."""

    @property
    def unwrapped(self) -> gym.Env[Any, Any]:
        """The env itself, for ``reset`` and ``step``."""


class Agent(Protocol):
    """Chooses actions.

    Made anew for every episode, by ``AGENT(robot, **params)`` with a ``RobotModel``. The ``info``
    that it gets has, beside what the env shows, the latest scan under ``ranges`` and, in a world
    with a route, its corners (x, y) under ``route``.

    Three attributes are optional. ``sees_truth`` = True: ``info`` has the true pose under
    ``truth``, for authors of plans who see the robot. ``plan_author`` = "own": its plans are made
    from the belief, so they are no evidence; localizers with ``own_plans`` = False are not shown
    them. ``sees_belief`` = False, of the class itself: what it does is the same with every
    localizer, so a sweep lets it drive once in a world, with None as the belief.
    """

    def plan_at_reset(self, info: dict[str, Any]) -> Reals | None:
        """Return the plan that the localizer is reset with, (h, 2); None: the one the env shows."""

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals | None]:
        """Return the next action by the env's latest ``info``, and the plan after it.

        The action is (distance, turn) in the map's unit and rad. The localizer gets the plan,
        (h, 2), with the next scan; None: that which the env then shows.
        """
