"""Contact of a driving disc with walls: by pymunk for polygons, exact for cells."""

import math

import numpy as np
import pymunk

from deqmcl_gym.maps import GridMap, PolygonMap
from deqmcl_gym.maps.polygons import oriented_edges
from deqmcl_gym.numerics.elementary import cos64, sin64
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.world.config import World
from deqmcl_gym.world.course import Point

_WALLS = pymunk.ShapeFilter()  # the space has nothing but walls


class Cells:
    """The solid cells of a grid, for a robot; the arithmetic is that of ``GridMap.collides``."""

    def __init__(self, floor_plan: GridMap, world: World) -> None:
        self._floor_plan, self._radius = floor_plan, world.body
        self.skin, self.reach = world.skin, world.reach

    def gap(self, centre: Point) -> float:
        """Distance of the disc's rim from the nearest wall, negative if they overlap."""
        return float(self._floor_plan.distance([centre])[0]) - self._radius

    def first_contact(self, start: Point, end: Point) -> float | None:
        """Share of a drive at which a disc that starts clear of walls touches one; None: never."""
        return self._floor_plan.first_contact(start, end, self._radius)


class Walls:
    """The walls of a floor plan in a pymunk space.

    Each wall is grown by the disc's radius, so that its centre touches the grown wall where the
    disc touches the wall (the configuration space of Lozano-Pérez, 1983). pymunk can also sweep a
    disc, but then searches for walls along its centre line only and misses those beside it.

    Attributes:
        space: all walls as static segments; nothing is ever inside an obstacle.
        skin, reach: as of ``World``, like those of ``Cells``.
    """

    def __init__(self, floor_plan: PolygonMap, world: World) -> None:
        """Build the space; it never changes."""
        self.space, radius = pymunk.Space(), world.body
        self.skin, self.reach = world.skin, world.reach
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
        """See ``Cells.gap``."""
        nearest = self.space.point_query_nearest(centre, math.inf, _WALLS)
        assert nearest is not None  # a room has walls
        return nearest.distance

    def first_contact(self, start: Point, end: Point) -> float | None:
        """See ``Cells.first_contact``."""
        contact = self.space.segment_query_first(start, end, 0.0, _WALLS)
        return None if contact is None else contact.alpha


Contacts = Cells | Walls  # what a disc can touch


def contacts_of(world: World) -> Contacts:
    """Return the walls of a world for its robot."""
    if isinstance(world.floor_plan, GridMap):
        return Cells(world.floor_plan, world)
    assert isinstance(world.floor_plan, PolygonMap)  # the forms of Map
    return Walls(world.floor_plan, world)


class Physics:
    """The robot's disc among the walls.

    Attributes:
        walls: of the room.
        position: of the disc's centre; :meth:`place` sets it.
    """

    def __init__(self, walls: Contacts, position: Point) -> None:
        """Put the disc somewhere."""
        self.walls = walls
        self.place(position)

    def place(self, position: Point) -> None:
        """Put the robot somewhere, whatever lies between."""
        self.position = position
        self._gap = 0.0  # least distance that it can drive without touching a wall

    def drive(self, distance: float, heading: float) -> bool:
        """Drive straight ahead; stop just before the first contact. Return whether there was one.

        A gap of 40 to the nearest wall allows 40 of driving in any direction: the gap is measured
        only when that is used up, and a contact is computed only if a wall is within reach. A robot
        that overlaps a wall stays there.
        """
        way = abs(distance)
        if way == 0.0:
            return False
        if way > self.walls.reach:  # beyond every wall; a longer drive would lose precision
            way, distance = self.walls.reach, math.copysign(self.walls.reach, distance)
        if way >= self._gap - self.walls.skin:
            self._gap = self.walls.gap(self.position)
            if self._gap < 0.0:
                return True
        x, y = start = self.position
        dx, dy = distance * cos64(heading), distance * sin64(heading)
        end = (x + dx, y + dy)
        if way < self._gap - self.walls.skin:
            self.position = end
            self._gap -= way
            return False
        first = self.walls.first_contact(start, end)
        if first is None:
            self.place(end)
            return False
        share = max(first - self.walls.skin / way, 0.0)
        self.place((x + share * dx, y + share * dy))
        return True


def _corners_into_the_room(edges: Floats) -> list[Point]:
    """Where a wall with free space to its left turns right."""
    along = edges[:, 2:] - edges[:, :2]
    before = np.roll(along, 1, axis=0)
    right = before[:, 0] * along[:, 1] < before[:, 1] * along[:, 0]
    return [(x, y) for x, y in edges[right, :2].tolist()]
