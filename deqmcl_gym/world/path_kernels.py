"""The compiled rules of a drive: its noise, the path and the task on it, the driver; in float64.

A path is given by its edges, rows (x, y, dx, dy, length, arc length of the corner), (k, 6), and its
period: its length if it is closed, else ∞. Single rooms and rooms run together call the same
kernels, so their plans cannot differ; ``driver.GuidedPlan`` says what the driver does.
"""

from typing import Any

import numpy as np

from deqmcl_gym.maps.grid_kernels import distances, feasible_in_cells
from deqmcl_gym.numerics import Floats, RoomActions
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import TURN, atan2_64, centred64, cos64, sin64


@compiled
def noisy_drive(
    heading: float,
    distance: float,
    turn: float,
    normals: tuple[float, float],
    noise: tuple[float, float, float],
    reach: float,
) -> tuple[float, float, float, float]:
    """Return the heading, and the drive's length and vector, that a command brings about.

    Normals are N(0, 1) for the drive and the turn, noise σ_dd, σ_φφ, σ_φd. No drive without contact
    is as long as ``reach``; a longer one would lose precision.
    """
    of_drive, of_turn, of_drift = noise
    sd_turn = of_turn * abs(turn) + of_drift * distance
    after = centred64(heading + turn + sd_turn * normals[1], TURN)
    driven = distance * (1 + of_drive * normals[0])
    way = abs(driven)
    if way > reach:
        way, driven = reach, np.copysign(reach, driven)
    return after, way, driven * cos64(after), driven * sin64(after)


@compiled
def nearest_arc(x: float, y: float, edges: Floats) -> float:
    """Arc length from corner 0 to the path's point nearest to (x, y)."""
    nearest, arc = np.inf, 0.0
    for corner_x, corner_y, dx, dy, length, before in edges:
        to_x, to_y = x - corner_x, y - corner_y
        share = min(max((to_x * dx + to_y * dy) / (length * length), 0.0), 1.0)
        off_x, off_y = to_x - share * dx, to_y - share * dy
        square = off_x * off_x + off_y * off_y
        if square < nearest:
            nearest, arc = square, before + share * length
    return arc


@compiled
def shorter(way: float, period: float) -> float:
    """The same signed distance along a path, the shorter way round."""
    return way if period == np.inf else centred64(way, period)


@compiled
def follow(
    from_x: float, from_y: float, x: float, y: float, before: float, edges: Floats, period: float
) -> tuple[float, float]:
    """Return the arc length after driving from arc ``before`` to (x, y), and the signed progress.

    Of the nearest points of all edges, it is the one with the least max(d, e / 8) + b: d is its
    distance, e the difference between progress along the path and the distance driven, b the
    distance driven against that edge. So a robot stays on its stretch of a path that crosses or
    retraces itself, goes on to the next one at a hairpin, and takes a shortcut only where that is
    much nearer. A robot that has not moved, but for rounding errors, keeps its arc length.
    """
    step_x, step_y = x - from_x, y - from_y
    driven = np.sqrt(step_x * step_x + step_y * step_y)
    same = 1e-9 * (edges[-1, 5] + edges[-1, 4])  # of the path's length: rounding errors
    if driven <= same:
        return before, 0.0
    least, least_off = np.inf, np.inf
    arc, way = before, 0.0
    for corner_x, corner_y, dx, dy, edge_length, edge_arc in edges:
        to_x, to_y = x - corner_x, y - corner_y
        share = min(max((to_x * dx + to_y * dy) / (edge_length * edge_length), 0.0), 1.0)
        off_x, off_y = to_x - share * dx, to_y - share * dy
        distance = np.sqrt(off_x * off_x + off_y * off_y)
        new_arc = edge_arc + share * edge_length
        gone = driven + shorter(new_arc - before - driven, period)
        back = max(-(step_x * dx + step_y * dy) / edge_length, 0.0)
        cost = max(distance, (abs(gone) - driven) / 8) + back
        off = abs(gone - driven)
        if cost < least - same or (cost < least + same and off < least_off - same):
            least, least_off, arc, way = min(cost, least), off, new_arc, gone
    return arc, way


@compiled
def drive_along(
    pose: tuple[float, float, float],
    arc: float,
    way: float,
    edges: Floats,
    period: float,
    rules: tuple[float, float, float, float, float, float],
    actions: RoomActions,
) -> int:
    """Fill in the actions (n, 2) of a driver without noise until it is done; return their number.

    It begins at ``arc``, having come as far as ``way``. Rules: look-ahead distance; heading error
    beyond which it turns on the spot; step; largest turn of a step; distance along the path at
    which it is done; distance from the end of the path at which it is done.
    """
    x, y, heading = pose
    look_ahead, on_the_spot, step, most, end, near = rules
    length = edges[-1, 5] + edges[-1, 4]
    end_x, end_y = _point_at(length, edges)
    rows: int = actions.shape[0]
    for count in range(rows):
        to_x, to_y = end_x - x, end_y - y
        if way >= end or np.sqrt(to_x * to_x + to_y * to_y) <= near:
            return count
        ahead = arc + look_ahead
        ahead = min(ahead, length) if period == np.inf else ahead % period
        goal_x, goal_y = _point_at(ahead, edges)
        error = centred64(atan2_64(goal_y - y, goal_x - x) - heading, TURN)
        actions[count, 0] = step if abs(error) <= on_the_spot else 0.0
        actions[count, 1] = min(max(error, -most), most)
        # continue with the action as rounded to float32
        heading = centred64(heading + np.float64(actions[count, 1]), TURN)
        distance = np.float64(actions[count, 0])
        to_x, to_y = x + distance * cos64(heading), y + distance * sin64(heading)
        arc, gone = follow(x, y, to_x, to_y, arc, edges, period)
        x, y = to_x, to_y
        way += gone
    return rows


@compiled
def _point_at(arc: float, edges: Floats) -> tuple[float, float]:
    """Point of the path at an arc length in [0, length]."""
    edge = edges.shape[0] - 1
    while edge > 0 and edges[edge, 5] > arc:
        edge -= 1
    share = (arc - edges[edge, 5]) / edges[edge, 4]
    return edges[edge, 0] + share * edges[edge, 2], edges[edge, 1] + share * edges[edge, 3]


GOAL_BONUS = 100.0  # px of progress
COLLISION_PENALTY = 10.0  # px of progress


def once_round(length: float, radius: float) -> float:
    """Return the progress at which a robot, once round, touches the line that it started from.

    At least half the lap, however large the robot is.
    """
    return length - min(length / 2, radius)


@compiled
def judged_step(
    drive: tuple[float, float, float, float],
    before: float,
    progress: float,
    collided: bool,
    edges: Floats,
    period: float,
    end: tuple[float, float],
    rewards: tuple[float, float, float, float],
) -> tuple[float, float, float, bool]:
    """Return arc length and progress of a step, its reward, and whether the task is done.

    Progress beyond the goal does not count: the return of an episode is goal + bonus if it reaches
    the goal without contact, and less otherwise.

    A drive is from (x, y) to (x, y), ``before`` the arc length before it. Rewards are the progress
    at which the task is done, inf if it never is; the reward for that; the penalty for a contact;
    the distance from the path's ``end`` at which the task is done, too, -1 if it never is.
    """
    from_x, from_y, x, y = drive
    arc, gained = follow(from_x, from_y, x, y, before, edges, period)
    goal, bonus, penalty, near = rewards
    reward = gained - penalty * collided
    progress += gained
    if progress >= goal:
        return arc, gained, reward - (progress - goal) + bonus, True
    off_x, off_y = x - end[0], y - end[1]
    done: bool = np.sqrt(off_x * off_x + off_y * off_y) <= near
    return arc, gained, reward + bonus if done else reward, done


NEARER = (1.0, 0.7, 0.5, 0.35, 0.25)  # shares of the look-ahead that are tried on a route
_BLOCK = 64  # steps looked at together: the first blocked one ends the search


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
    size: float,
    clearance: float,
    actions: RoomActions,
) -> int:
    """Fill in what a driver does from ``pose`` on a route, and return the number of actions.

    As ``drive_along``, with the longest look-ahead in ``rules``. ``length`` of the route is as
    ``Path.length`` adds it up, ``goal`` its last corner, ``cells`` as of ``GridMap``. The way must
    be free for a disc of radius ``size`` and half the room to a wall, of at most ``clearance``.
    """
    reach, up, down, frame = cells
    at, gap = np.array(((pose[0],), (pose[1],))), np.empty(1, np.float32)
    distances(at, reach, up, down, frame, gap)
    body = size + max(0.0, min(np.float64(gap[0]) - size, clearance)) / 2
    tried = np.empty_like(actions)
    clear, count = -1, 0
    onto, begin = edges, arc
    for back in range(2):
        if back:
            onto, begin = back_onto(pose, arc, edges, length, goal), 0.0
        for share in NEARER:
            near_rules = (share * rules[0], rules[1], rules[2], rules[3], rules[4], rules[5])
            steps = drive_along(pose, begin, way, onto, np.inf, near_rules, tried)
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
    out = np.empty((len(edges) - after + 2, 6))
    rows, x, y, begun = 0, pose[0], pose[1], 0.0
    for corner in range(after - 1, len(edges) + 1):
        if corner < after:
            to_x, to_y = _point_at(min(max(arc, 0.0), length), edges)
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
        feasible_in_cells(starts, ends, reach, frame, body, clear)
        for step in range(count):
            if not clear[step]:
                return first + step
    return -1
