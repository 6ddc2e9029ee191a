"""raycast2D (C): Bresenham lines through an image of the map, one pose a call."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from raycast2D import Lidar2D

from deqmcl_gym.maps import PolygonMap

_FAR = 500  # px, beyond every wall


def caster(floor_plan: PolygonMap, beams: int) -> Callable[[Sequence[float]], NDArray[np.uint32]]:
    """Return what gives the pixels (column, row), of 1 px, that beams hit at a pose, (beams, 2)."""
    x0, y0, x1, y1 = floor_plan.bounds
    rows, columns = np.mgrid[: math.ceil(y1 - y0), : math.ceil(x1 - x0)]
    centres = np.column_stack([columns.ravel() + x0 + 0.5, rows.ravel() + y0 + 0.5])
    image = floor_plan.free(centres).reshape(rows.shape).astype(np.uint8)
    lidar = Lidar2D(num_rays=beams, FOV=360 - 360 / beams, ray_length=_FAR, occupancy_grid=image)
    # it turns a fan of 360° - 360°/beams to both sides alike, from 90° against the x axis
    turn = math.pi / 2 - math.pi / beams

    def hits(pose: Sequence[float]) -> NDArray[np.uint32]:
        x, y, heading = pose
        seen: NDArray[np.uint32] = lidar.scan(
            (int(x - x0), int(y - y0), heading + turn), only_true_collisions=False
        )
        return seen

    return hits
