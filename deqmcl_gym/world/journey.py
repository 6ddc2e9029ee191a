"""Journeys: routes from a start to a goal, drawn in free space."""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.config import Route, World
from deqmcl_gym.world.course import Course
from deqmcl_gym.world.path import Path, Point, Pose
from deqmcl_gym.world.route import Routes, RoutesTo, routes_on
from deqmcl_gym.world.streams import Stream, episode_stream

_ENDS = 20  # tries of a drawn end
_OTHERS = 300  # tries of the other end, for each of them
_DRAWS = 100_000  # tries of a free place


@dataclass(frozen=True)
class Journeys:
    """The courses of a world with a route.

    Attributes:
        world: the world.
    """

    world: World

    def drawn(self, seed: int, number: int) -> Course:
        """Draw a start with its heading, and a goal, unless the world names them.

        They depend only on the seed and the ``number`` of the episode after seeding. The last two
        courses are cached.

        Raises:
            InputError: the robot does not fit at a named place, or no drawn route has the length
                asked for.
        """
        return _drawn(self, seed, number)

    def onwards(self, goal: Point, pose: Pose) -> Course:
        """Plan the route to a goal from the robot's pose.

        Raises:
            InputError: the pose is at the goal already.
        """
        self._check_apart("the pose", pose[:2], goal)
        return Course.along(self._routes_to(goal).start_near(pose[:2]), pose, self.world)

    def elsewhere(self, goal: Point, rng: np.random.Generator) -> Pose:
        """Draw another start for a goal.

        Raises:
            InputError: no drawn route has the length asked for.
        """
        corners = self._drawn_to(goal, rng)
        if corners is None:
            raise self._none_found()
        x, y = corners[0].tolist()
        return x, y, float(rng.uniform(-np.pi, np.pi))

    def check(self) -> None:
        """Refuse a world in which the robot does not fit anywhere, or not at a named place."""
        if not len(self.routes.centres):
            raise InputError(
                f"the floor plan has no place for a robot that needs {self.routes.radius:g} "
                f"{self.world.floor_plan.unit} on either side: give a smaller robot.radius or "
                "route.clearance."
            )
        for what, at in (("start.pose", self.world.start.pose), ("route.goal", self._route.goal)):
            if at is not None:
                self.routes.check(what, at[:2])
        start, goal = self.world.start.pose, self._route.goal
        if start is None or goal is None:
            return
        self._check_apart("start.pose", start[:2], goal)
        self._routes_to(goal).start_at(start[:2])

    def _check_apart(self, what: str, at: Point, goal: Point) -> None:
        if math.dist(at, goal) <= self._route.tolerance:
            raise InputError(
                f"{what} is within route.tolerance, {self._route.tolerance:g} "
                f"{self.world.floor_plan.unit}, of the goal: give places farther apart."
            )

    @cached_property
    def routes(self) -> Routes:
        """All routes with the clearance asked for."""
        world, route = self.world, self._route
        radius = world.body + route.clearance
        return routes_on(world.floor_plan, radius, route.comfort)  # type: ignore[arg-type] # hashable

    def between(self, start: Point | None, rng: np.random.Generator) -> Floats:
        """Return the corners of a route, (k, 2); an end that is not named is drawn."""
        goal = self._route.goal
        if start is not None and goal is not None:
            return self._routes_to(goal).start_at(start)
        for _ in range(_ENDS):
            end = goal or start or self._place(rng)
            corners = self._drawn_to(end, rng)
            if corners is not None:
                return corners if end is not start else corners[::-1]
        raise self._none_found()

    def _drawn_to(self, end: Point, rng: np.random.Generator) -> Floats | None:
        """Return a route to ``end`` from a drawn place; None if none was found."""
        routes, route = self._routes_to(end), self._route
        for _ in range(_OTHERS):
            other = self._place(rng)
            if not route.tolerance < math.dist(other, end) <= route.max_length:
                continue
            if not route.min_length <= routes.cost_from(other) < math.inf:  # cost ≥ length
                continue
            corners = routes.start_at(other)
            if route.min_length <= Path(corners, closed=False).length <= route.max_length:
                return corners
        return None

    def _place(self, rng: np.random.Generator) -> Point:
        """Draw a place with the clearance asked for, uniformly."""
        x0, y0, x1, y1 = self.world.floor_plan.bounds
        for _ in range(_DRAWS):
            x, y = rng.uniform((x0, y0), (x1, y1)).tolist()
            free = self.routes.cell((x, y)) >= 0
            if free and self.world.floor_plan.free([(x, y)], self.routes.radius)[0]:
                return x, y
        raise InputError(
            f"none of {_DRAWS:,} places drawn on the floor plan is free: give start.pose and "
            "route.goal."
        )

    def _routes_to(self, goal: Point) -> RoutesTo:
        return _routes_to(self.routes, goal)

    @property
    def _route(self) -> Route:
        assert self.world.route is not None  # what these are the journeys of
        return self.world.route

    def _none_found(self) -> InputError:
        route, unit = self._route, self.world.floor_plan.unit
        return InputError(
            f"no route of {route.min_length:g} to {route.max_length:g} {unit} was found on the "
            "floor plan: give another route.min_length, route.max_length, route.goal or start.pose."
        )


@lru_cache(maxsize=2)
def _drawn(journeys: Journeys, seed: int, number: int) -> Course:
    rng = episode_stream(seed, number, Stream.ROUTE)
    start = journeys.world.start.pose
    corners = journeys.between(None if start is None else start[:2], rng)
    if start is None:
        x, y = corners[0].tolist()
        start = x, y, float(rng.uniform(-np.pi, np.pi))
    return Course.along(corners, start, journeys.world)


@lru_cache(maxsize=4)
def _routes_to(routes: Routes, goal: Point) -> RoutesTo:
    """Return the routes to a goal; the last four are cached, for drivers that replan."""
    return routes.to(goal)
