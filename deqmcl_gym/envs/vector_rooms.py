"""Rooms: the episodes and maps of many rooms as flat arrays, moved and planned for in kernels."""

from typing import Any

import numpy as np

from deqmcl_gym.envs import vector_kernels as kernels
from deqmcl_gym.maps import GridMap
from deqmcl_gym.maps.map import Caster
from deqmcl_gym.numerics import Bools, Floats, Indices, Singles
from deqmcl_gym.world import Stream, World, episode_stream
from deqmcl_gym.world.course import MAX_STEPS
from deqmcl_gym.world.driver import FixedPlan, Underway
from deqmcl_gym.world.episode import Beginning, report
from deqmcl_gym.world.rules import RoomRules


class Rooms:
    """:class:`deqmcl_gym.world.episode.Episode` for n rooms at a time."""

    def __init__(self, rules: RoomRules, number: int, limit: int) -> None:
        """Make ``number`` rooms, with at most ``limit`` steps; :meth:`begin` starts episodes."""
        world, most = rules.world, _steps(rules)
        self._rules = rules
        self._grounds = Grounds(world, number, own=_grounds_differ(rules))
        self._motion = NormalTable(number, 2, most)
        self._noise = NormalTable(number, world.lidar.beams, most + 1)  # of the lidars
        self.begun: dict[int, Beginning] = {}  # by room
        self.buildings = np.zeros(number, np.int64)
        self.poses, self.steps = np.zeros((number, 3)), np.zeros(number, np.intp)
        gaps, arcs, self.progress = np.zeros((3, number))
        self.lengths = np.ones(number)  # of the paths
        self._robots = kernels.Robots(self.poses, gaps, arcs, self.progress, self.steps)
        self.courses = kernels.Courses(
            edges=np.zeros((number, 0, 6)),
            counts=np.zeros(number, np.intp),
            periods=np.full(number, np.inf),
            goals=np.zeros((number, 2)),
            limits=np.ones(number, np.intp),
        )
        self._numbers = world.noise.sds, rules.rewards, limit
        self.scans = np.zeros((number, world.lidar.beams), np.float32)
        self._lap = None if world.route is not None else rules.plan
        self._shown = np.zeros((number, rules.rows, 2), np.float32)
        self._counts = np.zeros(number, np.intp)

    @staticmethod
    def bytes_each(rules: RoomRules) -> int:
        """Approximate memory of a room: its random numbers, scan, plan, and map of its own."""
        beams, steps = rules.world.lidar.beams, _steps(rules)
        rows = NormalTable.rows(2, steps), NormalTable.rows(beams, steps + 1)
        numbers = 2 * rows[0] + beams * (rows[1] + 2) + 4 * rules.rows + 64
        if _grounds_differ(rules):
            own = rules.world.floor_plan
            numbers += own.occupancy.size if isinstance(own, GridMap) else 10 * len(own.walls)
        return 8 * numbers

    def plans(self) -> tuple[Singles, Indices]:
        """Return the next h actions, zero-padded, fresh (n, h, 2), and their number, (n,)."""
        if isinstance(self._lap, FixedPlan):
            return self._lap.after_each(self.steps)
        return self._shown.copy(), self._counts.copy()

    def begin(self, rooms: Indices, episodes: list[tuple[int, int]]) -> None:
        """Begin an episode (seed, number) in each of ``rooms``; no scan is taken yet.

        If one cannot begin, all rooms are unchanged.
        """
        drawn = []
        for episode in episodes:
            rules, building = self._rules.of_episode(*episode)
            drawn.append((Beginning.drawn(rules, *episode), building))
        for room, (begun, building), episode in zip(rooms.tolist(), drawn, episodes, strict=True):
            self.begun[room], self.buildings[room] = begun, building or 0
            self._grounds.put(room, begun.there.world)
            path, plan, edges = begun.course.path, begun.plan, begun.course.path.edges
            wider = wide(self.courses.edges, len(edges))
            self.courses = courses = self.courses._replace(edges=wider)
            courses.edges[room, : len(edges)], courses.counts[room] = edges, len(edges)
            courses.periods[room], self.lengths[room] = path.period, path.length
            courses.goals[room], courses.limits[room] = path.corners[-1], plan.limit
            self.poses[room], self._robots.arcs[room] = begun.start, begun.arc
            self._robots.gaps[room] = self.progress[room] = 0.0
            self.steps[room] = 0
            self._motion.renew(room, episode_stream(*episode, Stream.MOTION))
            self._noise.renew(room, episode_stream(*episode, Stream.SENSOR))
        if not isinstance(self._lap, FixedPlan):
            self._plan(rooms)

    def move(self, commands: Singles, resting: Bools) -> tuple[Floats, Bools, Bools, Bools]:
        """Turn and drive the robots that are not ``resting``: one step of noisy motion.

        Rewards, collided, terminated, truncated: by the limit, or with the plan used up.
        """
        n, noise = resting.size, self._motion
        moved = np.empty(n), np.empty(n, np.bool_), np.empty(n, np.bool_), np.empty(n, np.bool_)
        noise.fill()
        state = tuple(self._robots), self._grounds.kernel, tuple(self.courses), self._numbers
        kernels.step_rooms(*state, commands, noise.drawn, noise.at, resting, moved)
        if not isinstance(self._lap, FixedPlan):
            _, _, terminated, truncated = moved
            self._plan(np.flatnonzero(~resting))
            truncated |= (self._counts == 0) & ~terminated & ~resting
        return moved

    def observe(self, rooms: Indices) -> None:
        """Take a scan in each of ``rooms``."""
        lidar, noise = self._rules.world.lidar, self._noise
        exact = np.empty((lidar.beams, rooms.size), np.float32)
        poses = self.poses[rooms].T.astype(np.float32, order="C")
        lidar.cast(self._grounds.caster(rooms), poses, exact)
        noise.fill()
        limits = lidar.sigma, lidar.max_range
        report(rooms, exact, noise.drawn, noise.at, *limits, self.scans)
        lidar.lose(self.scans)

    def _plan(self, rooms: Indices) -> None:
        """Note what is planned in each of ``rooms``."""
        for room in rooms.tolist():
            x, y, heading = self.poses[room].tolist()
            way, arc = float(self.progress[room]), float(self._robots.arcs[room])
            underway = Underway(int(self.steps[room]), (x, y, heading), arc, way)
            self._shown[room], self._counts[room] = self.begun[room].plan.after(underway)


def _grounds_differ(rules: RoomRules) -> bool:
    """Whether each room has a map, or walls that are not on it, of its own."""
    world = rules.world
    return any((rules.offices, world.clutter, world.changed_walls))


def _steps(rules: RoomRules) -> int:
    """About how many steps an episode has, at most."""
    route, lap = rules.world.route, rules.world.lap
    if route is None:
        return rules.plan.limit
    return int(min(2 * route.max_length / lap.step + 1, MAX_STEPS))


class NormalTable:
    """Normal numbers for many rooms, each from its own stream, drawn many rows at a time.

    A kernel reads row ``at[i]`` of room i of ``drawn``, (n, rows, width), and adds one to
    ``at[i]``, without copies.
    """

    def __init__(self, rooms: int, width: int, lap: int) -> None:
        """Prepare rows (width,) for each room, of which an episode uses about ``lap``."""
        self.drawn = np.empty((rooms, self.rows(width, lap), width))
        self.at = np.zeros(rooms, np.intp)
        self._rngs: dict[int, np.random.Generator] = {}

    @staticmethod
    def rows(width: int, lap: int) -> int:
        """Number of rows drawn at a time: about 32 KB for each room, at least one row."""
        blocks = -(-lap * width // 4096)  # calls of NumPy for a lap
        return -(-lap // blocks)

    def renew(self, room: int, rng: np.random.Generator) -> None:
        """Draw the numbers of a room from another stream from now on."""
        self._rngs[room] = rng
        self.at[room] = self.drawn.shape[1]

    def fill(self) -> None:
        """Draw new rows for rooms without any left; a room uses one row between two calls."""
        for room in (self.at == self.drawn.shape[1]).nonzero()[0].tolist():
            self._rngs[room].standard_normal(out=self.drawn[room])
            self.at[room] = 0


class Grounds:
    """What is there in each of n rooms: walls or cells, for contacts, drivers and beams."""

    def __init__(self, world: World, rooms: int, own: bool) -> None:
        """Put what the world has into all rooms; ``own``: each may be given another one."""
        self.maps = [world.floor_plan] * rooms
        self._separate = own
        slots = rooms if own else 1
        self._slots = np.arange(rooms) if own else np.zeros(rooms, np.intp)  # the map of each room
        self._sizes = np.zeros((slots, 3))  # radius, skin and reach, as of ``World``
        # x₀, y₀, unit x, unit y, length, free space to their left, padded
        self._walls = np.empty((slots, 0, 5))
        self._counts = np.zeros(slots, np.intp)  # of walls
        self._cells = kernels.CellRows(
            reach=np.empty((slots, 0), np.uint8),
            up=np.empty((slots, 0), np.int16),
            down=np.empty((slots, 0), np.int16),
            shapes=np.zeros((slots, 2), np.intp),
            frames=np.ones((slots, 5)),
        )
        for room in range(slots):
            self._fill(room, world)

    @property
    def kernel(self) -> tuple[Any, ...]:
        """What kernels take of them, in plain tuples."""
        return self._slots, self._sizes, self._walls, self._counts, tuple(self._cells)

    def put(self, room: int, world: World) -> None:
        """Put what is there in a world into a room."""
        if self.maps[room] is not world.floor_plan:
            assert self._separate
            self.maps[room] = world.floor_plan
            self._fill(room, world)

    def caster(self, rooms: Indices) -> Caster:
        """Return a caster for one pose in each of ``rooms`` (k,), in this order."""
        if not self._separate:
            return self.maps[0].cast
        maps = [self.maps[room] for room in rooms.tolist()]

        def cast(poses: Singles, bearings: Singles, out: Singles) -> None:
            single = np.empty((bearings.size, 1), np.float32)
            for i, floor_plan in enumerate(maps):
                floor_plan.cast(np.ascontiguousarray(poses[:, i : i + 1]), bearings, single)
                out[:, i : i + 1] = single

        return cast

    def _fill(self, slot: int, world: World) -> None:
        ground = world.floor_plan
        self._sizes[slot] = world.body, world.skin, world.reach
        if not isinstance(ground, GridMap):
            walls, count = ground.walls, len(ground.walls)
            along = walls[:, 2:] - walls[:, :2]
            length = np.sqrt((along**2).sum(axis=1, keepdims=True))
            self._walls, self._counts[slot] = wide(self._walls, count), count
            self._walls[slot, :count] = np.hstack([walls[:, :2], along / length, length])
            return
        reach, up, down, frame = ground.cells
        for name, table in {"reach": reach, "up": up, "down": down}.items():
            rows = wide(getattr(self._cells, name), table.size)
            rows[slot, : table.size] = table.reshape(-1)
            self._cells = self._cells._replace(**{name: rows})
        self._cells.shapes[slot], self._cells.frames[slot] = reach.shape, frame


def wide(values: Any, size: int) -> Any:
    """Return (slots, s, …) values with at least ``size`` places for each slot."""
    if values.shape[1] >= size:
        return values
    wider = np.zeros((len(values), size, *values.shape[2:]), values.dtype)
    wider[:, : values.shape[1]] = values
    return wider
