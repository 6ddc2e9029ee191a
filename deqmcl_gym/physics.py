"""The pymunk world: static walls, and where a disc that drives among them touches one."""

import math

import pymunk
from pymunk.autogeometry import convex_decomposition

from deqmcl_gym.floorplan import FloorPlan
from deqmcl_gym.floorplan.polygons import oriented_edges

_WALLS = pymunk.ShapeFilter()  # nothing else is in the space
# A stopped robot stands this far before the contact, so that it can drive away again.
SKIN = 1e-3  # px

Point = tuple[float, float]


class Walls:
    """A floor plan in a pymunk space, to be asked and never changed. Units px.

    Attributes:
        space: outer walls as segments, obstacles as solid convex pieces; all static.
    """

    def __init__(self, floor_plan: FloorPlan) -> None:
        """Build the space; the robot is no part of it: queries sweep its disc through."""
        self.space = pymunk.Space()
        body = self.space.static_body
        for x0, y0, x1, y1 in oriented_edges(floor_plan.outer, solid=False).tolist():
            self.space.add(pymunk.Segment(body, (x0, y0), (x1, y1), 0.0))
        for obstacle in floor_plan.obstacles:
            corners = oriented_edges(obstacle, solid=False)[:, :2].tolist()
            for piece in convex_decomposition([*corners, corners[0]], 0.0):
                self.space.add(pymunk.Poly(body, piece))

    def distance(self, position: Point) -> float:
        """How far the nearest wall is, negative inside an obstacle."""
        nearest = self.space.point_query_nearest(position, math.inf, _WALLS)
        assert nearest is not None  # a room has walls
        return nearest.distance

    def first_contact(self, start: Point, end: Point, radius: float) -> float | None:
        """Share of the way from start to end at which a disc first touches a wall, if it does.

        By pymunk's segment query of each wall near the way: the space's own looks for walls along
        the thin line only, and finds none that the line itself does not meet.
        """
        (x0, y0), (x1, y1), reach = start, end, radius + SKIN
        box = pymunk.BB(
            min(x0, x1) - reach, min(y0, y1) - reach, max(x0, x1) + reach, max(y0, y1) + reach
        )
        near = self.space.bb_query(box, _WALLS)
        contacts = (wall.segment_query(start, end, radius) for wall in near)
        return min((contact.alpha for contact in contacts if contact is not None), default=None)


class Physics:
    """The robot's disc among the walls.

    Attributes:
        walls: of the room.
        radius: of the disc, px.
        position: of its centre, px; :meth:`place` sets it.
    """

    def __init__(self, walls: Walls, radius: float, position: Point) -> None:
        """Put a disc of some radius somewhere."""
        self.walls = walls
        self.radius = radius
        self.place(position)

    def place(self, position: Point) -> None:
        """Put the robot somewhere, whatever lies between."""
        self.position = position
        self._free_way = 0.0  # drives that add up to less meet no wall, in whatever direction

    def drive(self, distance: float, heading: float) -> bool:
        """Drive straight ahead; stop just before the first contact. Return whether there was one.

        The distance to the nearest wall is asked for, and again only after as much has been driven
        as could lead there; the contact only where the step could. A robot that overlaps a wall
        stays there.
        """
        if distance == 0.0:
            return False
        x, y = start = self.position
        dx, dy = distance * math.cos(heading), distance * math.sin(heading)
        self.position = end = (x + dx, y + dy)
        self._free_way -= abs(distance)
        if self._free_way > 0.0:
            return False
        gap = self.walls.distance(start) - self.radius
        self._free_way = gap - SKIN - abs(distance)
        if self._free_way > 0.0:
            return False
        first = 0.0 if gap < 0.0 else self.walls.first_contact(start, end, self.radius)
        if first is None:
            return False
        share = max(first - SKIN / abs(distance), 0.0)
        self.place((x + share * dx, y + share * dy))
        return True
