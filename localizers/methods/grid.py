"""p(x_t | a_{1:t}, o_{1:t}, m): Markov localization on a grid over (x, y, θ).

Burgard et al. 1996; Fox, Burgard & Thrun 1999; Thrun et al. 2005, tables 8.1 and 8.2. The target is
MCL's, without particles but with cells: no randomness, but what happens inside a cell is not seen.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError
from localizers.api import Points, Prior, RobotModel, checked_plan, checked_step
from localizers.inference import grid_kernels
from localizers.inference.belief import Events
from localizers.inference.grid_motion import GridMotion
from localizers.inference.kernels import pointed_at
from localizers.inference.trust import ANYWHERE, Trust
from localizers.models.free_space import even_poses
from localizers.models.motion import OdometryMotion, odometry
from localizers.models.pose_grid import PoseGrid
from localizers.models.scan import LidarScan, ScanTable

LEAST = 1e-9  # of the heaviest cell's weight: lighter cells are left out of ``points``
MOST_POINTS = 20_000
_UNSEEN = -20.0  # log of the prior's mass on the grid, below which nothing of it was seen
_WORKING_BYTES = 100  # per cell: four float64 masses, poses, what a prior is integrated with


@dataclass(frozen=True)
class GridBelief:
    """The probability of each cell.

    Attributes:
        mass: with sum 1, (H, Y, X).
        trust: evidence for and against this belief.
        events: counted trouble since reset.
    """

    grid: PoseGrid
    mass: Floats
    trust: Trust
    events: Events = field(default_factory=Events)

    def points(self, offset: int = 0) -> Points | None:
        """Return the centres (n, 3) of the cells that count and their weights; at offset 0 only.

        Cells of less than ``LEAST`` of the heaviest one's weight are left out. If more than
        ``MOST_POINTS`` are left, the cells at that many equidistant quantiles of the mass stand
        for all (systematic selection, without randomness), so n is at most ``MOST_POINTS``.
        """
        if offset != 0:
            return None
        mass = self.mass.reshape(-1)
        cells = np.flatnonzero(mass > LEAST * mass.max())
        weights = mass[cells]
        if cells.size > MOST_POINTS:
            chosen = np.empty(MOST_POINTS, np.intp)
            pointed_at(weights, (np.arange(MOST_POINTS) + 0.5) / MOST_POINTS, chosen)
            kept, counts = np.unique(chosen, return_counts=True)
            cells, weights = cells[kept], counts.astype(np.float64)
        return self.grid.centres(cells).T, weights / weights.sum()

    @property
    def quality(self) -> float:
        """P(not lost | o_{1:t}), in [0, 1]."""
        return self.trust.quality


class GridLocalizer:
    """A ``Localizer`` that keeps the probability of every cell."""

    def __init__(self, robot: RobotModel, grid: PoseGrid, motion: OdometryMotion) -> None:
        """Make a localizer for ``robot`` on a grid."""
        self.robot = robot
        self.grid = grid
        self._motion = GridMotion(grid, motion)
        self._scan = LidarScan(floor_plan=robot.floor_plan, lidar=robot.lidar, beam=robot.scan)
        self._belief: GridBelief | None = None

    def reset(self, prior: Prior, plan: ArrayLike, rng: np.random.Generator) -> GridBelief:
        """Start anew; see ``Localizer.reset``. Nothing is drawn, the plan is not used."""
        checked_plan(plan)
        trust = Trust(self._scan, even_poses(self.robot.floor_plan, ANYWHERE))
        self._belief = GridBelief(self.grid, prior_mass(self.grid, prior), trust)
        return self._belief

    def update(self, ranges: ArrayLike, action: ArrayLike, plan: ArrayLike) -> GridBelief:
        """Go one step on; see ``Localizer.update``."""
        if self._belief is None:
            raise RuntimeError(
                "update was called before reset: call reset(prior, plan, rng) first."
            )
        before = self._belief
        scan, command, _, usable = checked_step(ranges, action, plan, self.robot.lidar)
        events = before.events.of_scan(scan.size, usable)
        mass = self._motion.predicted(before.mass, command)
        if not mass.any():  # all of it has left the map
            mass, events = before.mass, events.plus(weight_collapses=1)
        after = np.empty_like(mass)
        log_evidence = grid_kernels.reweight(
            mass.reshape(-1), self._table.log_likelihood(scan), after.reshape(-1)
        )
        if log_evidence == -np.inf:
            after, events = mass / mass.sum(), events.plus(weight_collapses=1)
        trust = before.trust.after(scan, log_evidence)
        self._belief = GridBelief(self.grid, after, trust, events)
        return self._belief

    @cached_property
    def _table(self) -> ScanTable:
        return ScanTable(self._scan, self.grid.centres())


def grid(robot: RobotModel, *, cell: float = 5.0, headings: int = 72) -> GridLocalizer:
    """Return Markov localization on a grid over the floor plan's bounds.

    Args:
        robot: what the localizer is made for; its motion must be an ``OdometryMotion``.
        cell: edge of a cell in x and y, px.
        headings: cells in θ.
    """
    cells = PoseGrid(
        bounds=robot.floor_plan.bounds,
        cell=cell,
        headings=headings,
        bytes_per_cell=_WORKING_BYTES + 4 * robot.lidar.beams,
    )
    return GridLocalizer(robot, cells, odometry(robot.motion, "grid"))


def prior_mass(grid: PoseGrid, prior: Prior) -> Floats:
    """Return the prior's probability of each cell, by 2 x 2 x 2 points per cell, (H, Y, X).

    A prior of which the points see next to nothing, because it is far narrower than a cell or a
    single pose, goes into the cell of its mean.
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
        at = grid.cell_of(prior.mean)
        if at is None:
            raise InputError(
                f"the prior's mean is {tuple(prior.mean)}, but must lie on the floor plan, "
                f"which spans {grid.bounds} px."
            )
        mass[at] = 1.0
    shares: Floats = mass / mass.sum()
    shares[shares < grid_kernels.NOTHING] = 0.0
    return shares.reshape(grid.shape)
