"""Routes: short paths on a map that keep clear of walls, and journeys from a start to a goal."""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.maps.map import Map, pixel
from deqmcl_gym.numerics import Bools, Floats, Indices, Point, Pose
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.validation import InputError
from deqmcl_gym.world import Route, Stream, World, episode_stream
from deqmcl_gym.world.course import Course, Path

_CELL = 5.0  # px: 0.1 m
_IN_SIGHT = 100  # cells ahead that are tried for a straight line
_COST_OF_WALLS = 4.0  # extra cost per length at a wall
_SURELY = 1.01  # times the comfort: farther away than that, whatever float32 rounds


@dataclass(frozen=True)
class Routes:
    """All routes of a robot on a map, planned on cells of 0.1 m (5 px).

    Cells where the robot does not fit are left out. Those nearer to a wall than ``comfort`` cost up
    to five times their length, so that routes keep to the middle of doors and corridors.
    """

    floor_plan: Map
    radius: float  # least distance to walls: the robot's radius, with a margin for motion noise
    comfort: float  # distance to walls from which on there is no extra cost

    def check(self, what: str, at: Point) -> None:
        """Refuse a place where the robot does not fit."""
        if self.cell(at) < 0:
            raise InputError(
                f"the {what} ({at[0]:g}, {at[1]:g}) is less than {self.radius:g} "
                f"{self.floor_plan.unit} from a wall, or outside: give a place in free space."
            )

    def cell(self, at: Point) -> int:
        """Number of the free cell at a place; -1 if there is none."""
        x_low, y_low, _, _ = self.floor_plan.bounds
        rows, columns = self._numbers.shape
        column, row = (int((at[i] - low) // self.side) for i, low in enumerate((x_low, y_low)))
        inside = 0 <= column < columns and 0 <= row < rows
        return int(self._numbers[row, column]) if inside else -1

    def taut(self, points: Floats) -> Floats:
        """Leave out points where a straight line comes no nearer to walls than the route."""
        room = np.minimum(self.floor_plan.distance(points), self.comfort)
        corners = [0]
        while corners[-1] < len(points) - 1:
            last = corners[-1]
            ahead = slice(last + 1, last + 1 + _IN_SIGHT)
            least = np.minimum(np.minimum.accumulate(room[ahead]), room[last])
            seen = self._in_sight(points[last], points[ahead], least)
            corners.append(last + 1 + int(np.flatnonzero(seen)[-1]) if seen.any() else last + 1)
        return points[corners]

    def _in_sight(self, start: Floats, ends: Floats, room: Floats) -> Bools:
        """Whether discs of radius ``room``, less a cell, fit along the lines to ``ends``."""
        shares = np.linspace(0.0, 1.0, 1 + int(np.ceil(np.abs(ends - start).max() / self.side)))
        ways = start + shares[:, None, None] * (ends - start)
        nearest = self.floor_plan.distance(ways.reshape(-1, 2)).reshape(len(shares), -1)
        seen: Bools = nearest.min(axis=0) >= np.maximum(room - self.side, self.radius)
        return seen

    @cached_property
    def side(self) -> float:
        """Of a cell."""
        return _CELL * pixel(self.floor_plan.unit)

    @cached_property
    def _room(self) -> Floats:
        """Distance to walls at each cell's centre, at most ``comfort``; 0 where no robot fits."""
        x_low, y_low, x_high, y_high = self.floor_plan.bounds
        across, up = (
            low + self.side * (np.arange(int((high - low) / self.side)) + 0.5)
            for low, high in ((x_low, x_high), (y_low, y_high))
        )
        centres = np.stack(np.meshgrid(across, up), axis=-1)
        free = self.floor_plan.free(centres.reshape(-1, 2), self.radius).reshape(centres.shape[:2])
        room = np.where(free, self.comfort, 0.0)
        near = free.copy()  # the only cells whose distance is looked up, which is slow in the open
        near[free] = ~self.floor_plan.free(centres[free], _SURELY * self.comfort)
        room[near] = np.minimum(self.floor_plan.distance(centres[near]), self.comfort)
        return room

    @cached_property
    def _numbers(self) -> Indices:
        """Number of each free cell, -1 elsewhere, (rows, columns)."""
        free = self._room > 0
        return np.where(free, np.cumsum(free, dtype=np.int32).reshape(free.shape) - 1, -1)

    @cached_property
    def centres(self) -> Floats:
        """Centres of the free cells, (n, 2)."""
        cells = np.argwhere(self._numbers >= 0)[:, ::-1]  # column, row
        centres: Floats = np.array(self.floor_plan.bounds[:2]) + (cells + 0.5) * self.side
        return centres

    @cached_property
    def dear(self) -> tuple[Floats, NDArray[np.int64]]:
        """Cost per step of each cell, and its number, both with a ring around the map."""
        walls = np.clip(1 - self._room / self.comfort, 0, 1)
        dear = self.side * (1 + _COST_OF_WALLS * walls)
        numbers = self._numbers.astype(np.int64)
        return np.pad(dear, 1), np.pad(numbers, 1, constant_values=-1)


@dataclass(frozen=True, eq=False)
class RoutesTo:
    """The routes from anywhere to one goal."""

    routes: Routes  # of the map
    goal: Point  # where they end
    costs: Floats  # least weighted length from each free cell to the goal, ∞ without a route, (n,)
    following: Indices  # the next cell of the route from each cell, -1 without one, (n,)

    def cost_from(self, start: Point) -> float:
        """Weighted length of the route from a place; ∞ if there is none."""
        cell = self.routes.cell(start)
        return float(self.costs[cell]) if cell >= 0 else np.inf

    def start_at(self, start: Point) -> Floats:
        """Return the corners of the route from a place, both ends included, (k, 2)."""
        self.routes.check("start", start)
        if not np.isfinite(self.cost_from(start)):
            raise InputError(
                f"there is no route from ({start[0]:g}, {start[1]:g}) to ({self.goal[0]:g}, "
                f"{self.goal[1]:g}) for a robot that needs {self.routes.radius:g} "
                f"{self.routes.floor_plan.unit} of room on either side."
            )
        return self._onwards(start, self.routes.cell(start))

    def start_near(self, start: Point) -> Floats:
        """Return the corners of the route from any place, (k, 2).

        From a place without one, such as close to a wall, it leads through the nearest cell that
        has one.
        """
        if np.isfinite(self.cost_from(start)):
            return self._onwards(start, self.routes.cell(start))
        off = ((self.routes.centres - start) ** 2).sum(axis=1)
        nearest = int(np.where(np.isfinite(self.costs), off, np.inf).argmin())
        entry: Point = tuple(self.routes.centres[nearest].tolist())
        return np.vstack([start, self._onwards(entry, nearest)])

    def _onwards(self, start: Point, cell: int) -> Floats:
        cells = [cell]
        while (following := int(self.following[cells[-1]])) >= 0:
            cells.append(following)
        return self.routes.taut(np.vstack([start, self.routes.centres[cells[1:-1]], self.goal]))


routes_on = lru_cache(maxsize=32)(Routes)  # the last ones, as they are slow to compute


_ENDS = 20  # tries of a drawn end
_OTHERS = 300  # tries of the other end, for each of them
_DRAWS = 100_000  # tries of a free place


@dataclass(frozen=True)
class Journeys:
    """The courses of a world with a route."""

    world: World

    def onwards(self, goal: Point, pose: Pose) -> Course:
        """Plan the route to a goal from the robot's pose."""
        self._check_apart("the pose", pose[:2], goal)
        return Course.along(routes_to(self.routes, goal).start_near(pose[:2]), pose, self.world)

    def elsewhere(self, goal: Point, rng: np.random.Generator) -> Pose:
        """Draw another start for a goal."""
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
        routes_to(self.routes, goal).start_at(start[:2])

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
        return routes_on(world.floor_plan, radius, route.comfort)

    def between(self, start: Point | None, rng: np.random.Generator) -> Floats:
        """Return the corners of a route, (k, 2); an end that is not named is drawn."""
        goal = self._route.goal
        if start is not None and goal is not None:
            return routes_to(self.routes, goal).start_at(start)
        for _ in range(_ENDS):
            end = goal or start or self._place(rng)
            corners = self._drawn_to(end, rng)
            if corners is not None:
                return corners if end is not start else corners[::-1]
        raise self._none_found()

    def _drawn_to(self, end: Point, rng: np.random.Generator) -> Floats | None:
        """Return a route to ``end`` from a drawn place; None if none was found."""
        routes, route = routes_to(self.routes, end), self._route
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
def drawn_course(journeys: Journeys, seed: int, number: int) -> Course:
    """Draw a start with its heading, and a goal, unless the world names them.

    They depend only on the seed and the ``number`` of the episode after seeding. The last two are
    cached.
    """
    rng = episode_stream(seed, number, Stream.ROUTE)
    start = journeys.world.start.pose
    corners = journeys.between(None if start is None else start[:2], rng)
    if start is None:
        x, y = corners[0].tolist()
        start = x, y, float(rng.uniform(-np.pi, np.pi))
    return Course.along(corners, start, journeys.world)


@lru_cache(maxsize=4)
def routes_to(routes: Routes, goal: Point) -> RoutesTo:
    """Return the routes to a goal; the last four are cached, for drivers that replan."""
    routes.check("goal", goal)
    costs, following = np.full(len(routes.centres), np.inf), np.full(len(routes.centres), -1)
    fill_costs(*routes.dear, routes.side, routes.cell(goal), costs, following)
    return RoutesTo(routes, goal, costs, following)


Numbers = NDArray[np.int64]
_RING = 16  # buckets: a step costs less than 5 √2 + 1 of them
_DIAGONAL = np.sqrt(2.0)


@compiled
def fill_costs(
    dear: Floats, numbers: Numbers, cell: float, goal: int, out: Floats, following: Indices
) -> None:
    """Fill in the least cost from each free cell to the goal, and the next cell of the way there.

    Of next cells at equal cost it is the nearest to the goal, and of these the last.

    Dijkstra's algorithm with buckets of width ``cell`` (Dial, 1969). A step from a to b costs its
    length times the mean of what a and b cost. Sums of floats grow with either term, so the least
    one over all ways is the same in any order of the search.

    ``dear`` is the cost per step of each cell, from ``cell`` to 5 ``cell``, ``numbers`` those of
    free cells, -1 elsewhere, with a ring of -1 around them, (rows, columns); ``out`` begins with ∞,
    ``following`` with -1, which stay where there is no way.
    """
    rows, columns = numbers.shape
    places = np.empty(out.size, np.int64)
    for row in range(rows):
        for column in range(columns):
            if numbers[row, column] >= 0:
                places[numbers[row, column]] = row * columns + column
    worth, number = dear.ravel(), numbers.ravel()
    away = np.array([1, -1, columns, -columns, columns + 1, -columns - 1, columns - 1, 1 - columns])
    first = np.full(_RING, -1, np.int64)  # entry of each bucket, and of each the next one
    after, held = np.empty(8 * out.size + 1, np.int64), np.empty(8 * out.size + 1, np.int64)
    unused, used, waiting = np.int64(-1), 0, 0
    done = np.zeros(out.size, np.bool_)
    out[goal] = 0.0
    held[0], after[0], first[0], used, waiting = goal, -1, 0, 1, 1
    bucket = 0
    while waiting > 0:
        ring = bucket % _RING
        while first[ring] >= 0:
            entry = first[ring]
            first[ring] = after[entry]
            after[entry], unused = unused, entry
            waiting -= 1
            here = held[entry]
            if done[here]:  # at less cost
                continue
            done[here] = True
            at = places[here]
            for way in range(8):
                there = number[at + away[way]]
                if there < 0:
                    continue
                cost = out[here] + _step(worth[at], worth[at + away[way]], way)
                if cost == out[there]:
                    other = following[there]
                    nearer = out[here] < out[other] or (out[here] == out[other] and here > other)
                    following[there] = here if nearer else other
                if cost < out[there]:
                    out[there], done[there], following[there] = cost, False, here
                    if unused >= 0:
                        entry, unused = unused, after[unused]
                    else:
                        entry, used = np.int64(used), used + 1
                    into = int(cost / cell) % _RING
                    held[entry], after[entry], first[into] = there, first[into], entry
                    waiting += 1
        bucket += 1


@compiled
def _step(here: float, there: float, way: int) -> float:
    """Cost of a step between two cells; the first four ways are along the axes."""
    return (1.0 if way < 4 else _DIAGONAL) * (here + there) / 2
