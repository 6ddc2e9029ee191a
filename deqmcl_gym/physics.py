"""The pymunk world: static walls, and where a disc that drives among them touches one."""

import math
from functools import lru_cache

import pymunk
from pymunk.autogeometry import convex_decomposition

from deqmcl_gym.floorplan import FloorPlan
from deqmcl_gym.floorplan.polygons import oriented_edges

_WALLS = pymunk.ShapeFilter()  # nothing else is in the space
# A stopped robot stands this far before the contact, so that it can drive away again.
SKIN = 1e-3  # px

Point = tuple[float, float]


class Physics:
    """A pymunk space with the floor plan's walls, and the robot's disc that queries sweep. In px.

    Attributes:
        space: the walls.
        radius: of the disc.
        position: of its centre; :meth:`place` sets it.
    """

    def __init__(self, floor_plan: FloorPlan, radius: float, position: Point) -> None:
        """Build the space anew: one per episode, so that nothing outlives its episode."""
        self.space = pymunk.Space()
        self.space.add(*_wall_shapes(floor_plan, self.space.static_body))
        self.radius = radius
        self.place(position)

    def place(self, position: Point) -> None:
        """Put the robot somewhere, whatever lies between."""
        self.position = position
        self._free_way = 0.0  # drives that add up to less meet no wall, in whatever direction

    def drive(self, distance: float, heading: float) -> bool:
        """Drive straight ahead; stop just before the first contact. Return whether there was one.

        pymunk is asked for the nearest wall, and again only after as much has been driven as could
        lead there. Where a step could, it is asked for the contact. A robot that overlaps a wall
        stays there.
        """
        if distance == 0.0:
            return False
        x, y = start = self.position
        dx, dy = distance * math.cos(heading), distance * math.sin(heading)
        self.position = (x + dx, y + dy)
        self._free_way -= abs(distance)
        if self._free_way > 0.0:
            return False
        gap = self._gap(start)
        self._free_way = gap - SKIN - abs(distance)
        if self._free_way > 0.0:
            return False
        first = 0.0 if gap < 0.0 else self._first_contact(start, self.position)
        if first is None:
            return False
        share = max(first - SKIN / abs(distance), 0.0)
        self.place((x + share * dx, y + share * dy))
        return True

    def _gap(self, position: Point) -> float:
        """Distance from the disc's rim to the nearest wall, negative if they overlap."""
        nearest = self.space.point_query_nearest(position, math.inf, _WALLS)
        assert nearest is not None  # a room has walls
        return nearest.distance - self.radius

    def _first_contact(self, start: Point, end: Point) -> float | None:
        """Share of the way at which the swept disc first touches a wall.

        By pymunk's segment query of each wall near the way: the space's own looks for walls along
        the thin line only, and finds none that the line itself does not meet.
        """
        (x0, y0), (x1, y1), reach = start, end, self.radius + SKIN
        box = pymunk.BB(
            min(x0, x1) - reach, min(y0, y1) - reach, max(x0, x1) + reach, max(y0, y1) + reach
        )
        near = self.space.bb_query(box, _WALLS)
        contacts = (wall.segment_query(start, end, self.radius) for wall in near)
        return min((contact.alpha for contact in contacts if contact is not None), default=None)


def _wall_shapes(floor_plan: FloorPlan, body: pymunk.Body) -> list[pymunk.Shape]:
    """Outer walls as segments, obstacles as solid convex pieces."""
    segments, pieces = _outlines(floor_plan)
    return [
        *(pymunk.Segment(body, start, end, 0.0) for start, end in segments),
        *(pymunk.Poly(body, corners) for corners in pieces),
    ]


@lru_cache(maxsize=16)
def _outlines(floor_plan: FloorPlan) -> tuple[list[tuple[Point, Point]], list[list[Point]]]:
    """End points of segments and corners of pieces, found once for all episodes in a plan."""
    outer = oriented_edges(floor_plan.outer, solid=False).tolist()
    segments = [((x0, y0), (x1, y1)) for x0, y0, x1, y1 in outer]
    pieces: list[list[Point]] = []
    for obstacle in floor_plan.obstacles:
        corners = oriented_edges(obstacle, solid=False)[:, :2].tolist()
        convex = convex_decomposition([*corners, corners[0]], 0.0)
        pieces += [[(x, y) for x, y in piece] for piece in convex]
    return segments, pieces
