"""The compiled motion of many robots among the walls: float64, one room after the other.

The rule is that of ``deqmcl_gym.physics``: turn, then drive; stop just before the first contact.
"""

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos64, sin64

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]


def sides(walls: Floats) -> Floats:
    """Return walls (x₀, y₀, x₁, y₁) as :func:`drive` takes them.

    Returns:
        (x₀, y₀, unit x, unit y, length), (S, 5) px.
    """
    along = walls[:, 2:] - walls[:, :2]
    length = np.hypot(*along.T)[:, None]
    return np.hstack([walls[:, :2], along / length, length])


@compiled
def drive(
    poses: Floats,
    gaps: Floats,
    commands: NDArray[np.float32],
    normals: Floats,
    at: Ints,
    among: Bools,
    noise: tuple[float, float, float],
    walls: Floats,
    radius: float,
    skin: float,
    steps: Ints,
    collided: Bools,
) -> None:
    """Turn and drive the robots ``among``, in place: one step.

    Args:
        poses: x px, y px, θ rad in [-π, π), (n, 3).
        gaps: how far each robot can drive in any direction without meeting a wall, at least, (n,)
            px; 0 if nobody knows.
        commands: distance px, turn rad, (n, 2).
        normals: N(0, 1) for the drive and the turn, (n, rows, 2).
        at: the row of these that each robot takes, (n,); goes on to the next one.
        among: which robots move, (n,).
        noise: σ_dd, σ_φφ, σ_φd.
        walls: as :func:`sides` returns them; free space to their left.
        radius: of the robots, px.
        skin: how far before the contact they stop, px.
        steps: carried out, (n,); one more.
        collided: filled in: whether a wall stopped the robot, (n,).
    """
    of_drive, of_turn, of_drift = noise
    for i in range(among.size):
        collided[i] = False
        if not among[i]:
            continue
        normal_drive, normal_turn = normals[i, at[i]]
        at[i] += 1
        steps[i] += 1
        distance, turn = np.float64(commands[i, 0]), np.float64(commands[i, 1])
        sd_turn = of_turn * abs(turn) + of_drift * distance
        heading = poses[i, 2] + turn + sd_turn * normal_turn
        heading = (heading + np.pi) % (2 * np.pi) - np.pi
        poses[i, 2] = heading
        driven = distance * (1 + of_drive * normal_drive)
        way = abs(driven)
        if way == 0.0:
            continue
        x, y = poses[i, 0], poses[i, 1]
        dx, dy = driven * cos64(heading), driven * sin64(heading)
        if gaps[i] <= way + skin:
            gaps[i] = _gap(x, y, walls) - radius
        if gaps[i] <= way + skin:
            share = 0.0 if gaps[i] < 0.0 else _first_contact(x, y, dx, dy, walls, radius)
            if share < np.inf:
                collided[i] = True
                share = max(share - skin / way, 0.0)
                dx, dy, way = share * dx, share * dy, share * way
        gaps[i] -= way
        poses[i, 0], poses[i, 1] = x + dx, y + dy


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


@compiled
def judge(
    progress: Floats,
    collided: Bools,
    penalty: float,
    sums: Floats,
    lap: tuple[float, float],
    poses: Floats,
    starts: Floats,
    steps: Ints,
    most: int,
    rewards: Floats,
    ended: Bools,
) -> None:
    """What a step is worth, and whether the episode ends with it.

    Args:
        progress: made in this step, (n,) px.
        collided: whether a wall stopped the robot, (n,).
        penalty: for that, px.
        sums: progress since reset, (n,) px; ``progress`` is added.
        lap: its length, px; how near to the start it ends, px, negative if it does not count.
        poses, starts: where the robots are and where they began, (n, 2+) px.
        steps: carried out, (n,).
        most: steps of an episode.
        rewards: filled in, (n,) px.
        ended: filled in, (n,).
    """
    length, near = lap
    for i in range(ended.size):
        rewards[i] = progress[i] - penalty * collided[i]
        sums[i] += progress[i]
        dx, dy = poses[i, 0] - starts[i, 0], poses[i, 1] - starts[i, 1]
        around = np.rint(sums[i] / length) >= 1.0
        ended[i] = (steps[i] >= most) | (around & (np.sqrt(dx * dx + dy * dy) <= near))
