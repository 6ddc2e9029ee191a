"""Who drives, by name: each of ``AGENTS`` is called with a ``RobotModel`` and gives an ``Agent``.

The first line of each is what ``deqmcl list`` says of it.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from benchmarks import policies
from benchmarks.setup import Agent
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import Point, Pose, Reals
from deqmcl_gym.validation import InputError, number
from deqmcl_gym.world import WORLDS, Driver, Route, World
from deqmcl_gym.world.course import Course
from deqmcl_gym.world.driver import NO_PLAN, GuidedPlan, Underway
from deqmcl_gym.world.route import Journeys
from localizers import Belief, RobotModel, best_cluster, mean_pose

_LAP_HORIZON, _HORIZON = 40, 100  # actions planned on the estimate, of a lap and to a goal
_STEP = 10.0  # px: 0.2 m
_OFF = 25.0  # px: so far from its way a robot plans another one
_LOOK_ROUND = np.array([0.0, math.radians(15)], np.float32)  # where nothing is believed
_BACK_OFF = math.radians(120)  # turned on the spot after a contact, before it drives on


class OpenLoop:
    """Carries out the plan that the env shows, whatever the belief."""

    sees_belief = False

    def __init__(self, robot: RobotModel) -> None:
        del robot

    def plan_at_reset(self, info: dict[str, Any]) -> Reals | None:
        return None

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals | None]:
        return info["planned_actions"][0], None


class Stale(OpenLoop):
    """The plan that the env shows is carried out; the localizer is shown that of another start.

    It is an eighth of the plan ahead.
    """

    sees_belief = False

    def plan_at_reset(self, info: dict[str, Any]) -> Reals:
        planned = info["planned_actions"][: info["planned_count"]]
        self._rest: Reals = np.roll(planned, -(len(planned) // 8), axis=0)
        return self._rest

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals | None]:
        self._rest = self._rest[1:]
        return info["planned_actions"][0], self._rest


class Misplaced(OpenLoop):
    """The plan that the env shows is carried out; the localizer is shown one from a wrong pose.

    Its author sees the robot shifted (in the map's unit) in a direction of the lap and turned (rad)
    left or right by constant errors, and plans at every step as the driver of ``guided`` does.
    """

    sees_belief = False
    sees_truth = True

    def __init__(self, robot: RobotModel, *, shift: float = 0.0, turn: float = 0.0) -> None:
        self._shift, self._turn = number("shift", shift, low=0), number("turn", turn, low=0)
        self._plan = _lap(robot)

    def plan_at_reset(self, info: dict[str, Any]) -> Reals:
        if not np.isfinite(info["truth"]).all():
            raise InputError("the agent must see the true pose: give a world that tells it.")
        seed = np.abs(np.rint(1e6 * info["truth"])).astype(np.int64)
        direction, side = np.random.default_rng(seed).random(2)
        angle, turn = 2 * math.pi * direction, self._turn if side < 0.5 else -self._turn
        off = self._shift * math.cos(angle), self._shift * math.sin(angle)
        self._error = np.array([*off, turn])
        return self._seen_from(info["truth"])

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals | None]:
        return info["planned_actions"][0], self._seen_from(info["truth"])[1:]

    def _seen_from(self, truth: Reals) -> Reals:
        x, y, heading = (truth + self._error).tolist()
        return _ahead_of(self._plan, (x, y, heading))


class OldRoute(OpenLoop):
    """The plan that the env shows is carried out; the localizer is shown that of the first route.

    Once there is another route, what is left of it, counted off as if it were carried out.
    """

    sees_belief = False

    def plan_at_reset(self, info: dict[str, Any]) -> None:
        self._route = _routed(info)

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals | None]:
        if np.array_equal(info["route"], self._route):
            self._shown: Reals = info["planned_actions"][: info["planned_count"]]
        self._shown = self._shown[1:]
        return info["planned_actions"][0], self._shown


class OtherRoute(Stale):
    """The plan that the env shows is carried out; the localizer is shown that of another robot."""

    sees_belief = False

    def __init__(self, robot: RobotModel) -> None:
        self._world = _in_the_building(robot)

    def plan_at_reset(self, info: dict[str, Any]) -> Reals:
        seed = np.abs(np.rint(1e3 * np.array(_routed(info)))).astype(np.int64).ravel()
        corners = Journeys(self._world).between(None, np.random.default_rng(seed))
        self._rest = Course.along(corners, (*corners[0].tolist(), 0.0), self._world).actions
        return self._rest


class OnEstimate:
    """Drives the lap, and plans it, from where the localizer believes the robot is.

    The driver of ``guided``, on the mean of the belief instead of the true pose.
    """

    plan_author = "own"

    def __init__(self, robot: RobotModel) -> None:
        self._plan = _lap(robot)

    def plan_at_reset(self, info: dict[str, Any]) -> Reals:
        return NO_PLAN

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals | None]:
        if (seen := policies.points_of(belief)) is None:
            return _LOOK_ROUND, None
        planned = _ahead_of(self._plan, mean_pose(*seen), least=1)
        return planned[0], planned[1:]


class ToGoal:
    """Plans a way to the goal from where the localizer believes the robot is, and follows it.

    It drives as the env's driver would, on the best cluster of the belief. Off its way, or behind a
    wall from it, it plans another one, from within a wall by the nearest place with a way. After a
    contact it turns away, left and right in turn, for two steps; at the goal it turns on the spot.
    """

    plan_author = "own"

    def __init__(self, robot: RobotModel) -> None:
        self._map, self._off = robot.floor_plan, _OFF * pixel(robot.floor_plan.unit)
        self._world = _in_the_building(robot)
        self._tolerance = (self._world.route or Route()).tolerance
        self._journeys = Journeys(self._world)
        self._plan: GuidedPlan | None = None
        self._backing: Reals = NO_PLAN
        self._side = 1.0
        self._goal: Point = (math.nan, math.nan)

    def plan_at_reset(self, info: dict[str, Any]) -> Reals | None:
        self._goal = tuple(_routed(info, "goal").tolist())
        return NO_PLAN

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals | None]:
        if (seen := policies.points_of(belief)) is None:
            return _LOOK_ROUND, None
        pose = best_cluster(*seen, unit=self._map.unit).mean
        if info["collided"]:
            turn, step = self._world.lap.turn, self._world.lap.step
            turns = [(0.0, self._side * turn)] * round(_BACK_OFF / turn)
            self._backing = np.array([*turns, (step, 0.0), (step, 0.0)], np.float32)
            self._side = -self._side
        if len(self._backing):
            ahead, self._backing = self._backing, self._backing[1:]
        elif math.dist(pose[:2], self._goal) > self._tolerance:
            ahead = self._on_its_way(pose)
        else:
            ahead = np.array([(0.0, self._world.lap.turn)], np.float32)
        return ahead[0], ahead[1:]

    def follow(self, course: Course) -> GuidedPlan:
        """Let it follow a course from now on."""
        self._plan = GuidedPlan.of(self._world, self._world.driver or Driver(), course, _HORIZON)
        return self._plan

    def _on_its_way(self, pose: Pose) -> Reals:
        """Return the actions from the place on the way; of another way if there is none."""
        plan, arc = self._plan, 0.0
        if plan is not None:
            arc = plan.course.path.arc(pose[:2])
            place = plan.course.path.at(arc)[:2]
            near = math.dist(pose[:2], place) <= self._off
            if not near or self._map.collides([pose], [place], self._world.body)[0]:
                plan, arc = None, 0.0
        plan = plan or self.follow(self._journeys.onwards(self._goal, pose))
        planned, count = plan.after(Underway(0, pose, arc, 0.0))
        return planned[:count]


class Dispatched(ToGoal):
    """Is driven along a route to a random place by one who sees where it is, then along another."""

    sees_belief = False
    sees_truth = True

    def plan_at_reset(self, info: dict[str, Any]) -> Reals:
        self._rng = policies.rng_of(info)
        return NO_PLAN

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals]:
        x, y, heading = np.asarray(info["truth"]).tolist()
        if not math.dist(self._goal, (x, y)) > self._tolerance:  # also if there is no goal yet
            goal_x, goal_y = self._journeys.between(None, self._rng)[-1].tolist()
            self._goal, self._plan = (goal_x, goal_y), None
        return self._on_its_way((x, y, heading))[0], NO_PLAN


class OnRoute(ToGoal):
    """Follows the dispatcher's route as shown at reset, on the localizer's estimate.

    Off it, it plans its own way to the goal. After the reset the localizer is told these plans.
    """

    def plan_at_reset(self, info: dict[str, Any]) -> None:
        super().plan_at_reset(info)
        corners = np.array(info["route"])
        self.follow(Course.along(corners, (*corners[0].tolist(), 0.0), self._world))


def _lap(robot: RobotModel) -> GuidedPlan:
    """Plan the lap in mid-corridor of the robot's map, as the driver of ``guided`` does."""
    world = WORLDS["guided"].changed(floor_plan=robot.floor_plan, robot={"radius": robot.radius})
    return GuidedPlan.of(world, world.driver or Driver(), Course.of(world), _LAP_HORIZON)


def _ahead_of(plan: GuidedPlan, pose: Pose, least: int = 0) -> Reals:
    """Return the actions planned from a pose near its course."""
    arc = plan.course.path.arc(pose[:2])
    planned, count = plan.after(Underway(0, pose, arc, 0.0))
    return planned[: max(count, least)]


def _routed(info: dict[str, Any], what: str = "route") -> Any:
    if what not in info:
        raise InputError(f"the agent needs a {what}: give a world with a route.")
    return info[what]


def _in_the_building(robot: RobotModel) -> World:
    """The world of a robot that plans routes on its map."""
    return WORLDS["paper"].changed(
        floor_plan=robot.floor_plan,
        robot={"radius": robot.radius},
        lap={"step": _STEP * pixel(robot.floor_plan.unit)},
        driver={},
        route={},
    )


AGENTS: Mapping[str, Callable[..., Agent]] = {
    "open-loop": OpenLoop,
    "stale": Stale,
    "misplaced": Misplaced,
    "old-route": OldRoute,
    "other-route": OtherRoute,
    "on-estimate": OnEstimate,
    "to-goal": ToGoal,
    "on-route": OnRoute,
    "route": Dispatched,
    "still": policies.Still,
    "spin": policies.Spin,
    "random": policies.RandomWalk,
    "wall-follower": policies.WallFollower,
    "greedy": policies.LookAhead,
    "four-deep": policies.four_deep,
    "free-energy": policies.FreeEnergy,
}
