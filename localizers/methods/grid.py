"""p(x_t | a_{1:t}, o_{1:t}, m): Markov localization on a grid over (x, y, θ).

Burgard et al. 1996; Fox, Burgard & Thrun 1999; Thrun et al. 2005, tables 8.1 and 8.2. The target is
that of MCL, on cells instead of particles: nothing is random, but a cell hides what is inside it.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError
from localizers.api import Points, Prior
from localizers.inference import grid_motion
from localizers.inference.bayes_filter import FilterLocalizer
from localizers.inference.belief import Events
from localizers.inference.grid_motion import GridMotion, PoseGrid
from localizers.inference.loss_detector import LossDetector
from localizers.inference.resampling import pointed_at
from localizers.models.motion import odometry
from localizers.models.robot import RobotModel
from localizers.models.scan import LidarScan, Scan, ScanTable

LEAST_SHARE = 1e-9  # of the heaviest cell's weight: lighter cells are left out of ``points``
MOST_POINTS = 20_000
_UNSEEN = -20.0  # log of the prior's mass on the grid: below, the points missed it
_WORKING_BYTES = 100  # per cell: four float64 masses, poses, what a prior is integrated with


class GridBelief(NamedTuple):
    """The probability of each cell.

    Attributes:
        mass: with sum 1, (H, Y, X).
        detector: evidence for and against this belief.
        events: counts since reset.
    """

    grid: PoseGrid
    mass: Floats
    detector: LossDetector
    events: Events = Events()

    def points(self, offset: int = 0) -> Points | None:
        """Return the centres (n, 3) of the heavier cells and their weights; at offset 0 only.

        Cells of less than ``LEAST_SHARE`` of the heaviest one's weight are left out. If more than
        ``MOST_POINTS`` are left, the cells at that many equidistant quantiles of the mass represent
        them (systematic selection without randomness), so n is at most ``MOST_POINTS``.
        """
        if offset != 0:
            return None
        mass = self.mass.reshape(-1)
        cells = np.flatnonzero(mass > LEAST_SHARE * mass.max())
        weights = mass[cells]
        if cells.size > MOST_POINTS:
            chosen = pointed_at(weights, (np.arange(MOST_POINTS) + 0.5) / MOST_POINTS)
            kept, counts = np.unique(chosen, return_counts=True)
            cells, weights = cells[kept], counts.astype(np.float64)
        return self.grid.centres(cells).T, weights / weights.sum()

    @property
    def scan_log_evidence(self) -> float:
        """Log Σ w p(o_t | x) of the latest scan, under the belief before it."""
        return self.detector.log_right

    @property
    def quality(self) -> float:
        """P(not lost | o_{1:t}), in [0, 1]."""
        return self.detector.quality


@dataclass(frozen=True)
class GridFilter:
    """Markov localization: the probability of every cell, predicted and reweighted.

    Attributes:
        grid: the cells.
        motion: p(x_t | x_{t-1}, a_t), from cell to cell.
        scan: p(o_t | x_t, m).
        detector: evidence for and against its beliefs at t = 0.
    """

    grid: PoseGrid
    motion: GridMotion
    scan: LidarScan
    detector: LossDetector

    def initial(self, prior: Prior, plan: Floats, rng: np.random.Generator) -> GridBelief:
        """Return the prior's probability of each cell. Nothing is drawn, the plan is not used."""
        return GridBelief(self.grid, prior_mass(self.grid, prior), self.detector)

    def step(
        self, belief: GridBelief, scan: Scan, action: Floats, plan: Floats, rng: np.random.Generator
    ) -> GridBelief:
        """Return the belief after one increment (3,) and one scan."""
        events = belief.events
        mass = self.motion.predicted(belief.mass, action)
        if not mass.any():  # all of it has left the map
            mass, events = belief.mass, events.plus(weight_collapses=1)
        after = np.empty_like(mass)
        log_evidence = grid_motion.reweight(
            mass.reshape(-1), self._table.log_likelihood(scan), after.reshape(-1)
        )
        if log_evidence == -np.inf:
            after, events = mass / mass.sum(), events.plus(weight_collapses=1)
        return GridBelief(self.grid, after, belief.detector.scanned(scan, log_evidence), events)

    @cached_property
    def _table(self) -> ScanTable:
        return ScanTable(self.scan, self.grid.centres())


def grid(
    robot: RobotModel, *, cell: float | None = None, headings: int = 72
) -> FilterLocalizer[GridBelief]:
    """Return Markov localization on a grid over the floor plan's bounds.

    Args:
        robot: its motion must be an ``OdometryMotion``.
        cell: edge of a cell in x and y, in the map's unit; None is 5 px, or 0.1 m.
        headings: number of cells in θ.
    """
    cells = PoseGrid(
        bounds=robot.floor_plan.bounds,
        cell=5 * pixel(robot.floor_plan.unit) if cell is None else cell,
        headings=headings,
        bytes_per_cell=_WORKING_BYTES + 4 * robot.lidar.beams,
    )
    motion = GridMotion(cells, odometry(robot.motion, "grid"))
    scan = robot.beam_scan("the localizer 'grid'")
    detector = LossDetector.of(scan, robot.floor_plan)
    return FilterLocalizer(robot, GridFilter(cells, motion, scan, detector))


def prior_mass(grid: PoseGrid, prior: Prior) -> Floats:
    """Return the prior's probability of each cell, by 2 x 2 x 2 points per cell, (H, Y, X).

    If those points see next to none of it, because it is far narrower than a cell, all of it goes
    into the cell of its mean, if it has one.
    """
    centres = grid.centres().T.astype(np.float64)
    half = np.array([grid.cell, grid.cell, grid.heading_step]) / 4
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    logs = np.stack([prior.log_density(centres + half * corner) for corner in corners])
    top = logs.max()
    mass = arrays.exp(logs - top).sum(axis=0) if np.isfinite(top) else np.zeros(len(centres))
    volume = grid.cell**2 * grid.heading_step / len(corners)
    if not top + float(arrays.log(max(mass.sum() * volume, 1e-300))) > _UNSEEN:
        mass[:] = 0.0
        if prior.mean is None:
            raise InputError(
                f"the prior {prior!r} has neither a mean nor mass in any cell: give another prior, "
                "or smaller cells."
            )
        at = grid.cell_of(prior.mean)
        if at is None:
            raise InputError(
                f"the prior's mean is {tuple(prior.mean)}, but must lie on the floor plan, "
                f"which spans {grid.bounds}."
            )
        mass[at] = 1.0
    with np.errstate(under="ignore"):
        shares: Floats = mass / mass.sum()
    shares[shares < grid_motion.EMPTY_CELL] = 0.0
    return shares.reshape(grid.shape)
