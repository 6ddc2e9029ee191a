"""Plans, the next actions in a window of fixed size: fixed, or of a driver that sees the robot."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from deqmcl_gym.maps import GridMap, Map
from deqmcl_gym.numerics import Bools, Floats, Indices, Pose, RoomActions, arrays
from deqmcl_gym.validation import InputError
from deqmcl_gym.world import Driver, World
from deqmcl_gym.world import path_kernels as kernels
from deqmcl_gym.world.course import MAX_STEPS, Course

NO_PLAN = np.empty((0, 2), np.float32)  # of one who shows nothing of what is to come


class Underway(NamedTuple):
    """The state of an episode that a plan depends on."""

    step: int  # steps carried out
    pose: Pose  # the true pose (x, y, θ)
    arc: float  # arc length at which the robot is on the path
    way: float  # distance along the path since reset; the shorter way if it was carried


@dataclass(frozen=True)
class FixedPlan:
    """A plan made beforehand, which does not depend on what happens.

    Action t is that of step t + 1 after ``begun``.
    """

    actions: RoomActions  # (distance, turn), (T, 2) float32
    horizon: int  # h, actions shown ahead
    begun: int = 0  # step of the episode after which it begins

    @cached_property
    def limit(self) -> int:
        """The last step."""
        return self.begun + len(self.actions)

    def after(self, underway: Underway) -> tuple[RoomActions, int]:
        """Return the next h actions, zero-padded, fresh (h, 2), and their number; 0: it ends."""
        step = underway.step - self.begun
        return self._windows[step].copy(), int(self._counts[step])

    def after_each(self, steps: Indices) -> tuple[RoomActions, Indices]:
        """Return the results of :meth:`after` for each of ``steps`` (n,): (n, h, 2) and (n,)."""
        return self._windows[steps], self._counts[steps]

    def replaced(self, step: int, actions: RoomActions) -> "FixedPlan":
        """Return the plan in which ``actions`` (k, 2) follow ``step`` steps of this one."""
        past = self.actions[: step - self.begun]
        return FixedPlan(np.vstack([past, actions]), self.horizon, self.begun)

    @cached_property
    def _windows(self) -> RoomActions:
        """Row t has the actions after step t, (T + 1, h, 2); a view."""
        padded = np.vstack([self.actions, np.zeros((self.horizon, 2), np.float32)])
        windows = np.lib.stride_tricks.sliding_window_view(padded, self.horizon, axis=0)
        return windows.transpose(0, 2, 1)

    @cached_property
    def _counts(self) -> Indices:
        """Number of actions in row t of the windows, (T + 1,)."""
        return np.minimum(self.horizon, np.arange(len(self.actions), -1, -1))


_LAPS = 2  # what the driver may take, in steps of the lap as planned


@dataclass(frozen=True)
class GuidedPlan:
    """What a driver would do from the true pose if there were no noise and no walls.

    The driver heads for the point of the path ``look_ahead`` beyond the one nearest to it. It is
    done when it is, along the path, once round but for the robot's radius; on an open path, when
    it is as near to the end as the world's route demands. Noise can bring it off the path, not past
    that end. Where walls hold it up it gives up, after ``limit`` steps.

    Routes lead round corners and through doors, which a long look-ahead cuts. On them it is the
    longest of a few with which all of the way that is left is free of walls, with half the room
    that the robot has, but at most half the route's clearance, for noise. If there is none, the
    driver goes straight back to the route first; if that is not free either, he does what takes the
    robot farthest.
    """

    world: World
    course: Course
    rules: tuple[float, float, float, float, float, float]  # as ``drive_along`` takes them
    horizon: int  # h, actions shown ahead
    limit: int  # the most steps of an episode

    @classmethod
    def of(
        cls, world: World, driver: Driver, course: Course, horizon: int | None, begun: int = 0
    ) -> "GuidedPlan":
        """Let ``driver`` drive the course after step ``begun``; without a horizon, all is shown."""
        lap, limit = world.lap, min(begun + _LAPS * len(course.actions), MAX_STEPS)
        end, near = kernels.once_round(course.path.length, world.robot.radius), -1.0
        if world.route is not None:
            end, near = math.inf, world.route.tolerance
        rules = driver.look_ahead, driver.on_the_spot, lap.step, lap.turn, end, near
        plan = cls(world, course, rules, limit if horizon is None else horizon, limit)
        if world.route is not None:
            return plan
        wish = "give another driver.look_ahead, or other lap.waypoints."
        if len(plan.actions) == limit:
            raise InputError(
                f"the driver does not complete the lap in {limit:,} steps, even without noise: "
                f"{wish}"
            )
        blocked = _blocked(course.start, plan.actions, world.floor_plan, world.body)
        if blocked.any():
            x, y = points_of(course.start, plan.actions)[blocked.argmax()]
            raise InputError(
                f"the driver meets a wall near ({x:g}, {y:g}), even without noise: {wish}"
            )
        return plan

    @cached_property
    def actions(self) -> RoomActions:
        """The lap from the expected start without noise, (T, 2) float32."""
        return self._rolled_out(self.course.start, self.course.arc, 0.0, self.limit)

    def after(self, underway: Underway) -> tuple[RoomActions, int]:
        """Return the next h actions from where the robot truly is; see ``FixedPlan.after``."""
        left = self.limit - underway.step
        # what is done on a route does not depend on how much of it is shown
        most = min(self.horizon, left) if self.world.route is None else left
        ahead = self._rolled_out(underway.pose, underway.arc, underway.way, most)[: self.horizon]
        shown = np.zeros((self.horizon, 2), np.float32)
        shown[: len(ahead)] = ahead
        return shown, len(ahead)

    def left_as_it_is(self, underway: Underway) -> FixedPlan:
        """Return the whole plan as it is now, to be shown from now on whatever happens."""
        left = self.limit - underway.step
        ahead = self._rolled_out(underway.pose, underway.arc, underway.way, left)
        return FixedPlan(ahead, self.horizon, begun=underway.step)

    def _rolled_out(self, pose: Pose, arc: float, way: float, most: int) -> RoomActions:
        """Return the next actions, at most so many."""
        path, ground, route = self.course.path, self.world.floor_plan, self.world.route
        goal = self.course.goal
        if route is None or goal is None:
            return self._along(path.edges, 1.0, pose, arc, way, most)
        along = path.edges, path.length, goal
        if isinstance(ground, GridMap):
            needs, done = (self.world.body, route.clearance), np.empty((most, 2), np.float32)
            drive = pose, arc, way, *along, self.rules, ground.cells, *needs
            return done[: kernels.steer(*drive, done)]
        room = float(ground.distance([pose[:2]])[0]) - self.world.body
        body = self.world.body + max(0.0, min(room, route.clearance)) / 2
        back = kernels.back_onto(pose, arc, *along)
        farthest, clear = np.empty((0, 2), np.float32), -1
        for onto, begin in ((path.edges, arc), (back, 0.0)):
            for share in kernels.NEARER:
                actions = self._along(onto, share, pose, begin, way, most)
                blocked = _blocked(pose, actions, ground, body)
                if not blocked.any():
                    return actions
                if blocked.argmax() > clear:
                    farthest, clear = actions, int(blocked.argmax())
        return farthest

    def _along(
        self, edges: Floats, share: float, pose: Pose, arc: float, way: float, most: int
    ) -> RoomActions:
        rules, period = (share * self.rules[0], *self.rules[1:]), self.course.path.period
        actions = np.empty((most, 2), np.float32)
        return actions[: kernels.drive_along(pose, arc, way, edges, period, rules, actions)]


Plan = FixedPlan | GuidedPlan


def _blocked(start: Pose, actions: RoomActions, floor_plan: Map, body: float) -> Bools:
    """Whether a disc of radius ``body`` without noise would touch a wall in each step, (T,)."""
    points = points_of(start, actions)
    return floor_plan.collides(points[:-1], points[1:], body)


def points_of(start: Pose, actions: RoomActions) -> Floats:
    """Where a robot without noise comes by, (T + 1, 2)."""
    x, y, heading = start
    distances, turns = actions.astype(np.float64).T
    headings = heading + np.cumsum(turns)
    ways = distances[:, None] * np.column_stack([arrays.cos(headings), arrays.sin(headings)])
    return np.cumsum(np.vstack([(x, y), ways]), axis=0)
