"""Compiled contact of a driving disc with walls or solid squares: where a drive is stopped."""

import numpy as np

from deqmcl_gym.maps.grid_kernels import locate
from deqmcl_gym.maps.stride_kernels import Reach
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Floats


@compiled
def first_contact(
    start: tuple[float, float],
    end: tuple[float, float],
    reach: Reach,
    frame: tuple[float, ...],
    radius: float,
) -> float:
    """Share of the way at which a disc that starts clear of solid cells touches one; inf if never.

    Positions are in cells; see ``grid_kernels``. The disc's centre then meets the square grown by
    the radius: a slab along each axis, a circle around each corner.
    """
    points = np.array(((start[0], end[0]), (start[1], end[1])))
    us, vs = np.empty(2), np.empty(2)
    locate(points, frame, us, vs)
    u, v, du, dv, r = us[0], vs[0], us[1] - us[0], vs[1] - vs[0], radius / frame[4]
    rows, columns = reach.shape
    low = max(int(np.ceil(min(v, v + dv) - r)) - 1, 0)
    high = min(int(np.floor(max(v, v + dv) + r)), rows - 1)
    left = max(int(np.ceil(min(u, u + du) - r)) - 1, 0)
    right = min(int(np.floor(max(u, u + du) + r)), columns - 1)
    first = np.inf
    for row in range(low, high + 1):
        for column in range(left, right + 1):
            if reach[row, column] == 0:
                x, y = u - column, v - row  # seen from the square's lower left corner
                first = min(first, _meets_box(x, y, du, dv, -r, 1.0 + r, 0.0, 1.0))
                first = min(first, _meets_box(x, y, du, dv, 0.0, 1.0, -r, 1.0 + r))
                for corner in range(4):
                    cx, cy = x - corner % 2, y - corner // 2
                    first = min(first, enters_circle(cx, cy, du, dv, r))
    return first


@compiled
def _meets_box(
    x: float, y: float, dx: float, dy: float, left: float, right: float, low: float, high: float
) -> float:
    """Share of (dx, dy) at which a point from outside enters a rectangle; inf if never."""
    enter, leave = 0.0, 1.0
    for at, way, least, most in ((x, dx, left, right), (y, dy, low, high)):
        if way == 0.0:
            if not least <= at <= most:
                return np.inf
        else:
            one, two = (least - at) / way, (most - at) / way
            enter, leave = max(enter, min(one, two)), min(leave, max(one, two))
    return enter if enter <= leave else np.inf


@compiled
def enters_circle(x: float, y: float, dx: float, dy: float, radius: float) -> float:
    """Share of (dx, dy) at which a point from outside enters a circle around 0; inf if never."""
    square, nears = dx * dx + dy * dy, -(x * dx + y * dy)
    root = nears * nears - square * (x * x + y * y - radius * radius)
    if not (nears > 0.0 and root >= 0.0):
        return np.inf
    share = max(nears - np.sqrt(root), 0.0) / square
    return share if share <= 1.0 else np.inf


@compiled
def gap_to_walls(x: float, y: float, walls: Floats) -> float:
    """Distance of a point to the nearest wall."""
    least = np.inf
    for wall in range(walls.shape[0]):
        px, py = x - walls[wall, 0], y - walls[wall, 1]  # seen from the wall's start
        ex, ey, length = walls[wall, 2], walls[wall, 3], walls[wall, 4]
        along = px * ex + py * ey
        beyond = along - min(max(along, 0.0), length)
        height = ex * py - ey * px
        least = min(least, height * height + beyond * beyond)
    distance: float = np.sqrt(least)
    return distance


@compiled
def first_contact_with_walls(
    x: float, y: float, dx: float, dy: float, walls: Floats, radius: float
) -> float:
    """Share of (dx, dy) at which a disc that starts clear of walls first touches one; or inf."""
    first: float = np.inf
    for wall in range(walls.shape[0]):
        px, py = x - walls[wall, 0], y - walls[wall, 1]  # seen from the wall's start
        ex, ey, length = walls[wall, 2], walls[wall, 3], walls[wall, 4]
        # the side of the wall in free space
        gap = ex * py - ey * px - radius
        sinks = dx * ey - dy * ex  # decrease of the gap along the drive
        if 0.0 <= gap < sinks:
            share = gap / sinks
            at = px * ex + py * ey + share * (dx * ex + dy * ey)
            if 0.0 <= at <= length:
                first = min(first, share)
        # the corner at its start
        first = min(first, enters_circle(px, py, dx, dy, radius))
    return first
