"""Course: the planned path, a lap or a route to a goal, its arc lengths and its actions."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deqmcl_gym.maps import Map, PolygonMap
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.maps.polygons import signed_area
from deqmcl_gym.numerics import Floats, Point, Pose, Singles, arrays
from deqmcl_gym.numerics.elementary import TURN, atan2_64, centred64
from deqmcl_gym.validation import InputError, digits
from deqmcl_gym.world import World, path_kernels


def centred_heading(angle: float) -> float:
    """Return the same direction in [-π, π), rad."""
    heading: float = centred64(angle, TURN)
    return heading


@dataclass(frozen=True)
class Path:
    """A polygonal path, driven in the order of its corners."""

    corners: Floats  # (k, 2)
    closed: bool = True  # whether the last corner is joined to the first

    @cached_property
    def length(self) -> float:
        """Length once around, or from end to end."""
        return float(self.edges[:, 4].sum())

    @cached_property
    def period(self) -> float:
        """Length once around; ∞ for an open path."""
        return self.length if self.closed else math.inf

    def arc(self, point: Point) -> float:
        """Arc length from corner 0 to the path's point nearest to ``point``."""
        x, y = point
        return path_kernels.nearest_arc(x, y, self.edges)

    def at(self, arc: float) -> Pose:
        """Pose on the path at an arc length, clipped to an open path, heading along it."""
        arc = arc % self.length if self.closed else min(max(arc, 0.0), self.length)
        edge = int(np.searchsorted(self.edges[:, 5], arc, side="right")) - 1
        x, y, dx, dy, length, before = self.edges[edge].tolist()
        share = (arc - before) / length
        return x + share * dx, y + share * dy, atan2_64(dy, dx)

    def advance(self, before: float, after: float) -> float:
        """Signed distance along the path between two arc lengths, the shorter way round."""
        return path_kernels.shorter(after - before, self.period)

    def corners_from(self, arc: float) -> Floats:
        """Return the points to drive to from an arc length: once around, or to the end."""
        entry = np.array(self.at(arc)[:2])
        after = int(np.searchsorted(self.edges[:, 5], arc, side="right"))
        if not self.closed:
            return np.vstack([entry, self.corners[after:]])
        order = np.roll(self.corners, -after, axis=0)
        return np.vstack([entry, order, entry])

    @property
    def outline(self) -> Floats:
        """The line to draw: all corners, closed if the path is, (n, 2)."""
        return np.vstack([self.corners, self.corners[:1]]) if self.closed else self.corners

    @cached_property
    def edges(self) -> Floats:
        """Rows (x, y, dx, dy, length, arc length of the corner), one for each edge, (n, 6)."""
        along = np.diff(self.outline, axis=0)
        lengths = np.sqrt((along**2).sum(axis=1))
        before = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
        return np.column_stack([self.corners[: len(along)], along, lengths, before])


MAX_STEPS = 100_000  # in a plan: 0.8 MB in every info


@dataclass(frozen=True)
class Course:
    """The plan of an episode: a path, the pose to start from, and the actions.

    The path is closed for a lap, counterclockwise unless waypoints say otherwise; open for a route.
    """

    path: Path
    start: Pose  # expected pose at reset (x, y, θ)
    arc: float  # arc length of the path's point nearest to the start
    actions: Singles  # (distance, turn), (T, 2) float32

    @classmethod
    def of(cls, world: World) -> "Course":
        """Plan the lap of a world."""
        waypoints, pose, body = world.lap.waypoints, world.start.pose, world.body
        corners = mid_corridor(world.floor_plan) if waypoints is None else np.array(waypoints)
        path, ends = Path(corners), np.roll(corners, -1, axis=0)
        blocked = world.floor_plan.collides(corners, ends, body)
        if blocked.any():
            (x0, y0), (x1, y1) = corners[blocked.argmax()], ends[blocked.argmax()]
            raise InputError(
                f"the lap touches a wall between ({x0:g}, {y0:g}) and ({x1:g}, {y1:g}) for a robot "
                f"of radius {world.robot.radius:g} {world.floor_plan.unit}: give a smaller robot "
                "or other lap.waypoints."
            )
        _, y, _, dy, length, before = path.edges.T
        lowest = float((before + length / 2)[(y + dy / 2).argmin()])  # the middle of an edge
        arc = lowest if pose is None else path.arc(pose[:2])
        start = path.at(arc) if pose is None else pose
        check_free("start.pose", start, world)
        x, y, _ = path.at(arc)
        if world.floor_plan.collides([start], [(x, y)], body)[0]:
            raise InputError(
                f"the straight line from start.pose ({start[0]:g}, {start[1]:g}) to the lap at "
                f"({x:g}, {y:g}) touches a wall: give a start in sight of the lap, or other "
                "lap.waypoints."
            )
        return cls(path, start, arc, plan_actions(path, arc, start, world))

    @classmethod
    def along(cls, corners: Floats, start: Pose, world: World) -> "Course":
        """Plan the route along ``corners`` (k, 2), from a start at the first of them."""
        path = Path(corners, closed=False)
        return cls(path, start, 0.0, plan_actions(path, 0.0, start, world))

    @cached_property
    def goal(self) -> Point | None:
        """The end of an open path; None for a lap."""
        if self.path.closed:
            return None
        x, y = self.path.corners[-1].tolist()
        return x, y


def check_free(what: str, at: Pose, world: World) -> None:
    """Refuse a pose where the robot would touch a wall."""
    if not world.floor_plan.free([at], world.body)[0]:
        (x, y, heading), size = at, f"{world.robot.radius:g} {world.floor_plan.unit}"
        raise InputError(
            f"{what} is ({x:g}, {y:g}, {heading:g}), where a robot of radius {size} touches a wall "
            "or stands outside: give a pose in free space."
        )


def mid_corridor(floor_plan: Map) -> Floats:
    """Corners of a counterclockwise path half-way between the obstacles and the outer wall, (k, 2).

    There is one on the bisector of each corner of the obstacles' convex hull, half-way to the outer
    wall. Without obstacles, the hull is the middle of the room, and the bisectors lead to the
    corners of the outer wall.
    """
    if not isinstance(floor_plan, PolygonMap):
        raise InputError(
            "lap.waypoints is None, but a lap can only be computed for a floor plan of polygons: "
            "give the corners of a closed path through free space."
        )
    outer, px = np.array(floor_plan.outer), pixel(floor_plan.unit)
    if not floor_plan.obstacles:
        middle = (outer.min(axis=0) + outer.max(axis=0)) / 2
        halfway: Floats = (outer + middle) / 2
        return halfway if signed_area(halfway) >= 0 else halfway[::-1]
    corners = np.vstack([np.array(polygon) for polygon in floor_plan.obstacles])
    hull = _thinned(_convex_hull(corners), 10 * px)
    into = hull - np.roll(hull, 1, axis=0)
    out_of = np.roll(hull, -1, axis=0) - hull
    bisectors = _unit(_unit(into) - _unit(out_of))
    headings = arrays.arctan2(bisectors[:, 1], bisectors[:, 0])
    x0, y0, x1, y1 = floor_plan.bounds
    past = max(1e-3 * px, 1e-6 * max(x1 - x0, y1 - y0))  # more than float32 rounding errors
    outside = hull + past * bisectors
    gaps = floor_plan.ranges(np.column_stack([outside, headings]), [0.0])[:, 0].astype(float)
    if (lost := ~np.isfinite(gaps)).any():
        x, y = hull[lost.argmax()]
        raise InputError(
            f"the obstacle corner ({x:g}, {y:g}) lies on or outside the outer wall, so no lap can "
            "go around it: give lap.waypoints."
        )
    steps = gaps[:, None] / 2 * np.column_stack([arrays.cos(headings), arrays.sin(headings)])
    return np.round((hull + steps) / px, 2) * px


def plan_actions(path: Path, arc: float, start: Pose, world: World) -> Singles:
    """Return the actions (distance, turn) that drive from ``start`` along a path, (T, 2).

    Turns and drives are split into steps of ``lap.turn`` and ``lap.step``; the last one is shorter.
    """
    lap, robot = world.lap, world.robot
    for name, step, most in (
        ("lap.step", lap.step, robot.max_distance),
        ("lap.turn", lap.turn, robot.max_turn),
    ):
        if step > most:
            raise InputError(
                f"{name} is {digits(step)}, but must be at most {digits(most)}, which the robot "
                "can do in a step."
            )
    legs, (x, y, heading) = list[tuple[float, float]](), start  # turn and distance
    for corner_x, corner_y in path.corners_from(arc).tolist():
        dx, dy = corner_x - x, corner_y - y
        distance = math.sqrt(dx * dx + dy * dy)
        if distance < 1e-6 * world.pixel:
            continue
        bearing = atan2_64(dy, dx)
        legs.append((centred_heading(bearing - heading), distance))
        x, y, heading = corner_x, corner_y, bearing
    steps = sum(abs(turn) / lap.turn + distance / lap.step for turn, distance in legs)
    if steps > MAX_STEPS:
        raise InputError(
            f"the plan would have about {steps:.3g} steps, but may have at most "
            f"{MAX_STEPS:,}: give a larger lap.step or lap.turn."
        )
    actions: list[tuple[float, float]] = []
    for turn, distance in legs:
        actions += [(0.0, math.copysign(part, turn)) for part in _parts(abs(turn), lap.turn)]
        actions += [(part, 0.0) for part in _parts(distance, lap.step)]
    made = np.array(actions, dtype=np.float32).reshape(-1, 2)
    made.setflags(write=False)
    return made


def _parts(total: float, step: float) -> list[float]:
    whole = int(total / step + 1e-6)
    rest = total - whole * step
    return [step] * whole + ([rest] if rest > 1e-6 * step else [])


def _unit(vectors: Floats) -> Floats:
    units: Floats = vectors / np.sqrt((vectors**2).sum(axis=1, keepdims=True))
    return units


def _thinned(hull: Floats, spacing: float) -> Floats:
    """Leave out corners of a round hull that are less than ``spacing`` from the one before."""
    lengths = np.sqrt(((hull - np.roll(hull, 1, axis=0)) ** 2).sum(axis=1))
    spacing = min(spacing, lengths.sum() / 32)
    way, corners = np.cumsum(lengths) - lengths[0], [0]
    for corner in range(1, len(hull)):
        if min(way[corner] - way[corners[-1]], way[-1] + lengths[0] - way[corner]) >= spacing:
            corners.append(corner)
    return hull[corners]


def _convex_hull(points: Floats) -> Floats:
    """Counterclockwise convex hull, (k, 2) (Andrew's monotone chain, 1979)."""
    ordered = sorted(map(tuple, points.tolist()))

    def half(candidates: list[tuple[float, ...]]) -> list[tuple[float, ...]]:
        chain: list[tuple[float, ...]] = []
        for x, y in candidates:
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-2:]
                left = (bx - ax) * (y - by) - (by - ay) * (x - bx)
                # a bend within rounding errors is not a corner
                if left > 1e-9 * math.dist((ax, ay), (bx, by)) * math.dist((bx, by), (x, y)):
                    break
                chain.pop()
            chain.append((x, y))
        return chain[:-1]

    return np.array(half(ordered) + half(ordered[::-1]))
