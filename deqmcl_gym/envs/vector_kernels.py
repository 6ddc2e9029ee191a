"""The compiled motion of many robots among the walls: float64, one room after the other.

The rule is that of ``deqmcl_gym.world.episode``: turn, then drive; stop just before contact.
"""

from typing import Any, NamedTuple

import numpy as np

from deqmcl_gym.maps.grid_kernels import distances, enters_circle, first_contact
from deqmcl_gym.numerics import Bools, Floats, Indices, Singles
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.world.path_kernels import judged_step, noisy_drive


class Robots(NamedTuple):
    """The robots of n rooms: the state that changes from step to step."""

    poses: Floats  # x, y, θ in [-π, π), (n, 3)
    gaps: Floats  # least way in any direction that touches no wall, (n,); 0 if unknown
    arcs: Floats  # arc length at which each is on the path, (n,)
    progress: Floats  # along the path since reset, (n,)
    steps: Indices  # number carried out, (n,)


class CellRows(NamedTuple):
    """The cells of s maps, padded to the largest; empty for polygons."""

    reach: Any  # as of ``GridMap.cells``, flat, (s, c)
    up: Any
    down: Any
    shapes: Indices  # rows and columns, (s, 2)
    frames: Floats  # of the maps, (s, 5)


class Courses(NamedTuple):
    """The paths of n rooms."""

    edges: Floats  # as in ``deqmcl_gym.world.path_kernels``, padded, (n, k, 6)
    counts: Indices  # number of edges, (n,)
    periods: Floats  # length of a closed path, ∞ of an open one, (n,)
    goals: Floats  # the last corner (x, y), (n, 2)
    limits: Indices  # number of steps after which the plan ends, (n,)


@compiled
def step_rooms(
    robots: tuple[Any, ...],
    grounds: tuple[Any, ...],
    courses: tuple[Any, ...],
    rules: tuple[Any, ...],
    commands: Singles,
    normals: Floats,
    at: Indices,
    resting: Bools,
    moved: tuple[Any, ...],
) -> None:
    """Turn and drive the robots that are not ``resting``, (n,).

    Tuples are plain ones: numba takes them faster. Rules are the noise (σ_dd, σ_φφ, σ_φd), the
    rewards of ``judged_step`` and the most steps of an episode. Commands are (distance, turn), (n,
    2), normals N(0, 1) for both, (n, rows, 2), of which each robot uses row ``at``, (n,); advanced
    by one. Filled in are rewards, whether a wall stopped the robot, whether the task is done, and
    whether the limit or the plan's end came before, (n,) each.
    """
    poses, gaps, arcs, progress, steps = robots
    slots, sizes, walls, counts, cells = grounds
    edges, edge_counts, periods, goals, limits = courses
    noise, rewards, limit = rules
    all_rewards, all_collided, terminated, truncated = moved
    # Numbers of each robot, not the tuples: passing a tuple on counts a reference to each of its
    # arrays, which took four fifths of a step when it was done for every robot.
    for i in range(resting.size):
        if resting[i]:
            all_rewards[i] = 0.0
            all_collided[i] = terminated[i] = truncated[i] = False
            continue
        x, y, heading = poses[i, 0], poses[i, 1], poses[i, 2]
        distance, turn = np.float64(commands[i, 0]), np.float64(commands[i, 1])
        chance = normals[i, at[i], 0], normals[i, at[i], 1]
        slot = slots[i]
        skin = sizes[slot, 1]
        heading, way, dx, dy = noisy_drive(heading, distance, turn, chance, noise, sizes[slot, 2])
        at[i] += 1
        steps[i] += 1
        collided = False
        if way > 0.0 and gaps[i] <= way + skin:
            segments = walls[slot, : counts[slot]]
            gaps[i], share = _ahead(x, y, dx, dy, way, segments, cells, slot, sizes[slot, 0], skin)
            if share < np.inf:
                collided = True
                share = max(share - skin / way, 0.0)
                dx, dy, way = share * dx, share * dy, share * way
        gaps[i] -= way
        x, y = x + dx, y + dy
        drive = poses[i, 0], poses[i, 1], x, y
        poses[i, 0], poses[i, 1], poses[i, 2] = x, y, heading
        path = edges[i, : edge_counts[i]]
        arcs[i], gained, reward, done = judged_step(
            drive, arcs[i], progress[i], collided, path, periods[i], (goals[i, 0], goals[i, 1]),
            rewards,
        )  # fmt: skip
        progress[i] += gained
        all_rewards[i], all_collided[i], terminated[i] = reward, collided, done
        given_up = steps[i] >= limits[i] and not done
        truncated[i] = given_up or steps[i] >= limit


@compiled
def _ahead(
    x: float,
    y: float,
    dx: float,
    dy: float,
    way: float,
    walls: Floats,
    cells: Any,
    slot: int,
    radius: float,
    skin: float,
) -> tuple[float, float]:
    """Return the gap of a robot to the nearest wall, and the share of a drive to its contact."""
    reaches, ups, downs, shapes, frames = cells
    if reaches.shape[1] == 0:
        gap = _gap_to_walls(x, y, walls) - radius
        if gap > way + skin:
            return gap, np.inf
        return gap, 0.0 if gap < 0.0 else _contact_with_walls(x, y, dx, dy, walls, radius)
    rows, columns = shapes[slot]
    size = rows * columns
    reach = reaches[slot, :size].reshape(rows, columns)
    up = ups[slot, :size].reshape(rows, columns)
    down = downs[slot, :size].reshape(rows, columns)
    x0, y0, cosine, sine, cell = frames[slot]
    frame = x0, y0, cosine, sine, cell
    point, nearest = np.array(((x,), (y,))), np.empty(1, np.float32)
    distances(point, reach, up, down, frame, nearest)
    gap = np.float64(nearest[0]) - radius
    if gap > way + skin:
        return gap, np.inf
    end = x + dx, y + dy
    return gap, 0.0 if gap < 0.0 else first_contact((x, y), end, reach, frame, radius)


@compiled
def _gap_to_walls(x: float, y: float, walls: Floats) -> float:
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
def _contact_with_walls(
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
