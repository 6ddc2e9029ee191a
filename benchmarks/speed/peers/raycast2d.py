"""raycast2D (C): Bresenham lines through an image of the map, one pose a call."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from raycast2D import Lidar2D

from deqmcl_gym.maps import PolygonMap

_FAR = 500  # px, beyond every wall


class GridCaster:
    """A fan of beams all around, in pixels of 1 px."""

    def __init__(self, floor_plan: PolygonMap, beams: int) -> None:
        """Paint the map once."""
        x0, y0, x1, y1 = floor_plan.bounds
        self._corner = x0, y0
        rows, columns = np.mgrid[: math.ceil(y1 - y0), : math.ceil(x1 - x0)]
        centres = np.column_stack([columns.ravel() + x0 + 0.5, rows.ravel() + y0 + 0.5])
        image = floor_plan.free(centres).reshape(rows.shape).astype(np.uint8)
        # it turns a fan of 360° - 360°/beams to both sides alike, from 90° against the x axis
        self._turn = math.pi / 2 - math.pi / beams
        self._lidar = Lidar2D(
            num_rays=beams, FOV=360 - 360 / beams, ray_length=_FAR, occupancy_grid=image
        )

    def hits(self, pose: Sequence[float]) -> NDArray[np.uint32]:
        """Return the pixel (column, row) that each beam hits, from -π on, (beams, 2)."""
        x, y, heading = pose
        pixel = int(x - self._corner[0]), int(y - self._corner[1])
        hits: NDArray[np.uint32] = self._lidar.scan(
            (*pixel, heading + self._turn), only_true_collisions=False
        )
        return hits
