"""Rooms: the episodes of many rooms as flat arrays, moved and planned for in compiled kernels."""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from deqmcl_gym.envs import vector_kernels as kernels
from deqmcl_gym.envs.vector_grounds import Grounds, wide
from deqmcl_gym.maps import GridMap
from deqmcl_gym.numerics.types import Bools, Floats, Indices, Pose, Singles
from deqmcl_gym.world.course import MAX_STEPS, Course
from deqmcl_gym.world.driver import FixedPlan, GuidedPlan, Plan
from deqmcl_gym.world.reality import Beginning
from deqmcl_gym.world.rules import RoomRules
from deqmcl_gym.world.sensor import LidarSensors, NormalTable, Stream, episode_stream

if TYPE_CHECKING:  # OpenCV is only loaded for pictures
    from deqmcl_gym.world.drawing import Drawing


class Rooms:
    """:class:`deqmcl_gym.world.episode.Episode` for n rooms at a time.

    Attributes:
        begun: what was drawn for each room's episode; None before its first.
        buildings: seed of each room's office, where episodes draw one, (n,).
        poses: the true ones (x, y, θ), (n, 3).
        steps: number carried out, (n,).
        progress: along the path since reset, (n,).
        scans: the last ones, (n, B).
    """

    def __init__(self, rules: RoomRules, number: int, limit: int) -> None:
        """Make ``number`` rooms, with at most ``limit`` steps; :meth:`begin` starts episodes."""
        world, most = rules.world, _steps(rules)
        self._rules = rules
        self._grounds = Grounds(world, number, own=_own(rules))
        self._motion = NormalTable(number, 2, most)
        self._lidars = LidarSensors(self._grounds, world.lidar, number, most + 1)
        self._own_rules = [rules] * number  # in the office of each
        self.begun: list[Beginning | None] = [None] * number
        self.buildings = np.zeros(number, np.int64)
        self.poses, self.steps = np.zeros((number, 3)), np.zeros(number, np.intp)
        gaps, arcs, self.progress = np.zeros((3, number))
        self._robots = kernels.Robots(self.poses, gaps, arcs, self.progress, self.steps)
        self._courses = kernels.Courses(
            edges=np.zeros((number, 0, 6)),
            counts=np.zeros(number, np.intp),
            periods=np.full(number, np.inf),
            lengths=np.ones(number),
            goals=np.zeros((number, 2)),
            ends=np.full(number, np.inf),
            limits=np.ones(number, np.intp),
        )
        near = -1.0
        if world.route is not None and rules.ends_at_goal:
            near = world.route.tolerance
        self._numbers = tuple(kernels.Rules(rules.noise, rules.rewards, near, limit))
        self.scans = self._lidars.scans
        self._lap = None if world.route is not None else rules.plan
        self._driver = _driver(rules)
        self._shown = np.zeros((number, horizon_of(rules), 2), np.float32)
        self._counts = np.zeros(number, np.intp)
        self._every = np.arange(number)

    @staticmethod
    def bytes_each(rules: RoomRules) -> int:
        """Approximate memory of a room: its random numbers, scan, plan, and map of its own."""
        beams, steps = rules.world.lidar.beams, _steps(rules)
        rows = NormalTable.rows(2, steps), NormalTable.rows(beams, steps + 1)
        numbers = 2 * rows[0] + beams * (rows[1] + 2) + 4 * horizon_of(rules) + 64
        return 8 * numbers + (Grounds.bytes_each(rules.world) if _own(rules) else 0)

    def plans(self) -> tuple[Singles, Indices]:
        """Return the next h actions of each room, zero-padded, (n, h, 2), and their number, (n,).

        Fresh arrays.
        """
        if isinstance(self._lap, FixedPlan):
            return self._lap.after_each(self.steps)
        return self._shown.copy(), self._counts.copy()

    @property
    def goals(self) -> Floats:
        """The last corner (x, y) of each room's path, (n, 2)."""
        return self._courses.goals

    @property
    def covered(self) -> Floats:
        """Progress of each robot as a share of its path, (n,)."""
        return self.progress / self._courses.lengths

    @property
    def elapsed(self) -> Floats:
        """Steps of each robot as a share of its plan's, (n,)."""
        return self.steps / self._courses.limits

    def begin(self, rooms: Indices, episodes: list[tuple[int, int]]) -> None:
        """Begin an episode (seed, number) in each of ``rooms``; no scan is taken yet.

        Raises:
            InputError: an episode cannot begin. All rooms are then unchanged.
        """
        rules = [self._rules.of_episode(*episode) for episode in episodes]
        drawn = [
            Beginning.drawn(own, *episode)
            for (own, _), episode in zip(rules, episodes, strict=True)
        ]
        for room, (own, building), begun, episode in zip(
            rooms.tolist(), rules, drawn, episodes, strict=True
        ):
            self._own_rules[room] = own
            self.begun[room], self.buildings[room] = begun, building or 0
            self._grounds.put(room, begun.there.world)
            self._put(room, begun.course, begun.plan)
            self.poses[room], self._robots.arcs[room] = begun.start, begun.arc
            self._robots.gaps[room] = self.progress[room] = 0.0
            self.steps[room] = 0
            self._motion.renew(room, episode_stream(*episode, Stream.MOTION))
            self._lidars.renew(room, episode_stream(*episode, Stream.SENSOR))
        if not isinstance(self._lap, FixedPlan):
            self._plan(rooms)

    def move(self, commands: Singles, resting: Bools) -> tuple[Floats, Bools, Bools, Bools]:
        """Turn and drive the robots that are not ``resting``: one step of noisy motion.

        Returns:
            Rewards, collided, terminated, truncated: by the limit, or with the plan used up.
        """
        n, noise = resting.size, self._motion
        moved = np.empty(n), np.empty(n, np.bool_), np.empty(n, np.bool_), np.empty(n, np.bool_)
        noise.fill()
        state = tuple(self._robots), self._grounds.kernel, tuple(self._courses), self._numbers
        kernels.step(*state, commands, noise.drawn, noise.at, resting, moved)
        if not isinstance(self._lap, FixedPlan):
            _, _, terminated, truncated = moved
            self._plan(np.flatnonzero(~resting))
            truncated |= (self._counts == 0) & ~terminated & ~resting
        return moved

    def picture(self, room: int) -> "Drawing":
        """Draw what is in a room, without its robot."""
        begun = self.begun[room]
        assert begun is not None
        return begun.reality.picture(self._own_rules[room].view, None)

    def observe(self, rooms: Indices | None = None) -> None:
        """Take a scan in each of ``rooms``; None: in all."""
        if rooms is None:
            self._lidars.scan(self._every, self.poses)
        else:
            self._lidars.scan(rooms, self.poses[rooms])

    def _put(self, room: int, course: Course, plan: Plan) -> None:
        """Let a room have a course."""
        path, edges = course.path, course.path.edges
        courses = self._courses
        self._courses = courses = courses._replace(edges=wide(courses.edges, len(edges)))
        courses.edges[room, : len(edges)], courses.counts[room] = edges, len(edges)
        courses.periods[room], courses.lengths[room] = path.period, path.length
        courses.goals[room], courses.limits[room] = path.corners[-1], plan.limit
        courses.ends[room] = plan.rules[4] if isinstance(plan, GuidedPlan) else math.inf

    def _plan(self, rooms: Indices) -> None:
        """Note what is planned in each of ``rooms``."""
        if self._driver is not None:
            kernels.plan(
                tuple(self._robots), self._grounds.kernel, tuple(self._courses), self._driver,
                rooms, self._shown, self._counts,
            )  # fmt: skip
            return
        for room in rooms.tolist():
            begun = self.begun[room]
            assert begun is not None
            x, y, heading = self.poses[room].tolist()
            way, arc = float(self.progress[room]), float(self._robots.arcs[room])
            underway = _Underway(int(self.steps[room]), (x, y, heading), arc, way)
            self._shown[room], self._counts[room] = begun.plan.after(underway)


class _Underway(NamedTuple):
    """See ``driver.Underway``."""

    step: int
    pose: Pose
    arc: float
    way: float


def horizon_of(rules: RoomRules) -> int:
    """Number of planned actions that each room shows."""
    if rules.journeys is None:
        return rules.plan.horizon
    assert rules.horizon is not None  # or the env has refused
    return rules.horizon


def _own(rules: RoomRules) -> bool:
    """Whether each room has a map, or walls that are not on it, of its own."""
    world = rules.world
    return any((rules.offices, world.clutter, world.changed_walls))


def _steps(rules: RoomRules) -> int:
    """About how many steps an episode has, at most."""
    route, lap = rules.world.route, rules.world.lap
    if route is None:
        return rules.plan.limit
    return int(min(2 * route.max_length / lap.step + 1, MAX_STEPS))


def _driver(rules: RoomRules) -> tuple[object, ...] | None:
    """Return ``kernels.Driver``, if there is one and the kernel has what he looks at."""
    world = rules.world
    driver, lap, route = world.driver, world.lap, world.route
    if driver is None or (route is not None and not isinstance(world.floor_plan, GridMap)):
        return None
    own = driver.look_ahead, driver.on_the_spot, lap.step, lap.turn
    near, clearance = (-1.0, -1.0) if route is None else (route.tolerance, route.clearance)
    return tuple(kernels.Driver(own, near, clearance))
