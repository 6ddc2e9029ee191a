"""The compiled motion of many robots among the walls: float64, one room after the other.

The rule is that of ``deqmcl_gym.physics``: turn, then drive; stop just before the first contact.
"""

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import centred64, cos64, sin64
from deqmcl_gym.path_kernels import follow

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]
_TURN = 2 * np.pi


def sides(walls: Floats) -> Floats:
    """Return walls (x₀, y₀, x₁, y₁) as :func:`step` takes them.

    Returns:
        (x₀, y₀, unit x, unit y, length), (S, 5) px.
    """
    along = walls[:, 2:] - walls[:, :2]
    length = np.hypot(*along.T)[:, None]
    return np.hstack([walls[:, :2], along / length, length])


@compiled
def step(
    poses: Floats,
    gaps: Floats,
    arcs: Floats,
    sums: Floats,
    steps: Ints,
    starts: Floats,
    commands: NDArray[np.float32],
    resting: Bools,
    normals: Floats,
    at: Ints,
    noise: tuple[float, float, float],
    walls: Floats,
    radius: float,
    skin: float,
    edges: Floats,
    length: float,
    near: float,
    most: int,
    penalty: float,
    limit: int,
    rewards: Floats,
    collided: Bools,
    terminated: Bools,
    truncated: Bools,
) -> None:
    """Turn and drive robots; say of all what that is worth, and whose episode ends.

    Args:
        poses: x px, y px, θ rad in [-π, π), (n, 3); changed.
        gaps: how far each robot can drive in any direction without meeting a wall, at least, (n,)
            px; 0 if nobody knows; changed.
        arcs: arc length of the path's point nearest to each, (n,) px; changed.
        sums: progress along the path since reset, (n,) px; changed.
        steps: carried out, (n,); changed.
        starts: where they began, (n, 2+) px.
        commands: distance px, turn rad, (n, 2).
        resting: which robots stay, (n,).
        normals: N(0, 1) for the drive and the turn, (n, rows, 2).
        at: the row of these that each robot takes, (n,); goes on to the next one.
        noise: σ_dd, σ_φφ, σ_φd.
        walls: as :func:`sides` returns them; free space to their left.
        radius: of the robots, px.
        skin: how far before the contact they stop, px.
        edges: of the path, see ``deqmcl_gym.path_kernels``.
        length: of the path, px.
        near: how near to the start a lap ends, px; negative if episodes do not end with it.
        most: steps of a plan.
        penalty: for a contact, px.
        limit: steps of an episode.
        rewards: filled in, (n,) px.
        collided: filled in: whether a wall stopped the robot, (n,).
        terminated: filled in: whether the plan is used up or the lap is done, (n,).
        truncated: filled in: whether the episode is that long, (n,).
    """
    for i in range(resting.size):
        collided[i] = False
        if not resting[i]:
            distance, turn = np.float64(commands[i, 0]), np.float64(commands[i, 1])
            driven = _turn(i, distance, turn, poses, normals[i, at[i]], noise)
            at[i] += 1
            steps[i] += 1
            collided[i] = _drive(i, driven, poses, gaps, walls, radius, skin)
        x, y = poses[i, 0], poses[i, 1]
        arcs[i], progress = follow(x, y, arcs[i], edges, length)
        sums[i] += progress
        rewards[i] = progress - penalty * collided[i]
        dx, dy = x - starts[i, 0], y - starts[i, 1]
        around = np.rint(sums[i] / length) >= 1.0
        truncated[i] = steps[i] >= limit
        terminated[i] = (steps[i] >= most) | (around & (np.sqrt(dx * dx + dy * dy) <= near))


@compiled
def _turn(
    i: int,
    distance: float,
    turn: float,
    poses: Floats,
    normals: Floats,
    noise: tuple[float, float, float],
) -> float:
    """Turn robot i by ``turn`` and noise; return how far it drives then, with noise."""
    of_drive, of_turn, of_drift = noise
    sd_turn = of_turn * abs(turn) + of_drift * distance
    poses[i, 2] = centred64(poses[i, 2] + turn + sd_turn * normals[1], _TURN)
    driven: float = distance * (1 + of_drive * normals[0])
    return driven


@compiled
def _drive(
    i: int, driven: float, poses: Floats, gaps: Floats, walls: Floats, radius: float, skin: float
) -> bool:
    """Drive robot i straight ahead, until just before the first contact; was there one?"""
    way = abs(driven)
    if way == 0.0:
        return False
    x, y, heading = poses[i]
    dx, dy = driven * cos64(heading), driven * sin64(heading)
    collided = False
    if gaps[i] <= way + skin:
        gaps[i] = _gap(x, y, walls) - radius
    if gaps[i] <= way + skin:
        share = 0.0 if gaps[i] < 0.0 else _first_contact(x, y, dx, dy, walls, radius)
        if share < np.inf:
            collided = True
            share = max(share - skin / way, 0.0)
            dx, dy, way = share * dx, share * dy, share * way
    gaps[i] -= way
    poses[i, 0], poses[i, 1] = x + dx, y + dy
    return collided


@compiled
def _gap(x: float, y: float, walls: Floats) -> float:
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
def _first_contact(x: float, y: float, dx: float, dy: float, walls: Floats, radius: float) -> float:
    """Share of the way (dx, dy) at which a disc, clear of the walls, first touches one; or inf."""
    first = np.inf
    square = dx * dx + dy * dy
    for wall in range(walls.shape[0]):
        px, py = x - walls[wall, 0], y - walls[wall, 1]  # seen from the wall's start
        ex, ey, length = walls[wall, 2], walls[wall, 3], walls[wall, 4]
        # the side, from where space is free
        gap = ex * py - ey * px - radius
        sinks = dx * ey - dy * ex  # by so much from start to end of the way
        if 0.0 <= gap < sinks:
            share = gap / sinks
            at = px * ex + py * ey + share * (dx * ex + dy * ey)
            if 0.0 <= at <= length:
                first = min(first, share)
        # the corner at its start
        nears = -(px * dx + py * dy)
        root = nears * nears - square * (px * px + py * py - radius * radius)
        if nears > 0.0 and root >= 0.0:
            share = max(nears - np.sqrt(root), 0.0) / square
            if share <= 1.0:
                first = min(first, share)
    return first
