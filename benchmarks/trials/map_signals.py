"""Is the robot lost, or is the map wrong here? What can be seen of either, and what is true.

Only where the world differs from the map. All of it is seen at the best cluster of a belief, but
for the two columns of the truth.
"""

import math
from typing import Any

import numpy as np

from benchmarks.trials.collecting import unless_nan
from benchmarks.trials.episode import Step
from benchmarks.trials.fixes import FOUND, NEAR
from benchmarks.trials.residuals import APART, Expected, Lattice, Rays, known_part
from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics.types import Floats, Reals
from localizers import best_cluster, quality_of

TRUTH = ("off", "wrong")
SIGNALS = ("quality", "explained", "beyond_random", "short", "long", "repeated", "elsewhere")
MAP_COLUMNS = (*TRUTH, *SIGNALS)
_RANDOM = 256  # poses anywhere on the map
_ROOM = 0.3  # m: places nearer to each other than about this are one
_ROOT = 30  # of the randomness: the poses are the same for every trial on a map


def differs(room: Any) -> bool:
    """Whether an env's world is made to differ from its map."""
    world = getattr(room, "world", None)
    return world is not None and bool(world.differs_from_map)


class MapSignals:
    """Collects a row of ``MAP_COLUMNS`` per step; shares are of the returns of the step's scan.

    - off: 1 if the best cluster is not within 1 m and 30° of the true pose, else 0.
    - wrong: share that contradicts the map at the true pose.
    - quality: the belief's confidence that it is not lost, of its loss detector.
    - explained, short, long: shares that agree with the map or read clearly less or more.
    - beyond_random: explained, less the most that is explained at one of 256 random poses.
    - repeated: share that contradicts the map at a place where a beam from a pose at least 0.5 m
      away has contradicted it before; elsewhere: at another place.
    """

    def __init__(self, floor_plan: Map, lidar: Lidar) -> None:
        self._known, self._lidar = known_part(floor_plan), lidar
        self._metre = metre(floor_plan.unit)
        self._random = Expected.of(self._known, lidar, _anywhere(floor_plan))
        self._lattice = Lattice.over(floor_plan, _ROOM)
        self._from = np.full((self._lattice.size, 2), np.nan)  # the pose of the first one, by cell
        self._rows: list[list[float]] = []

    def see(self, moment: Step) -> None:
        """Take in a step."""
        points = moment.belief.points()
        known = np.isfinite(moment.truth).all()
        if points is None or moment.t == 0 or not known:
            self._rows.append([math.nan] * len(MAP_COLUMNS))
            return
        best = np.array(best_cluster(*points, unit=self._known.unit).mean)
        ranges = np.asarray(moment.ranges, np.float64)
        fit = Expected.of(self._known, self._lidar, np.array([best, moment.truth])).fit(ranges)
        explained, (short, long) = fit.explained, fit.shares
        with np.errstate(invalid="ignore"):
            at_random = self._random.fit(ranges).explained.max()
        quality = quality_of(moment.belief)
        returned = max(int(fit.returned[0].sum()), 1)
        repeated = self._repeated(best, ranges, fit.short[0], fit.long[0], fit.expected[0])
        against = int((fit.short[0] | fit.long[0]).sum())
        near = NEAR[FOUND](best[None], moment.truth, unit=self._known.unit)
        self._rows.append(
            [
                *(float(not near[0]), float(1 - explained[1])),
                math.nan if quality is None else quality,
                *(float(explained[0]), float(explained[0] - at_random)),
                *(float(short[0]), float(long[0])),
                *(repeated / returned, (against - repeated) / returned),
            ]
        )

    def columns(self) -> dict[str, list[float | None]]:
        """Return the rows of the steps t = 1 … T as columns by name."""
        table: Floats = np.array(self._rows[1:], np.float64).reshape(-1, len(MAP_COLUMNS))
        return dict(zip(MAP_COLUMNS, map(unless_nan, table.T.tolist()), strict=True))

    def _repeated(self, best: Floats, ranges: Reals, short: Any, long: Any, expected: Reals) -> int:
        """Count the beams against the map at a place that was contradicted from elsewhere."""
        rays = Rays.of(self._lattice, self._lidar, best[None])
        ends = np.where(short, ranges, np.where(long, expected, np.inf))
        cells = rays.cells(ends[None])[0]
        cells = cells[cells >= 0]
        off = np.hypot(*(self._from[cells] - best[:2]).T)
        new = np.unique(cells[np.isnan(off)])
        self._from[new] = best[:2]
        with np.errstate(invalid="ignore"):
            return int((off >= APART * self._metre).sum())


def _anywhere(floor_plan: Map) -> Floats:
    """Return random poses in free space, (n, 3)."""
    rng, found = np.random.default_rng(_ROOT), np.empty((0, 3))
    x0, y0, x1, y1 = floor_plan.bounds
    while len(found) < _RANDOM:
        drawn = rng.uniform((x0, y0, -math.pi), (x1, y1, math.pi), (4 * _RANDOM, 3))
        found = np.vstack([found, drawn[floor_plan.free(drawn)]])
    return found[:_RANDOM]
