"""Episode: a robot in a world as it is, with its lidar, from reset to the end of its plan.

Contact of the driving disc with walls is by pymunk for polygons, exact for cells.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from deqmcl_gym.maps import Caster, GridMap, Lidar, Map, PolygonMap
from deqmcl_gym.maps.grid_kernels import first_contact
from deqmcl_gym.maps.polygons import oriented_edges
from deqmcl_gym.numerics import Floats, Indices, Point, Pose, Singles
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.world import Stream, World, episode_stream
from deqmcl_gym.world.course import Course
from deqmcl_gym.world.differences import Way, altered
from deqmcl_gym.world.driver import GuidedPlan, Plan, Underway, points_of
from deqmcl_gym.world.path_kernels import follow, judged_step, noisy_drive
from deqmcl_gym.world.people import Contacts, Crowd, Crowded, cast_among_people
from deqmcl_gym.world.route import drawn_course
from deqmcl_gym.world.rules import RoomRules

if TYPE_CHECKING:  # OpenCV is only loaded for pictures
    from deqmcl_gym.world.drawing import Drawing, View

Streams = Callable[..., np.random.Generator]  # of an episode, by ``Stream`` and ``twin``

_CLOSEST = 0.05  # px: walls nearer than this to each other are one to a beam


@dataclass(frozen=True, eq=False)
class Beginning:
    """What is drawn for an episode before its first step."""

    mapped: Map
    there: RoomRules  # the rules, in the world with what is there as its floor plan
    course: Course  # the path, and the actions planned for it on the map
    plan: Plan
    start: Pose  # the true pose (x, y, θ)
    glass: Floats  # walls that are glass, (k, 4, 2)
    behind_glass: Map  # what is there without them
    streams: Streams

    @classmethod
    def drawn(cls, rules: RoomRules, seed: int, number: int) -> "Beginning":
        """Draw the ``number``-th episode after seeding."""
        if (journeys := rules.journeys) is None:
            course, plan = rules.course, rules.plan
        else:
            course = drawn_course(journeys, seed, number)
            plan = rules.plan_for(course)
        streams = partial(episode_stream, seed, number)
        world, ground = rules.world, rules.world.floor_plan
        clutter, walls = world.clutter, world.changed_walls
        cleared, filled = np.empty((0, 4, 2)), list[Floats]()
        if walls is not None:
            way = _way(world, course, plan, walls.keep_route)
            cleared, filled = walls.drawn(ground, way, streams(Stream.CHANGED_WALLS))
        if clutter is not None:
            way = _way(world, course, plan, clutter.keep_route)
            filled = [*filled, *clutter.drawn(ground, way, streams(Stream.CLUTTER))]
        solid = behind = altered(ground, cleared, filled)
        glass = np.empty((0, 4, 2))
        if world.glass is not None:
            glass = world.glass.drawn(ground, streams(Stream.GLASS))
            behind = altered(ground, np.vstack([cleared, glass]), filled)
        actual = rules
        if solid is not ground:
            actual = replace(rules, world=replace(world, floor_plan=solid))
        start = actual.start(course, seed, number)
        if actual is not rules and isinstance(plan, GuidedPlan):
            # the driver has planned on the map, but sees what is there
            keeps_route = all(part.keep_route for part in (clutter, walls) if part is not None)
            if keeps_route or actual.journeys is None or course.goal is None:
                plan = replace(plan, world=actual.world)
            else:
                course = actual.journeys.onwards(course.goal, start)
                plan = actual.plan_for(course)
        return cls(ground, actual, course, plan, start, glass, behind, streams)

    @property
    def arc(self) -> float:
        """Arc length at which it begins."""
        course, (x, y, _), path = self.course, self.start, self.course.path
        return follow(*course.start[:2], x, y, course.arc, path.edges, path.period)[0]

    def crowd(self) -> Crowd | None:
        """Return the people, if there are any, around the robot at its start."""
        world = self.there.world
        if world.people is None:
            return None
        rng = self.streams(Stream.PEOPLE)
        return Crowd(world.people, world.floor_plan, self.start[:2], world.body, rng)

    def caster(self, crowd: Crowd | None) -> Caster:
        """Return what beams meet."""
        world = self.there.world
        caster: Caster = world.floor_plan.cast
        if world.glass is not None:
            rng = self.streams(Stream.THROUGH_GLASS)
            caster = partial(self._cast_through_glass, world.glass.lost, rng)
        return caster if crowd is None else partial(cast_among_people, caster, crowd)

    def _cast_through_glass(
        self,
        share: float,
        rng: np.random.Generator,
        poses: Singles,
        bearings: Singles,
        out: Singles,
    ) -> None:
        """Cast among walls, of which glass loses a ``share``: a number per beam says which."""
        world, beyond = self.there.world, np.empty_like(out)
        world.floor_plan.cast(poses, bearings, out)
        self.behind_glass.cast(poses, bearings, beyond)
        lost = (beyond > out + _CLOSEST * world.pixel) & (rng.random(out.shape) < share)
        np.copyto(out, beyond, where=lost)

    def picture(self, view: "View", crowd: Crowd | None) -> "Drawing":
        """Draw what is there: solid, glass in blue; the map in outline; people as discs."""
        from deqmcl_gym.world.drawing import GLASS, MAPPED, PERSON, Drawing

        floor_plan = self.there.world.floor_plan
        drawing = Drawing(replace(view, floor_plan=floor_plan))
        if floor_plan is not self.mapped:
            drawing.segments(self.mapped.walls, MAPPED)
        drawing.solids(self.glass, GLASS)
        return drawing if crowd is None else drawing.discs(crowd.places, crowd.radius, PERSON)


def _way(world: World, course: Course, plan: Plan, whole: bool) -> Way:
    """Return the way planned on the map, with that of a driver without noise, or its ends."""
    if whole:
        ways = [course.path.outline, points_of(course.start, plan.actions)]
    else:
        ends = [course.start[:2]] if course.goal is None else [course.start[:2], course.goal]
        ways = [np.array([end, end]) for end in ends]
    parts = [Way.along(way, world.body, world.floor_plan) for way in ways]
    return Way(np.vstack([way.points for way in parts]), parts[0].margin)


_ONLY = np.zeros(1, np.intp)


def scanned(pose: Pose, caster: Caster, lidar: Lidar, rng: np.random.Generator) -> Singles:
    """Return the ranges seen from a pose, fresh (B,), in [0, max_range]; +inf for lost ones.

    o = clip(r + ε, 0, max_range), r exact, ε ~ N(0, σ²): a normal number per beam from ``rng``.
    """
    exact, seen = np.empty((lidar.beams, 1), np.float32), np.empty(lidar.beams, np.float32)
    lidar.cast(caster, np.array([pose], np.float32).T, exact)
    normals = rng.standard_normal((1, 1, lidar.beams))
    report(_ONLY, exact, normals, _ONLY.copy(), lidar.sigma, lidar.max_range, seen[None])
    lidar.lose(seen)
    return seen


@compiled
def report(
    rooms: Indices,
    exact: Singles,
    normals: Floats,
    at: Indices,
    sigma: float,
    max_range: float,
    out: Singles,
) -> None:
    """Fill in scans clip(exact + σ normals, 0, max_range), (n, B), of ``rooms`` (k,), in one pass.

    ``exact`` is (B, k). Each uses the next row of its normal numbers, (n, rows, B).
    """
    for i in range(rooms.size):
        room = rooms[i]
        row = at[room]
        at[room] = row + 1
        for beam in range(out.shape[1]):
            seen = exact[beam, i] + sigma * normals[room, row, beam]
            out[room, beam] = min(max(seen, 0.0), max_range)


class CellContacts:
    """The solid cells of a grid; the arithmetic is that of ``GridMap.collides``."""

    def __init__(self, floor_plan: GridMap, radius: float) -> None:
        self._floor_plan, self._radius = floor_plan, radius

    def gap(self, centre: Point) -> float:
        """See ``Contacts.gap``."""
        return float(self._floor_plan.distance([centre])[0]) - self._radius

    def first_contact(self, start: Point, end: Point) -> float:
        """See ``Contacts.first_contact``."""
        reach, _, _, frame = self._floor_plan.cells
        return first_contact(start, end, reach, frame, self._radius)


class WallContacts:
    """The walls of a floor plan in a pymunk space, as static segments.

    Each wall is grown by the disc's radius, so that its centre touches the grown wall where the
    disc touches the wall (the configuration space of Lozano-Pérez, 1983). pymunk can also sweep a
    disc, but then searches for walls along its centre line only and misses those beside it.
    """

    def __init__(self, floor_plan: PolygonMap, radius: float) -> None:
        """Build the space; it never changes."""
        import pymunk  # only here: rooms in kernels do without

        self.space, self._all = pymunk.Space(), pymunk.ShapeFilter()
        body = self.space.static_body
        outlines = [oriented_edges(floor_plan.outer, solid=False)]
        outlines += [oriented_edges(obstacle, solid=True) for obstacle in floor_plan.obstacles]
        shapes: list[pymunk.Shape] = []
        for edges in outlines:
            shapes += [pymunk.Segment(body, edge[:2], edge[2:], radius) for edge in edges.tolist()]
            # A query that starts beside the end of a segment may miss its rounding, which is in the
            # room where a wall turns right.
            along = edges[:, 2:] - edges[:, :2]
            before = np.roll(along, 1, axis=0)
            right = before[:, 0] * along[:, 1] < before[:, 1] * along[:, 0]
            shapes += [pymunk.Circle(body, radius, tip) for tip in edges[right, :2].tolist()]
        # pymunk's tree of shapes is balanced if neighbours are not added one after the other.
        shuffled = np.random.default_rng(0).permutation(len(shapes))
        self.space.add(*(shapes[i] for i in shuffled))

    def gap(self, centre: Point) -> float:
        """See ``Contacts.gap``."""
        nearest = self.space.point_query_nearest(centre, math.inf, self._all)
        assert nearest is not None  # a room has walls
        return nearest.distance

    def first_contact(self, start: Point, end: Point) -> float:
        """See ``Contacts.first_contact``."""
        contact = self.space.segment_query_first(start, end, 0.0, self._all)
        return math.inf if contact is None else contact.alpha


def contacts_of(world: World) -> Contacts:
    """Return the walls of a world for its robot."""
    if isinstance(world.floor_plan, GridMap):
        return CellContacts(world.floor_plan, world.body)
    assert isinstance(world.floor_plan, PolygonMap)  # the forms of Map
    return WallContacts(world.floor_plan, world.body)


class Body:
    """A robot in a world: it moves with noise, stops at walls, and takes scans."""

    pose: Pose  # the true one (x, y, θ)
    scan: Singles  # the last one, (B,)

    def __init__(
        self,
        pose: Pose,
        walls: Contacts,
        world: World,
        caster: Caster,
        sensor: np.random.Generator,
        motion: np.random.Generator,
    ) -> None:
        """Put the robot of a world at a pose among its walls, and take its first scan.

        Two normal numbers per move are drawn from ``motion``.
        """
        self._walls, self._skin, self._reach = walls, world.skin, world.reach
        self._noise, self._motion = world.noise.sds, motion
        self._sees = caster, world.lidar, sensor
        self._put(pose)
        self.look()

    def move(self, distance: float, turn: float) -> bool:
        """Turn, then drive, with noise; return whether a wall stopped the robot."""
        of_drive, of_turn = self._motion.standard_normal(2).tolist()
        heading, *drive = noisy_drive(
            self.pose[2], distance, turn, (of_drive, of_turn), self._noise, self._reach
        )
        position, collided = self._driven(*drive)
        self.pose = (*position, heading)
        return collided

    def look(self) -> None:
        """Take a scan."""
        self.scan = scanned(self.pose, *self._sees)

    def _put(self, pose: Pose) -> None:
        """Put the robot somewhere, whatever lies between."""
        self.pose = pose
        self._gap = 0.0  # least distance that it can drive without touching a wall

    def _driven(self, way: float, dx: float, dy: float) -> tuple[Point, bool]:
        """Return where a drive along (dx, dy), of length ``way``, ends, and whether at a contact.

        A gap of 40 to the nearest wall allows 40 of driving in any direction: the gap is measured
        only when that is used up, and a contact is computed only if a wall is within reach. A robot
        that overlaps a wall stays there.
        """
        x, y, _ = self.pose
        start, end = (x, y), (x + dx, y + dy)
        if way == 0.0:
            return start, False
        if way >= self._gap - self._skin:
            self._gap = self._walls.gap(start)
            if self._gap < 0.0:
                return start, True
        if way < self._gap - self._skin:
            self._gap -= way
            return end, False
        first = self._walls.first_contact(start, end)
        self._gap = 0.0
        if first == math.inf:
            return end, False
        share = max(first - self._skin / way, 0.0)
        return (x + share * dx, y + share * dy), True


class Episode(Body):
    """All state that changes between two resets.

    ``there`` are the rules in the world as it is, ``arc`` where the robot is on the path, ``way``
    how far along it since reset, jumps included, ``progress`` the same without jumps.
    """

    def __init__(self, rules: RoomRules, walls: Contacts, *, seed: int, number: int) -> None:
        """Begin the ``number``-th episode after seeding, and take its first scan."""
        self._rules = rules
        begun = Beginning.drawn(rules, seed, number)
        self.begun, self.there = begun, begun.there
        self.course, self.plan = begun.course, begun.plan
        world = self.there.world
        self.crowd = begun.crowd()
        solid = walls if self.there is rules else contacts_of(world)
        if self.crowd is not None:
            solid = Crowded(solid, self.crowd, world.body)
        streams = begun.streams(Stream.SENSOR), begun.streams(Stream.MOTION)
        super().__init__(begun.start, solid, world, begun.caster(self.crowd), *streams)
        self.arc = begun.arc
        self.way = self.progress = 0.0
        self.step, self.done, self.ended = 0, False, False

    @property
    def underway(self) -> Underway:
        """What its plan depends on."""
        return Underway(self.step, self.pose, self.arc, self.way)

    def place(self, pose: Pose, noticed: bool = True) -> None:
        """Put the robot at a pose, without progress; if not ``noticed``, a driver's plan stays."""
        journeys, goal = self.there.journeys, self.course.goal
        if isinstance(self.plan, GuidedPlan):
            if not noticed:
                self.plan = self.plan.left_as_it_is(self.underway)
            elif journeys is not None and goal is not None:
                self.course = journeys.onwards(goal, pose)
                self.plan = self.there.plan_for(self.course, self.step)
                self.arc = self.way = 0.0
        self._put(pose)
        path = self.course.path
        before, self.arc = self.arc, path.arc(pose[:2])
        self.way += path.advance(before, self.arc)

    def advance(self, distance: float, turn: float) -> tuple[float, bool]:
        """Turn, drive, take a scan; return the reward, and whether a wall stopped the robot."""
        rules, path = self._rules, self.course.path
        before = self.pose[:2]
        collided = self.move(distance, turn)
        self.step += 1
        self.arc, gained, reward, self.done = judged_step(
            (*before, *self.pose[:2]), self.arc, self.progress, collided,
            path.edges, path.period, self.course.goal or (0.0, 0.0), rules.rewards,
        )  # fmt: skip
        self.way += gained
        self.progress += gained
        if self.crowd is not None:
            self.crowd.walk(self.pose[:2])
            self._put(self.pose)  # who walks may be in the way now
        self.look()
        return reward, collided
