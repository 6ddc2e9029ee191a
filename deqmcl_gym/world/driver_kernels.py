"""The compiled driver on a route through solid squares; ``driver.GuidedPlan`` says what he does.

Single rooms and rooms run together call the same kernel, so their plans cannot differ.
"""

from typing import Any

import numpy as np

from deqmcl_gym.maps.grid_kernels import distances, feasible
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos64, sin64
from deqmcl_gym.numerics.types import Floats, RoomActions
from deqmcl_gym.world.path_kernels import drive_along

NEARER = (1.0, 0.7, 0.5, 0.35, 0.25)  # shares of the look-ahead that are tried on a route
_BLOCK = 64  # steps looked at together: the first blocked one ends the search


@compiled
def room_for_noise(pose: tuple[float, float, float], cells: Any, size: float, most: float) -> float:
    """Radius of a robot of radius ``size``, and half its room to a wall, at most half of ``most``.

    Args:
        pose: of the robot.
        cells: a ``grid_kernels.CellGrid``, as a plain tuple.
        size, most: see above.
    """
    reach, up, down, frame = cells
    at, gap = np.array(((pose[0],), (pose[1],))), np.empty(1, np.float32)
    distances(at, reach, up, down, frame, gap)
    return size + max(0.0, min(np.float64(gap[0]) - size, most)) / 2


@compiled
def steer(
    pose: tuple[float, float, float],
    arc: float,
    way: float,
    edges: Floats,
    length: float,
    goal: tuple[float, float],
    rules: tuple[float, float, float, float, float, float],
    cells: Any,
    body: float,
    actions: RoomActions,
) -> int:
    """Fill in what a driver does from ``pose`` on a route, and return the number of actions.

    Args:
        pose, arc, way: as ``path_kernels.drive_along``.
        edges: of the route.
        length: of the route, as ``Path.length`` adds it up.
        goal: its last corner.
        rules: as ``path_kernels.drive_along``, with the longest look-ahead.
        cells: a ``grid_kernels.CellGrid``, as a plain tuple.
        body: radius of the disc for which the way must be free.
        actions: distance, turn, (n, 2).
    """
    tried = np.empty_like(actions)
    clear, count = -1, 0
    onto, begin = edges, arc
    for back in range(2):
        if back:
            onto, begin = back_onto(pose, arc, edges, length, goal), 0.0
        for share in NEARER:
            own = (share * rules[0], rules[1], rules[2], rules[3], rules[4], rules[5])
            steps = drive_along(pose, begin, way, onto, np.inf, own, tried)
            blocked = _first_blocked(pose, tried[:steps], cells, body)
            if blocked < 0 or blocked > clear:
                clear, count = blocked, steps
                actions[:steps] = tried[:steps]
            if blocked < 0:
                return count
    return count


@compiled
def back_onto(
    pose: tuple[float, float, float],
    arc: float,
    edges: Floats,
    length: float,
    goal: tuple[float, float],
) -> Floats:
    """Return the edges of the rest of a route, and before it the straight way there."""
    after = 0  # corners that are behind
    while after < len(edges) and edges[after, 5] <= arc:
        after += 1
    clipped, edge = min(max(arc, 0.0), length), len(edges) - 1
    while edges[edge, 5] > clipped:
        edge -= 1
    share = (clipped - edges[edge, 5]) / edges[edge, 4]
    out = np.empty((len(edges) - after + 2, 6))
    rows, x, y, begun = 0, pose[0], pose[1], 0.0
    for corner in range(after - 1, len(edges) + 1):
        if corner < after:
            to_x = edges[edge, 0] + share * edges[edge, 2]
            to_y = edges[edge, 1] + share * edges[edge, 3]
        elif corner < len(edges):
            to_x, to_y = edges[corner, 0], edges[corner, 1]
        else:
            to_x, to_y = goal
        dx, dy = to_x - x, to_y - y
        if dx != 0.0 or dy != 0.0:
            along = np.sqrt(dx * dx + dy * dy)
            row = out[rows]
            row[0], row[1], row[2], row[3], row[4], row[5] = x, y, dx, dy, along, begun
            rows, begun = rows + 1, begun + along
        x, y = to_x, to_y
    return out[:rows]


@compiled
def _first_blocked(
    pose: tuple[float, float, float], actions: RoomActions, cells: Any, body: float
) -> int:
    """Return the first step without noise in which a disc would touch a solid cell; -1: none."""
    reach, _, _, frame = cells
    starts, ends = np.empty((2, _BLOCK)), np.empty((2, _BLOCK))
    clear = np.empty(_BLOCK, np.bool_)
    x, y, turned = pose[0], pose[1], 0.0
    for first in range(0, len(actions), _BLOCK):
        count = min(_BLOCK, len(actions) - first)
        for step in range(count):
            distance = np.float64(actions[first + step, 0])
            turned += np.float64(actions[first + step, 1])
            heading = pose[2] + turned
            starts[0, step], starts[1, step] = x, y
            x, y = x + distance * cos64(heading), y + distance * sin64(heading)
            ends[0, step], ends[1, step] = x, y
        for step in range(count, _BLOCK):  # stays, and blocks no step before it
            starts[0, step] = ends[0, step] = x
            starts[1, step] = ends[1, step] = y
        feasible(starts, ends, reach, frame, body, clear)
        for step in range(count):
            if not clear[step]:
                return first + step
    return -1
