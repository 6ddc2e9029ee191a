"""Where a disc that drives among walls touches one: polygons by pymunk, cells by their own test."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pymunk
from pymunk.autogeometry import convex_decomposition

from deqmcl_gym.maps import GridMap, Map, PolygonMap
from deqmcl_gym.maps.polygons import oriented_edges
from deqmcl_gym.maps.units import pixel
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.world.setting import SKIN

_WALLS = pymunk.ShapeFilter()  # nothing else is in the space

Point = tuple[float, float]


class Contacts(Protocol):
    """The walls of a floor plan as a disc meets them."""

    @property
    def skin(self) -> float:
        """How far before a contact a disc stops."""
        ...

    def gap(self, centre: Point) -> float:
        """How far the disc's rim is from the nearest wall, negative if they overlap."""
        ...

    def first_contact(self, start: Point, end: Point) -> float | None:
        """Share of a drive at which a disc that starts clear of the walls touches one, if ever."""
        ...


def contacts_of(floor_plan: Map, radius: float) -> Contacts:
    """Return the walls of a floor plan as a disc meets them."""
    if isinstance(floor_plan, GridMap):
        return Cells(floor_plan, radius, SKIN * pixel(floor_plan.unit))
    assert isinstance(floor_plan, PolygonMap)  # the forms of Map
    return Walls(floor_plan, radius)


@dataclass(frozen=True)
class Cells:
    """The solid cells of a grid as a disc meets them: by the arithmetic of ``GridMap.collides``."""

    floor_plan: GridMap
    radius: float
    skin: float

    def gap(self, centre: Point) -> float:
        """See ``Contacts``."""
        return float(self.floor_plan.distance([centre])[0]) - self.radius

    def first_contact(self, start: Point, end: Point) -> float | None:
        """See ``Contacts``."""
        return self.floor_plan.first_contact(start, end, self.radius)


class Walls:
    """The walls of a floor plan in a pymunk space, as a disc meets them.

    Each wall is grown by the disc's radius, so that its centre touches the grown wall where the
    disc touches the wall (the configuration space of Lozano-Pérez, 1983). pymunk could also sweep
    the disc, but looks for walls along the thin line then, and misses those beside it.

    Attributes:
        space: outer walls as segments, obstacles as solid convex pieces; all static.
        skin: how far before a contact a disc stops.
    """

    def __init__(self, floor_plan: PolygonMap, radius: float) -> None:
        """Build the space; it never changes."""
        self.space, self.skin = pymunk.Space(), SKIN * pixel(floor_plan.unit)
        body = self.space.static_body
        edges = oriented_edges(floor_plan.outer, solid=False)
        for x0, y0, x1, y1 in edges.tolist():
            self.space.add(pymunk.Segment(body, (x0, y0), (x1, y1), radius))
        # A query that starts beside the end of a segment may miss its rounding.
        for tip in _corners_into_the_room(edges):
            self.space.add(pymunk.Circle(body, radius, tip))
        for obstacle in floor_plan.obstacles:
            corners = oriented_edges(obstacle, solid=False)[:, :2].tolist()
            for piece in convex_decomposition([*corners, corners[0]], 0.0):
                self.space.add(pymunk.Poly(body, piece, radius=radius))

    def gap(self, centre: Point) -> float:
        """See ``Contacts``."""
        nearest = self.space.point_query_nearest(centre, math.inf, _WALLS)
        assert nearest is not None  # a room has walls
        return nearest.distance

    def first_contact(self, start: Point, end: Point) -> float | None:
        """See ``Contacts``."""
        contact = self.space.segment_query_first(start, end, 0.0, _WALLS)
        return None if contact is None else contact.alpha


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
        self._gap = 0.0  # it can drive so far without meeting a wall, at least

    def drive(self, distance: float, heading: float) -> bool:
        """Drive straight ahead; stop just before the first contact. Return whether there was one.

        The contact is asked for only if the nearest wall can be reached, and how far that is only
        if it may be: a gap of 40 is good for 40 of driving, in whatever direction. A robot
        that overlaps a wall stays there.
        """
        way = abs(distance)
        if way == 0.0:
            return False
        if way >= self._gap - self.walls.skin:
            self._gap = self.walls.gap(self.position)
            if self._gap < 0.0:
                return True
        x, y = start = self.position
        dx, dy = distance * math.cos(heading), distance * math.sin(heading)
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
    """Where a counterclockwise outer wall turns right."""
    along = edges[:, 2:] - edges[:, :2]
    before = np.roll(along, 1, axis=0)
    right = before[:, 0] * along[:, 1] < before[:, 1] * along[:, 0]
    return [(x, y) for x, y in edges[right, :2].tolist()]
