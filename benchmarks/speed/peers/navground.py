"""navground's ray caster (C++): exact distances to line segments, one pose a call."""

import math
from collections.abc import Callable, Sequence

from navground.core import CollisionComputation, LineSegment, Pose2

from deqmcl_gym.maps import PolygonMap

_FAR = 1000.0  # px


def caster(floor_plan: PolygonMap, beams: int) -> Callable[[Sequence[float]], list[float]]:
    """Return what gives the ranges at a pose, (beams,) px."""
    walls = [LineSegment(wall[:2], wall[2:]) for wall in floor_plan.walls]
    computation = CollisionComputation()
    length = 2 * math.pi * (1 - 1 / beams)

    def ranges(pose: Sequence[float]) -> list[float]:
        x, y, heading = pose
        computation.setup(Pose2((x, y), heading), 0.0, walls)
        seen: list[float] = computation.get_free_distance_for_sector(
            heading - math.pi, length, beams - 1, _FAR, False
        )
        return seen

    return ranges
