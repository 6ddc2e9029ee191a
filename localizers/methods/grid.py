"""p(x_t | a_{1:t}, o_{1:t}, m): Markov localization on a grid over (x, y, θ).

Burgard et al. 1996; Fox, Burgard & Thrun 1999; Thrun et al. 2005, tables 8.1 and 8.2. Cells are
(θ, y, x), (H, Y, X). Mass moves by the noise's density, shared out linearly between cells: that
keeps its mean exactly, and adds up to a quarter of a cell² of variance per axis and step.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np

from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import Floats, Indices, Singles, arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import exp64, log64
from deqmcl_gym.validation import InputError, integer, keep_plain, number
from localizers.api import Points, Prior
from localizers.inference import FilterLocalizer
from localizers.inference.belief import Events
from localizers.inference.loss_detector import LossDetector
from localizers.inference.particles import pointed_at
from localizers.models import RobotModel
from localizers.models.motion import OdometryMotion, distance_and_bearing, increments, odometry
from localizers.models.scan import LidarScan, Scan, normal_pdf

EMPTY_CELL = 1e-140  # of less: below the normal numbers arithmetic takes 100 times as long
_MAX_BYTES = 2**30


@dataclass(frozen=True, kw_only=True)
class PoseGrid:
    """Cells of ``cell`` x ``cell`` and 2π / ``headings`` rad, in the order (θ, y, x).

    It is centred on ``bounds`` (x_min, y_min, x_max, y_max), in the map's unit; the first heading
    is -π. More than ``_MAX_BYTES`` of memory in total are refused.
    """

    bounds: tuple[float, float, float, float]
    cell: float
    headings: int
    bytes_per_cell: int = 8

    def __post_init__(self) -> None:
        number("cell", self.cell, low=0, above=True)
        integer("headings", self.headings, low=4, high=100_000)
        keep_plain(self)
        cells = math.prod(self.shape)
        if cells * self.bytes_per_cell > _MAX_BYTES:
            gibibytes = cells * self.bytes_per_cell / 2**30
            raise InputError(
                f"cell is {self.cell:g} and headings is {self.headings}: {cells:,} cells, which "
                f"would take {gibibytes:,.1f} GiB; at most {_MAX_BYTES / 2**30:g} GiB are allowed: "
                "give larger cells or fewer headings."
            )

    @cached_property
    def shape(self) -> tuple[int, int, int]:
        """Cells in θ, y, x."""
        x0, y0, x1, y1 = self.bounds
        return (self.headings, math.ceil((y1 - y0) / self.cell), math.ceil((x1 - x0) / self.cell))

    @property
    def heading_step(self) -> float:
        """Width of a cell in θ, rad."""
        return 2 * math.pi / self.headings

    @cached_property
    def axes(self) -> tuple[Floats, Floats, Floats]:
        """Centres of the cells along θ, y and x."""
        x0, y0, x1, y1 = self.bounds
        _, rows, columns = self.shape
        return (
            -math.pi + self.heading_step * np.arange(float(self.headings)),
            (y0 + y1) / 2 + self.cell * (np.arange(float(rows)) - (rows - 1) / 2),
            (x0 + x1) / 2 + self.cell * (np.arange(float(columns)) - (columns - 1) / 2),
        )

    def centres(self, cells: Indices | None = None) -> Singles:
        """Poses at the centres of the cells of these indices (of all cells if None), (3, n)."""
        chosen = np.arange(math.prod(self.shape)) if cells is None else cells
        heading, row, column = np.unravel_index(chosen, self.shape)
        headings, ys, xs = self.axes
        return np.stack([xs[column], ys[row], headings[heading]]).astype(np.float32)


@compiled
def turn(mass: Floats, shares: Floats, out: Floats) -> None:
    """out[h] = Σ_k shares[k] mass[h - k]: circular convolution over the headings."""
    headings = mass.shape[0]
    for h in range(headings):
        goal = out[h].reshape(-1)
        goal[:] = 0.0
        for k in range(headings):
            share = shares[k]
            if share > 0.0:
                source = mass[(h - k) % headings].reshape(-1)
                for i in range(goal.size):
                    goal[i] += share * source[i]


@compiled
def shift(mass: Floats, stencils: Floats, low_row: int, low_column: int, out: Floats) -> None:
    """out[h, y + j, x + i] = Σ stencils[h, j, i] mass[h, y, x]; (j, i) from low_row, low_column."""
    headings, rows, columns = mass.shape
    for h in range(headings):
        out[h] = 0.0
        for j in range(stencils.shape[1]):
            down = low_row + j
            for i in range(stencils.shape[2]):
                share = stencils[h, j, i]
                if share > 0.0:
                    right = low_column + i
                    first, last = max(0, -right), min(columns, columns - right)
                    for row in range(max(0, -down), min(rows, rows - down)):
                        goal = out[h, row + down]
                        source = mass[h, row]
                        for column in range(first, last):
                            goal[column + right] += share * source[column]


@compiled
def reweight(mass: Floats, log_likelihoods: Floats, out: Floats) -> float:
    """Out ∝ mass exp(log-likelihood) with sum 1; return log Σ mass p / Σ mass.

    -inf (and nothing filled in) if no mass is left. What is below ``EMPTY_CELL`` is dropped.
    """
    top, before = -np.inf, 0.0
    for i in range(mass.size):
        before += mass[i]
        if mass[i] > 0.0:
            top = max(top, log_likelihoods[i])
    if not (before > 0.0 and top > -np.inf):
        return -np.inf
    for i in range(mass.size):
        factor = exp64(min(log_likelihoods[i] - top, 0.0))
        out[i] = mass[i] * factor if factor > EMPTY_CELL and mass[i] > EMPTY_CELL else 0.0
    after = 0.0
    for i in range(mass.size):
        after += out[i]
    if not after > 0.0:
        return -np.inf
    for i in range(mass.size):
        share = out[i] / after
        out[i] = share if share > EMPTY_CELL else 0.0
    return float(top + log64(after / before))


_TAIL = 5.0  # standard deviations that the noise is followed to


@dataclass(frozen=True)
class GridMotion:
    """The motion model on a grid."""

    grid: PoseGrid
    motion: OdometryMotion

    def predicted(self, mass: Floats, action: Floats) -> Floats:
        """Return Σ_x' p(x | x', a) mass(x'), (H, Y, X); what leaves the grid is lost."""
        action = increments(action)
        sd_distance, sd_turn = self.motion.spread(action)
        turned, driven = np.empty_like(mass), np.empty_like(mass)
        turn(mass, self._turns(float(action[2]), sd_turn), turned)
        way = distance_and_bearing(action)
        stencils, low_row, low_column = self._stencils(*way, sd_distance)
        shift(turned, stencils, low_row, low_column, driven)
        return driven

    def _turns(self, turn: float, sd: float) -> Floats:
        """Probability of each number of heading cells to turn by, (H,)."""
        headings, step = self.grid.headings, self.grid.heading_step
        # beyond a few turns the noise is spread evenly over the headings
        nodes, shares = _nodes(turn % (2 * math.pi), sd, step, _TAIL * math.pi * 2)
        cells = nodes / step
        below = np.floor(cells)
        above = shares * (cells - below)
        low = below.astype(np.intp) % headings
        moved: Floats = np.zeros(headings)
        moved += np.bincount(low, shares - above, headings)
        moved += np.bincount((low + 1) % headings, above, headings)
        return moved

    def _stencils(self, distance: float, bearing: float, sd: float) -> tuple[Floats, int, int]:
        """Shares of mass of each heading by rows and columns moved, (H, J, I), and the first."""
        headings, rows, columns = self.grid.shape
        nodes, shares = _nodes(
            distance, sd, self.grid.cell, self.grid.cell * math.hypot(rows + 1, columns + 1)
        )
        if nodes.size == 0:
            return np.zeros((headings, 1, 1)), 0, 0
        angles = self.grid.axes[0][:, None] + bearing
        down = arrays.sin(angles) * (nodes / self.grid.cell)  # (H, nodes)
        right = arrays.cos(angles) * (nodes / self.grid.cell)
        row, column = np.floor(down), np.floor(right)
        low_row, low_column = int(row.min()), int(column.min())
        shape = (headings, int(row.max()) - low_row + 2, int(column.max()) - low_column + 2)
        j, i = row.astype(np.intp) - low_row, column.astype(np.intp) - low_column
        h = np.broadcast_to(np.arange(headings)[:, None], j.shape)
        above, beyond = down - row, right - column
        stencils = np.zeros(math.prod(shape))
        for dj, di, share in (
            (0, 0, (1 - above) * (1 - beyond)),
            (0, 1, (1 - above) * beyond),
            (1, 0, above * (1 - beyond)),
            (1, 1, above * beyond),
        ):
            index = np.ravel_multi_index((h, j + dj, i + di), shape).ravel()
            stencils += np.bincount(index, (shares * share).ravel(), stencils.size)
        return stencils.reshape(shape), low_row, low_column


def _nodes(mean: float, sd: float, cell: float, reach: float) -> tuple[Floats, Floats]:
    """Points at most ``reach`` from 0 and their shares of N(mean, sd²), (k,), right to 1e-3."""
    if sd == 0:
        return (np.array([mean]), np.ones(1)) if abs(mean) <= reach else (np.empty(0), np.empty(0))
    spacing = min(sd, cell) / 8
    first = math.ceil(max(-_TAIL * sd, -reach - mean) / spacing)
    last = math.floor(min(_TAIL * sd, reach - mean) / spacing)
    steps: Floats = np.arange(float(first), max(last, first - 1) + 1.0) * spacing
    shares = normal_pdf(steps / sd) * (spacing / sd)
    inside = _TAIL * sd <= min(reach - mean, reach + mean)  # then nothing is cut but the tail
    return mean + steps, shares / shares.sum() if inside else shares


LEAST_SHARE = 1e-9  # of the heaviest cell's weight: lighter cells are left out of ``points``
MOST_POINTS = 20_000


class GridBelief(NamedTuple):
    """The probability of each cell: ``mass``, with sum 1, (H, Y, X)."""

    grid: PoseGrid
    mass: Floats
    detector: LossDetector
    events: Events = Events()

    def points(self, offset: int = 0) -> Points | None:
        """Return the centres (n, 3) of the heavier cells and their weights; at offset 0 only.

        Those of ``LEAST_SHARE`` of the heaviest one or more. Of more than ``MOST_POINTS`` the cells
        at that many equidistant quantiles of the mass represent them.
        """
        if offset != 0:
            return None
        mass = self.mass.reshape(-1)
        cells = np.flatnonzero(mass > LEAST_SHARE * mass.max())
        weights = mass[cells]
        if cells.size > MOST_POINTS:
            chosen = pointed_at(weights, (np.arange(MOST_POINTS) + 0.5) / MOST_POINTS)
            unique, counts = np.unique(chosen, return_counts=True)
            cells, weights = cells[unique], counts.astype(np.float64)
        return self.grid.centres(cells).T, weights / weights.sum()

    @property
    def scan_log_evidence(self) -> float:
        """Log Σ w p(o_t | x) of the latest scan, under the belief before it."""
        return self.detector.log_right

    @property
    def quality(self) -> float:
        return self.detector.quality


@dataclass(frozen=True)
class GridFilter:
    """Markov localization: the probability of every cell, predicted and reweighted."""

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
        events = belief.events
        mass = self.motion.predicted(belief.mass, action)
        if not mass.any():  # all of it has left the map
            mass, events = belief.mass, events.plus(weight_collapses=1)
        after = np.empty_like(mass)
        log_evidence = reweight(mass.reshape(-1), self._log_likelihood(scan), after.reshape(-1))
        if log_evidence == -np.inf:
            after, events = mass / mass.sum(), events.plus(weight_collapses=1)
        return GridBelief(self.grid, after, belief.detector.scanned(scan, log_evidence), events)

    @cached_property
    def _log_likelihood(self) -> Callable[[Scan], Floats]:
        return self.scan.at(self.grid.centres())


def grid(
    robot: RobotModel,
    *,
    cell: Annotated[float | None, "edge of a cell, in the map's unit; None: 5 px or 0.1 m"] = None,
    headings: Annotated[int, "cells of the heading, at least 4"] = 72,
) -> FilterLocalizer[GridBelief]:
    """Return Markov localization on a grid over the floor plan's bounds, by ``OdometryMotion``."""
    cells = PoseGrid(
        bounds=robot.floor_plan.bounds,
        cell=5 * pixel(robot.floor_plan.unit) if cell is None else cell,
        headings=headings,
        # four float64 masses, poses, what a prior is integrated with; ranges
        bytes_per_cell=100 + 4 * robot.lidar.beams,
    )
    motion = GridMotion(cells, odometry(robot.motion, "grid"))
    scan = robot.beam_scan("the localizer 'grid'")
    detector = LossDetector.of(scan, robot.floor_plan)
    return FilterLocalizer(robot, GridFilter(cells, motion, scan, detector))


def prior_mass(grid: PoseGrid, prior: Prior) -> Floats:
    """Return the prior's probability of each cell, by 2 x 2 x 2 points per cell, (H, Y, X).

    If these see next to none of it, as it is far narrower, all goes into the cell of its mean.
    """
    centres = grid.centres().T.astype(np.float64)
    half = np.array([grid.cell, grid.cell, grid.heading_step]) / 4
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    logs = np.stack([prior.log_density(centres + half * corner) for corner in corners])
    top = logs.max()
    mass = arrays.exp(logs - top).sum(axis=0) if np.isfinite(top) else np.zeros(len(centres))
    volume = grid.cell**2 * grid.heading_step / len(corners)
    if not top + float(arrays.log(max(mass.sum() * volume, 1e-300))) > -20.0:
        mass[:] = 0.0
        if prior.mean is None:
            raise InputError(
                f"the prior {prior!r} has neither a mean nor mass in any cell: give another prior, "
                "or smaller cells."
            )
        off = np.abs(centres - np.array(prior.mean))
        off[:, 2] = np.abs(arrays.wrapped(off[:, 2]))
        cells = (off / (2 * half)).max(axis=1)  # from the mean, in halves of them
        if not cells.min() <= 1.001:
            raise InputError(
                f"the prior's mean is {tuple(prior.mean)}, but must lie on the floor plan, "
                f"which spans {grid.bounds}."
            )
        mass[cells.argmin()] = 1.0
    with np.errstate(under="ignore"):
        shares: Floats = mass / mass.sum()
    shares[shares < EMPTY_CELL] = 0.0
    return shares.reshape(grid.shape)
