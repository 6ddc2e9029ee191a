"""Episode: a robot in a world, from reset to the end of its plan.

Contact of the driving disc with walls is by pymunk for polygons, exact for cells.
"""

import math
from typing import TYPE_CHECKING

import numpy as np
import pymunk

from deqmcl_gym.maps import GridMap, PolygonMap
from deqmcl_gym.maps.polygons import oriented_edges
from deqmcl_gym.numerics import Floats, Point, Pose, Singles
from deqmcl_gym.world.config import Route, World
from deqmcl_gym.world.driver import GuidedPlan, Underway
from deqmcl_gym.world.path_kernels import judged_step, noisy_drive
from deqmcl_gym.world.people import Contacts, Crowded
from deqmcl_gym.world.reality import Beginning
from deqmcl_gym.world.rules import RoomRules
from deqmcl_gym.world.sensor import LidarSensor, Stream, episode_stream

if TYPE_CHECKING:  # OpenCV is only loaded for pictures
    from deqmcl_gym.world.drawing import Drawing, View

_WALLS = pymunk.ShapeFilter()  # the space has nothing but walls


class CellContacts:
    """The solid cells of a grid; the arithmetic is that of ``GridMap.collides``."""

    def __init__(self, floor_plan: GridMap, radius: float) -> None:
        self._floor_plan, self._radius = floor_plan, radius

    def gap(self, centre: Point) -> float:
        """See ``Contacts.gap``."""
        return float(self._floor_plan.distance([centre])[0]) - self._radius

    def first_contact(self, start: Point, end: Point) -> float | None:
        """See ``Contacts.first_contact``."""
        return self._floor_plan.first_contact(start, end, self._radius)


class WallContacts:
    """The walls of a floor plan in a pymunk space, as static segments.

    Each wall is grown by the disc's radius, so that its centre touches the grown wall where the
    disc touches the wall (the configuration space of Lozano-Pérez, 1983). pymunk can also sweep a
    disc, but then searches for walls along its centre line only and misses those beside it.
    """

    def __init__(self, floor_plan: PolygonMap, radius: float) -> None:
        """Build the space; it never changes."""
        self.space = pymunk.Space()
        body = self.space.static_body
        outlines = [oriented_edges(floor_plan.outer, solid=False)]
        outlines += [oriented_edges(obstacle, solid=True) for obstacle in floor_plan.obstacles]
        shapes: list[pymunk.Shape] = []
        for edges in outlines:
            shapes += [pymunk.Segment(body, edge[:2], edge[2:], radius) for edge in edges.tolist()]
            # A query that starts beside the end of a segment may miss its rounding.
            shapes += [pymunk.Circle(body, radius, tip) for tip in _corners_into_the_room(edges)]
        # pymunk's tree of shapes is balanced if neighbours are not added one after the other.
        shuffled = np.random.default_rng(0).permutation(len(shapes))
        self.space.add(*(shapes[i] for i in shuffled))

    def gap(self, centre: Point) -> float:
        """See ``Contacts.gap``."""
        nearest = self.space.point_query_nearest(centre, math.inf, _WALLS)
        assert nearest is not None  # a room has walls
        return nearest.distance

    def first_contact(self, start: Point, end: Point) -> float | None:
        """See ``Contacts.first_contact``."""
        contact = self.space.segment_query_first(start, end, 0.0, _WALLS)
        return None if contact is None else contact.alpha


def contacts_of(world: World) -> Contacts:
    """Return the walls of a world for its robot."""
    if isinstance(world.floor_plan, GridMap):
        return CellContacts(world.floor_plan, world.body)
    assert isinstance(world.floor_plan, PolygonMap)  # the forms of Map
    return WallContacts(world.floor_plan, world.body)


def _corners_into_the_room(edges: Floats) -> list[Point]:
    """Where a wall with free space to its left turns right."""
    along = edges[:, 2:] - edges[:, :2]
    before = np.roll(along, 1, axis=0)
    right = before[:, 0] * along[:, 1] < before[:, 1] * along[:, 0]
    return [(x, y) for x, y in edges[right, :2].tolist()]


class Body:
    """A robot in a world: it moves with noise, stops at walls, and takes scans."""

    pose: Pose  # the true one (x, y, θ)
    scan: Singles  # the last one, (B,)

    def __init__(
        self,
        pose: Pose,
        walls: Contacts,
        world: World,
        sensor: LidarSensor,
        motion: np.random.Generator,
    ) -> None:
        """Put the robot of a world at a pose among its walls, and take its first scan.

        Two normal numbers per move are drawn from ``motion``.
        """
        self._walls, self._skin, self._reach = walls, world.skin, world.reach
        self._noise, self._sensor, self._motion = world.noise.sds, sensor, motion
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
        self.scan = self._sensor.scan(self.pose)

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
        if first is None:
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
        self._seed, self._number = seed, number
        begun = Beginning.drawn(rules, seed, number)
        self.there, self._reality = begun.there, begun.reality
        self.course, self.plan, self.pose = begun.course, begun.plan, begun.start
        world = self.there.world
        self._crowd = self._reality.crowd(self.pose[:2], self.stream)
        caster = self._reality.caster(self._crowd, self.stream)
        datum, noise = world.floor_plan.datum, self.stream(Stream.SENSOR)
        sensor = LidarSensor(caster, datum, world.lidar, noise)
        solid = walls if self.there is rules else contacts_of(world)
        if self._crowd is not None:
            solid = Crowded(solid, self._crowd, world.body)
        super().__init__(self.pose, solid, world, sensor, self.stream(Stream.MOTION))
        self.arc = begun.arc
        self.way = self.progress = 0.0
        self.step, self.done, self.ended = 0, False, False

    @property
    def underway(self) -> Underway:
        """What its plan depends on."""
        return Underway(self.step, self.pose, self.arc, self.way)

    def picture(self, view: "View") -> "Drawing":
        """Draw what is there, without the robot."""
        return self._reality.picture(view, self._crowd)

    def stream(self, stream: Stream, twin: int = 0) -> np.random.Generator:
        """Return the random stream of one source in this episode, from its beginning."""
        return episode_stream(self._seed, self._number, stream, twin)

    def place(self, pose: Pose, noticed: bool = True) -> None:
        """Put the robot at a pose; this does not count as progress.

        Unless it is ``noticed``, a driver does not replan: its plan stays as it is.
        """
        journeys, goal, onwards = self.there.journeys, self.course.goal, None
        if isinstance(self.plan, GuidedPlan):
            if not noticed:
                self.plan = self.plan.left_as_it_is(self.underway)
            elif journeys is not None and goal is not None:
                onwards = journeys.onwards(goal, pose)
        self._put(pose)
        if onwards is not None:
            self.course = onwards
            self.plan = self.there.plan_for(self.course, self.step)
            self.arc = self.way = 0.0
            return
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
            path.edges, path.period, rules.rewards,
        )  # fmt: skip
        self.way += gained
        self.progress += gained
        if rules.world.route is not None and self._is_at_goal(rules.world.route):
            reward, self.done = reward + rules.rewards[1], True
        if self._crowd is not None:
            self._crowd.walk(self.pose[:2])
            self._put(self.pose)  # who walks may be in the way now
        self.look()
        return reward, collided

    def _is_at_goal(self, route: Route) -> bool:
        """Whether the robot is at the end of its route, if that ends the episode."""
        goal = self.course.goal
        if goal is None or not self._rules.ends_at_goal:
            return False
        dx, dy = self.pose[0] - goal[0], self.pose[1] - goal[1]
        return bool(np.sqrt(dx * dx + dy * dy) <= route.tolerance)
