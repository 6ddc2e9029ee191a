"""The pymunk world: a disc among static walls, and where it touches them."""

import math

import pymunk
from pymunk.autogeometry import convex_decomposition

from deqmcl_gym.floorplan import FloorPlan
from deqmcl_gym.floorplan.polygons import oriented_edges

_WALLS = 0b01
_ROBOT = 0b10
_SEES_WALLS = pymunk.ShapeFilter(mask=_WALLS)
# A stopped robot stands this far before the contact, so that it can drive away again.
SKIN = 1e-3  # px


class Physics:
    """A pymunk space with the floor plan's walls and the robot's disc. Units px."""

    def __init__(self, floor_plan: FloorPlan, radius: float, position: tuple[float, float]) -> None:
        """Build the space anew: one per episode, so that no contact outlives its episode."""
        self.space = pymunk.Space()
        self.radius = radius
        self._walls = _wall_shapes(floor_plan, self.space.static_body)
        for shape in self._walls:
            shape.filter = pymunk.ShapeFilter(categories=_WALLS)
            self.space.add(shape)
        self.robot = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        disc = pymunk.Circle(self.robot, radius)
        disc.filter = pymunk.ShapeFilter(categories=_ROBOT)
        self.space.add(self.robot, disc)
        self.robot.position = position

    @property
    def position(self) -> tuple[float, float]:
        """Centre of the disc, px."""
        x, y = self.robot.position
        return float(x), float(y)

    def clear_at(self, position: tuple[float, float]) -> bool:
        """Whether the disc would touch no wall there."""
        near = self.space.point_query_nearest(position, self.radius, _SEES_WALLS)
        return near is None

    def place(self, position: tuple[float, float]) -> None:
        """Put the robot somewhere, whatever lies between."""
        self.robot.position = position

    def drive(self, distance: float, heading: float) -> bool:
        """Drive straight ahead; stop just before the first contact. Return whether there was one.

        The disc is swept by pymunk's segment query, wall by wall: the space's own looks for walls
        along the thin line only, and finds none that the line does not meet. Either misses walls
        which the disc overlaps at the start; a point query finds those, and the robot stays there.
        """
        if distance == 0.0:
            return False
        x, y = self.robot.position
        dx, dy = distance * math.cos(heading), distance * math.sin(heading)
        if not self.clear_at((x, y)):
            return True
        contacts = (
            wall.segment_query((x, y), (x + dx, y + dy), self.radius) for wall in self._walls
        )
        first = min((contact.alpha for contact in contacts if contact is not None), default=None)
        if first is None:
            self.robot.position = (x + dx, y + dy)
            return False
        share = max(first - SKIN / abs(distance), 0.0)
        self.robot.position = (x + share * dx, y + share * dy)
        return True


def _wall_shapes(floor_plan: FloorPlan, body: pymunk.Body) -> list[pymunk.Shape]:
    """Outer walls as segments, obstacles as solid convex pieces."""
    shapes: list[pymunk.Shape] = [
        pymunk.Segment(body, (x0, y0), (x1, y1), 0.0)
        for x0, y0, x1, y1 in oriented_edges(floor_plan.outer, solid=False).tolist()
    ]
    for obstacle in floor_plan.obstacles:
        corners = oriented_edges(obstacle, solid=False)[:, :2].tolist()
        pieces = convex_decomposition([*corners, corners[0]], 0.0)
        shapes += [pymunk.Poly(body, piece) for piece in pieces]
    return shapes
