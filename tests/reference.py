"""The plain NumPy form of the geometry, in float64: the oracle of the tests.

Same definitions as ``PolygonMap``'s methods, none of their code: whole arrays, all walls against
all items, nothing clever.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.numerics import Floats


def ranges(walls: ArrayLike, poses: ArrayLike, bearings: ArrayLike) -> Floats:
    """Distance along each beam to the nearest wall segment; inf where there is none, (n, B)."""
    poses, walls = np.asarray(poses, dtype=np.float64), np.asarray(walls, dtype=np.float64)
    angles = poses[:, 2, None] + np.asarray(bearings, dtype=np.float64)  # (n, B)
    dx, dy = np.cos(angles)[..., None], np.sin(angles)[..., None]  # (n, B, 1)
    along = walls[:, 2:] - walls[:, :2]  # (S, 2)
    rx, ry = (walls[:, :2] - poses[:, None, :2])[:, None].transpose(3, 0, 1, 2)  # (n, 1, S)
    with np.errstate(divide="ignore", invalid="ignore"):
        denominator = dx * along[:, 1] - dy * along[:, 0]
        t = (rx * along[:, 1] - ry * along[:, 0]) / denominator  # along the beam
        u = (rx * dy - ry * dx) / denominator  # along the wall, 0 to 1
        hit = (t >= 0) & (u >= 0) & (u <= 1)
    nearest: Floats = np.where(hit, t, np.inf).min(axis=2)
    return nearest


def clearance(walls: ArrayLike, starts: ArrayLike, ends: ArrayLike) -> Floats:
    """Distance between each path and the nearest wall; 0 where they cross, (n,)."""
    walls = np.asarray(walls, dtype=np.float64)
    a, b = np.asarray(starts, float)[:, None, :2], np.asarray(ends, float)[:, None, :2]  # (n, 1, 2)
    c, d = walls[None, :, :2], walls[None, :, 2:]  # (1, S, 2)
    ends_and_others = (a, c, d), (b, c, d), (c, a, b), (d, a, b)
    near = np.minimum.reduce([_point_to_segment(*three) for three in ends_and_others])
    crossing = (_side(c, d, a) * _side(c, d, b) < 0) & (_side(a, b, c) * _side(a, b, d) < 0)
    least: Floats = np.where(crossing, 0.0, near).min(axis=1)
    return least


def winding(walls: ArrayLike, points: ArrayLike) -> NDArray[np.int64]:
    """How often the walls wind counterclockwise around each point, by summing angles, (n,)."""
    walls, points = np.asarray(walls, dtype=np.float64), np.asarray(points, dtype=np.float64)
    to_start = walls[None, :, :2] - points[:, None, :2]
    to_end = walls[None, :, 2:] - points[:, None, :2]
    cross = to_start[..., 0] * to_end[..., 1] - to_start[..., 1] * to_end[..., 0]
    dot = (to_start * to_end).sum(axis=2)
    turns: NDArray[np.int64] = np.rint(np.arctan2(cross, dot).sum(axis=1) / (2 * np.pi)).astype(int)
    return turns


def mounted(poses: ArrayLike, place: tuple[float, float]) -> Floats:
    """Poses of a lidar at ``place`` on robots at ``poses``, (n, 3), by plain trigonometry."""
    x, y, heading = np.asarray(poses, dtype=np.float64).T
    (ahead, aside), cosine, sine = place, np.cos(heading), np.sin(heading)
    at = [x + ahead * cosine - aside * sine, y + ahead * sine + aside * cosine]
    return np.column_stack([*at, heading])


def _point_to_segment(p: Floats, a: Floats, b: Floats) -> Floats:
    along = b - a
    square = (along**2).sum(axis=-1)
    share = ((p - a) * along).sum(axis=-1) / np.where(square > 0, square, 1.0)
    foot = a + np.clip(share, 0, 1)[..., None] * along
    distance: Floats = np.sqrt(((p - foot) ** 2).sum(axis=-1))
    return distance


def _side(a: Floats, b: Floats, p: Floats) -> Floats:
    """Twice the signed area of a, b, p: positive if p lies to the left of a → b."""
    area: Floats = (b - a)[..., 0] * (p - a)[..., 1] - (b - a)[..., 1] * (p - a)[..., 0]
    return area
