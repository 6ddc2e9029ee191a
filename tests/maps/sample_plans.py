"""Floor plans of the tests, and random poses on them."""

import numpy as np

from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.world.config import PAPER_ROOM

# A U-shaped hall with a C-shaped, a triangular and a tilted obstacle; orientations mixed.
HALL = PolygonMap(
    outer=[(0, 0), (400, 0), (400, 300), (250, 300), (230, 190), (150, 200), (150, 300), (0, 300)],
    obstacles=[
        [(60, 60), (120, 60), (120, 80), (80, 80), (80, 120), (120, 120), (120, 140), (60, 140)],
        [(250, 50), (270, 120), (320, 70)],
        [(170, 30), (210, 50), (190, 90), (150, 70)],
    ],
)


def _forest() -> PolygonMap:
    """A room with many obstacles: tilted squares, and upright ones that share their lines."""
    rng = np.random.default_rng(0)
    squares = []
    for x, y in np.ndindex(8, 6):
        turns = np.arange(4) * np.pi / 2 + (np.pi / 4 if (x + y) % 3 == 0 else rng.uniform(0, 1.5))
        centre = 45 + 90 * np.array([x, y])
        squares.append(centre + 14 * np.column_stack([np.cos(turns), np.sin(turns)]))
    return PolygonMap([(0, 0), (720, 0), (720, 540), (0, 540)], [s.tolist() for s in squares])


PLANS = {"room": PAPER_ROOM, "hall": HALL, "forest": _forest()}


def corners(plan: PolygonMap) -> np.ndarray:
    """All corners, (k, 2) px."""
    return np.vstack([plan.outer, *plan.obstacles])


def anywhere(plan: PolygonMap, n: int, rng: np.random.Generator, margin: float = 0.0) -> np.ndarray:
    """Uniform points in the plan's box and ``margin`` around it, (n, 2) px."""
    x0, y0, x1, y1 = plan.bounds
    return rng.uniform((x0 - margin, y0 - margin), (x1 + margin, y1 + margin), (n, 2))


def awkward_poses(plan: PolygonMap, n: int, rng: np.random.Generator) -> np.ndarray:
    """Poses (n, 3): a third heads exactly for a corner, a sixth runs parallel to the axes."""
    points = anywhere(plan, n, rng)
    headings = rng.uniform(-np.pi, np.pi, n)
    target = rng.choice(corners(plan), n) - points
    kind = rng.integers(0, 6, n)
    headings = np.where(kind <= 1, np.arctan2(target[:, 1], target[:, 0]), headings)
    headings = np.where(kind == 2, rng.integers(-2, 3, n) * np.pi / 2, headings)
    return np.column_stack([points, headings])
