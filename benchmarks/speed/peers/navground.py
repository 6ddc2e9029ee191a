"""navground's ray caster (C++): exact distances to line segments, one pose a call."""

import math
from collections.abc import Sequence

from navground.core import CollisionComputation, LineSegment, Pose2

from deqmcl_gym.maps import PolygonMap

_FAR = 1000.0  # px


class NavgroundCaster:
    """A fan of beams all around, cast by ``CollisionComputation``."""

    def __init__(self, floor_plan: PolygonMap, beams: int) -> None:
        """Build the walls once."""
        self._walls = [LineSegment(wall[:2], wall[2:]) for wall in floor_plan.walls]
        self._computation = CollisionComputation()
        self._steps = beams - 1
        self._length = 2 * math.pi * (1 - 1 / beams)

    def ranges(self, pose: Sequence[float]) -> list[float]:
        """Return the ranges of beams from -π against the heading, (beams,) px."""
        x, y, heading = pose
        self._computation.setup(Pose2((x, y), heading), 0.0, self._walls)
        ranges: list[float] = self._computation.get_free_distance_for_sector(
            heading - math.pi, self._length, self._steps, _FAR, False
        )
        return ranges
