"""Monte-Carlo localization as the book has it, in plain Python loops: an independent oracle.

Thrun, Burgard & Fox 2005: table 8.2 (MCL), table 4.4 (low variance sampler), section 6.3 (a scan is
a product over beams), chapter 5 (motion with noise in turn and translation). Nothing of
``localizers`` or of ``PolygonMap`` is used; walls are a list of segments, poses are tuples, all
arithmetic is float64.
"""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

Pose = tuple[float, float, float]
Segment = tuple[float, float, float, float]

OUTSIDE = -30.0  # of each usable beam


@dataclass(frozen=True)
class Robot:
    """All that the textbook robot assumes."""

    outer: Sequence[tuple[float, float]]
    obstacles: Sequence[Sequence[tuple[float, float]]]
    bearings: Sequence[float]
    max_range: float
    sigma: float
    uniform: float
    drive: float
    turn: float
    drift: float

    def walls(self) -> list[Segment]:
        return [
            (*a, *b)
            for polygon in (self.outer, *self.obstacles)
            for a, b in zip(polygon, [*polygon[1:], polygon[0]], strict=True)
        ]


def is_inside(polygon: Sequence[tuple[float, float]], x: float, y: float) -> bool:
    """Even-odd rule: a ray to the right crosses the polygon an odd number of times."""
    odd = False
    for (ax, ay), (bx, by) in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
            odd = not odd
    return odd


def cast(walls: Sequence[Segment], x: float, y: float, angle: float) -> float:
    """Distance along the ray to the nearest wall."""
    dx, dy, nearest = math.cos(angle), math.sin(angle), math.inf
    for ax, ay, bx, by in walls:
        ex, ey = bx - ax, by - ay
        cross = dx * ey - dy * ex
        if cross == 0:
            continue
        t = ((ax - x) * ey - (ay - y) * ex) / cross
        u = ((ax - x) * dy - (ay - y) * dx) / cross
        if t >= 0 and 0 <= u <= 1:
            nearest = min(nearest, t)
    return nearest


def log_likelihood(robot: Robot, pose: Pose, scan: Sequence[float]) -> float:
    """Log Π over beams of (1 - u) N(o; ô, σ²) + u / r_max; unusable beams left out."""
    x, y, heading = pose
    usable = [i for i, o in enumerate(scan) if math.isfinite(o) and 0 <= o <= robot.max_range]
    if not usable:
        return 0.0
    if not is_inside(robot.outer, x, y):
        return OUTSIDE * len(usable)
    walls, total = robot.walls(), 0.0
    for i in usable:
        expected = cast(walls, x, y, heading + robot.bearings[i])
        z = (scan[i] - expected) / robot.sigma
        hit = math.exp(-0.5 * z * z) / (robot.sigma * math.sqrt(2 * math.pi))
        total += math.log((1 - robot.uniform) * hit + robot.uniform / robot.max_range)
    return total


def moved(robot: Robot, pose: Pose, distance: float, turn: float, rng: random.Random) -> Pose:
    """Turn by φ + ε_φ, then drive d + ε_d along the new heading."""
    x, y, heading = pose
    heading += rng.gauss(turn, robot.turn * abs(turn) + robot.drift * abs(distance))
    driven = rng.gauss(distance, robot.drive * abs(distance))
    return x + driven * math.cos(heading), y + driven * math.sin(heading), heading


def low_variance_sampler(
    particles: Sequence[Pose], weights: Sequence[float], rng: random.Random
) -> list[Pose]:
    """Table 4.4."""
    count, total = len(particles), sum(weights)
    r = rng.random() / count
    chosen, cumulative, i = [], weights[0] / total, 0
    for m in range(count):
        pointer = r + m / count
        while pointer > cumulative and i < count - 1:
            i += 1
            cumulative += weights[i] / total
        chosen.append(particles[i])
    return chosen


def mcl(
    robot: Robot,
    particles: list[Pose],
    actions: Sequence[tuple[float, float]],
    scans: Sequence[Sequence[float]],
    rng: random.Random,
) -> list[tuple[list[Pose], list[float]]]:
    """Table 8.2: the weighted particles of each step, taken before they are resampled."""
    clouds = []
    for (distance, turn), scan in zip(actions, scans, strict=True):
        particles = [moved(robot, pose, distance, turn, rng) for pose in particles]
        weights = [math.exp(log_likelihood(robot, pose, scan)) for pose in particles]
        clouds.append((particles, weights))
        particles = low_variance_sampler(particles, weights, rng)
    return clouds
