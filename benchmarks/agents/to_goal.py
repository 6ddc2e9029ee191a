"""Plans a way to the goal from where the localizer believes the robot is, and follows it."""

import math
from typing import Any

import numpy as np

from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics.types import Reals
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.config import WORLDS
from deqmcl_gym.world.course import Course, Point, Pose
from deqmcl_gym.world.driver import GuidedPlan
from deqmcl_gym.world.route import Journeys
from localizers import Belief, RobotModel, best_cluster

_HORIZON = 100  # actions planned
_STEP = 10.0  # px: 0.2 m
_OFF = 25.0  # px: so far from its way it plans another one
_BACK_OFF = math.radians(120)  # turned on the spot after a contact, before it drives on


class ToGoal:
    """Drives to the env's goal as the env's driver would, on the best cluster of the belief.

    Where it believes to be off its way, or behind a wall from it, it plans another one; from within
    a wall, by the nearest place with a way. After a contact it turns away, left and right in turn,
    and drives two steps. Where it believes to be at the goal it turns on the spot: who is there is
    told so by the end of the episode.

    Attributes:
        goal: where it drives to; None before the start.
        step: see ``Underway``; so are pose, arc and way.
    """

    def __init__(self, robot: RobotModel) -> None:
        self._map, self._px = robot.floor_plan, pixel(robot.floor_plan.unit)
        self._world = WORLDS["paper"].changed(
            floor_plan=robot.floor_plan,
            robot={"radius": robot.radius},
            lap={"step": _STEP * self._px},
            driver={},
            route={},
        )
        self._journeys = Journeys(self._world)
        self._plan: GuidedPlan | None = None
        self._backing: Reals = np.empty((0, 2), np.float32)
        self._side = 1.0
        self.goal: Point | None = None
        self.step, self.arc, self.way = 0, 0.0, 0.0
        self.pose: Pose = (0.0, 0.0, 0.0)

    def plan_at_reset(self, info: dict[str, Any]) -> Reals | None:
        """Return no plan: nothing is believed yet."""
        if "goal" not in info:
            raise InputError("the agent drives to a goal: give a world with a route.")
        self.goal = _point(info["goal"])
        return np.empty((0, 2), np.float32)

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals | None]:
        """Return the next action towards the goal, and those after it."""
        points = belief.points()
        assert points is not None, "a belief has points of the present"
        self.pose = best_cluster(*points, unit=self._map.unit).mean
        if info["collided"]:
            self._back_off()
        ahead = self._backing
        if not len(ahead):
            ahead = self._ahead()
        self._backing = self._backing[1:]
        return ahead[0], ahead[1:]

    def follow(self, course: Course) -> None:
        """Let it follow a course from now on."""
        assert self._world.driver is not None
        self._plan = GuidedPlan.of(self._world, self._world.driver, course, _HORIZON)
        self.arc = 0.0

    def _ahead(self) -> Reals:
        route = self._world.route
        assert self.goal is not None
        assert route is not None
        if math.dist(self.pose[:2], self.goal) > route.tolerance:
            planned, count = self._on_its_way().after(self)
            return planned[:count]
        return np.array([(0.0, self._world.lap.turn)], np.float32)

    def _on_its_way(self) -> GuidedPlan:
        """Find the place on the way; plan another way if there is none."""
        if self._plan is not None:
            path = self._plan.course.path
            self.arc = path.arc(self.pose[:2])
            place = path.at(self.arc)[:2]
            near = math.dist(self.pose[:2], place) <= _OFF * self._px
            if near and not self._map.collides([self.pose], [place], self._world.body)[0]:
                return self._plan
        assert self.goal is not None
        self.follow(self._journeys.onwards(self.goal, self.pose))
        assert self._plan is not None
        return self._plan

    def _back_off(self) -> None:
        turn, step = self._world.lap.turn, self._world.lap.step
        turns = [(0.0, self._side * turn)] * round(_BACK_OFF / turn)
        self._backing = np.array([*turns, (step, 0.0), (step, 0.0)], np.float32)
        self._side = -self._side


def _point(place: Reals) -> Point:
    x, y = place.tolist()
    return x, y


AGENT = ToGoal
