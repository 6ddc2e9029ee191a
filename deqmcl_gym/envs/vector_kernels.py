"""The compiled motion of many robots among the walls: float64, one room after the other.

The rule is that of ``deqmcl_gym.world.episode``: turn, then drive; stop just before contact.
"""

from typing import Any, NamedTuple

import numpy as np

from deqmcl_gym.maps.contact_kernels import first_contact
from deqmcl_gym.maps.grid_kernels import distances
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Bools, Floats, Indices, Singles
from deqmcl_gym.world.path_kernels import drawn, judged


def sides(walls: Floats) -> Floats:
    """Return walls (x₀, y₀, x₁, y₁) as :class:`Rules` has them.

    Returns:
        (x₀, y₀, unit x, unit y, length), (S, 5).
    """
    along = walls[:, 2:] - walls[:, :2]
    length = np.sqrt((along**2).sum(axis=1, keepdims=True))
    return np.hstack([walls[:, :2], along / length, length])


class Robots(NamedTuple):
    """The robots of n rooms: the state that changes from step to step.

    Attributes:
        poses: x, y, θ in [-π, π), (n, 3).
        gaps: least distance that each can drive in any direction without touching a wall, (n,); 0
            if unknown.
        arcs: arc length at which each is on the path, (n,).
        progress: along the path since reset, (n,).
        steps: number carried out, (n,).
    """

    poses: Floats
    gaps: Floats
    arcs: Floats
    progress: Floats
    steps: Indices


class Rules(NamedTuple):
    """The values that are the same in all rooms and at every step.

    Attributes:
        noise: σ_dd, σ_φφ, σ_φd.
        walls: as :func:`sides` returns them, free space to their left; empty for a grid.
        cells: a ``grid_kernels.CellGrid`` as a plain tuple: a grid, or ``NO_CELLS``.
        radius: of the robots.
        skin: distance at which they stop before a contact.
        reach: a length that no drive can have without contact.
        edges: of the path, as in ``deqmcl_gym.world.path_kernels``.
        length: of the path.
        rewards: goal, bonus and penalty, as in ``deqmcl_gym.world.path_kernels``.
        most: number of steps of the plan.
        limit: largest number of steps of an episode.
    """

    noise: tuple[float, float, float]
    walls: Floats
    cells: tuple[Any, ...]
    radius: float
    skin: float
    reach: float
    edges: Floats
    length: float
    rewards: tuple[float, float, float]
    most: int
    limit: int


class Moved(NamedTuple):
    """The results of a step.

    Attributes:
        rewards: see ``deqmcl_gym.world.path_kernels``, (n,).
        collided: whether a wall stopped the robot, (n,).
        terminated: whether the task is done, (n,).
        truncated: whether the plan is used up and the task not done, or the episode has reached its
            limit, (n,).
    """

    rewards: Floats
    collided: Bools
    terminated: Bools
    truncated: Bools


@compiled
def step(
    robots: tuple[Any, ...],
    rules: tuple[Any, ...],
    commands: Singles,
    normals: Floats,
    at: Indices,
    resting: Bools,
    moved: tuple[Any, ...],
) -> None:
    """Turn and drive the robots that are not ``resting``; fill in the results.

    Args:
        robots: :class:`Robots`, as a plain tuple like the other two: numba takes it faster.
        rules: :class:`Rules`.
        commands: distance, turn, (n, 2).
        normals: N(0, 1) for the drive and the turn, (n, rows, 2).
        at: the row of these that each robot uses, (n,); advanced by one.
        resting: which robots stay, (n,).
        moved: :class:`Moved`, filled in.
    """
    poses, gaps, arcs, progress, steps = robots
    of_all, said = Rules(*rules), Moved(*moved)
    noise, edges, length, rewards = of_all.noise, of_all.edges, of_all.length, of_all.rewards
    reach, skin = of_all.reach, of_all.skin
    # Numbers of each robot, not the tuples: passing a tuple on counts a reference to each of its
    # arrays, which took four fifths of a step when it was done for every robot.
    for i in range(resting.size):
        if resting[i]:
            said.rewards[i] = 0.0
            said.collided[i] = said.terminated[i] = said.truncated[i] = False
            continue
        x, y, heading = poses[i, 0], poses[i, 1], poses[i, 2]
        distance, turn = np.float64(commands[i, 0]), np.float64(commands[i, 1])
        chance = normals[i, at[i], 0], normals[i, at[i], 1]
        heading, way, dx, dy = drawn(heading, distance, turn, chance, noise, reach)
        at[i] += 1
        steps[i] += 1
        collided = False
        if way > 0.0 and gaps[i] <= way + skin:
            gaps[i], share = _ahead(x, y, dx, dy, way, of_all)
            if share < np.inf:
                collided = True
                share = max(share - skin / way, 0.0)
                dx, dy, way = share * dx, share * dy, share * way
        gaps[i] -= way
        poses[i, 0], poses[i, 1], poses[i, 2] = x + dx, y + dy, heading
        drive = x, y, x + dx, y + dy
        arcs[i], gained, reward, done = judged(
            drive, arcs[i], progress[i], collided, edges, length, rewards
        )
        progress[i] += gained
        given_up = steps[i] >= of_all.most and not done
        said.rewards[i], said.collided[i], said.terminated[i] = reward, collided, done
        said.truncated[i] = given_up or steps[i] >= of_all.limit


@compiled
def _ahead(
    x: float, y: float, dx: float, dy: float, way: float, rules: Rules
) -> tuple[float, float]:
    """Return the gap of a robot to the nearest wall, and the share of a drive to its contact."""
    gap = _gap(x, y, rules) - rules.radius
    if gap > way + rules.skin:
        return gap, np.inf
    return gap, 0.0 if gap < 0.0 else _first_contact(x, y, dx, dy, rules)


@compiled
def _gap(x: float, y: float, rules: Rules) -> float:
    """Distance of a point to the nearest wall."""
    reach, up, down, frame = rules.cells
    if reach.size:
        point, gap = np.array(((x,), (y,))), np.empty(1, np.float32)
        distances(point, reach, up, down, frame, gap)
        return np.float64(gap[0])
    walls, least = rules.walls, np.inf
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
def _first_contact(x: float, y: float, dx: float, dy: float, rules: Rules) -> float:
    """Share of (dx, dy) at which a disc that starts clear of walls first touches one; or inf."""
    reach, _, _, frame = rules.cells
    walls, radius, first = rules.walls, rules.radius, np.inf
    if reach.size:
        return first_contact((x, y), (x + dx, y + dy), reach, frame, radius)
    square = dx * dx + dy * dy
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
        nears = -(px * dx + py * dy)
        root = nears * nears - square * (px * px + py * py - radius * radius)
        if nears > 0.0 and root >= 0.0:
            share = max(nears - np.sqrt(root), 0.0) / square
            if share <= 1.0:
                first = min(first, share)
    return first
