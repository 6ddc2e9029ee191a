"""h_t(x) = E[Π g of the planned steps | x_t = x], tabulated on a regular grid of poses."""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.maps import Map
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.arrays import normal_cdf
from deqmcl_gym.numerics.types import Bools, Floats, Indices, Singles
from deqmcl_gym.validation import InputError, integer, keep_plain, number
from localizers.models import lookahead_kernels as grid_kernels
from localizers.models.beams import normal_pdf
from localizers.models.motion import OdometryMotion, distance_and_bearing, increments

MAX_BYTES = 2**30
_MOST_HEADINGS = 100_000


@dataclass(frozen=True, kw_only=True)
class PoseGrid:
    """Cells of ``cell`` x ``cell`` and 2π / ``headings`` rad, in the order (θ, y, x).

    Attributes:
        bounds: the region to cover, (x_min, y_min, x_max, y_max); the grid is centred on it.
        cell: edge of a cell, in the map's unit.
        headings: number of headings; the first centre is -π.
        bytes_per_cell: memory per cell; more than ``MAX_BYTES`` in total is refused.
    """

    bounds: tuple[float, float, float, float]
    cell: float
    headings: int
    bytes_per_cell: int = 8

    def __post_init__(self) -> None:
        number("cell", self.cell, low=0, above=True)
        integer("headings", self.headings, low=4, high=_MOST_HEADINGS)
        keep_plain(self)
        x0, y0, x1, y1 = self.bounds
        cells = self.headings * math.ceil((x1 - x0) / self.cell) * math.ceil((y1 - y0) / self.cell)
        if cells * self.bytes_per_cell > MAX_BYTES:
            gibibytes = cells * self.bytes_per_cell / 2**30
            raise InputError(
                f"cell is {self.cell:g} and headings is {self.headings}: {cells:,} cells, which "
                f"would take {gibibytes:,.1f} GiB; at most {MAX_BYTES / 2**30:g} GiB are allowed: "
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

    def cell_of(self, pose: tuple[float, float, float]) -> int | None:
        """Index of the cell a pose is in; None outside."""
        headings, ys, xs = self.axes
        column = round((pose[0] - float(xs[0])) / self.cell)
        row = round((pose[1] - float(ys[0])) / self.cell)
        heading = round((pose[2] - float(headings[0])) / self.heading_step) % self.headings
        if not (0 <= row < ys.size and 0 <= column < xs.size):
            return None
        return (heading * ys.size + row) * xs.size + column


LEAST = np.float32(1e-30)  # keeps every h a normal float32 and its logarithm finite
_SCALE = np.float32(2.0**64)  # h is computed as h · 2⁶⁴: no product is subnormal, which is slow
MAX_NODES = 20_000_000
CACHE_BYTES = 2**27  # of the tables kept for one grid
# Gauss-Hermite quadrature of the distance driven
_SIGMAS, _SHARES = (-math.sqrt(3.0), 0.0, math.sqrt(3.0)), (1 / 6, 4 / 6, 1 / 6)
_REACH = 5.0  # standard deviations of the turn that are summed over


@dataclass(frozen=True, kw_only=True)
class LookaheadGrid:
    """h ← Σ_{x'} p(x' | x, u) g(x, x') h(x'), backwards over a window of actions, from 1.

    The nodes are ``cell`` apart, from a cell outside the map's bounds to a cell outside again,
    for ``headings`` directions. A step is a turn, then a drive, so backwards it is a drive, then a
    turn. The drive is a sum over three distances, h interpolated linearly between nodes; the turn
    a sum over headings, its weights those of linear interpolation averaged over the noise. A pose
    off the grid counts as the nearest one on it.

    h is at least ``LEAST``, also where no future is feasible. Tables are kept for all
    localizers of a process with an equal grid.

    Attributes:
        floor_plan, radius, beta: of g, as in ``FreeSpace``.
        motion: p(x' | x, u).
        cell: distance between neighbouring nodes, in the map's unit.
        headings: H.
    """

    floor_plan: Map
    radius: float
    beta: float
    motion: OdometryMotion
    cell: float
    headings: int = 72

    def __post_init__(self) -> None:
        number("cell", self.cell, low=0, above=True)
        integer("headings", self.headings, low=1, high=_MOST_HEADINGS)
        keep_plain(self)
        if math.prod(self.shape) > MAX_NODES:
            raise InputError(
                f"cells of {self.cell:g} {self.floor_plan.unit} and {self.headings} headings make "
                f"{math.prod(self.shape):,} nodes of this map, but at most {MAX_NODES:,} are "
                "allowed: give a larger cell or fewer headings."
            )

    def log_h(self, poses: Singles, window: Floats) -> Floats:
        """Log h of poses (3, n) under a window of increments (F, 3), (n,)."""
        out = np.empty(poses.shape[1])
        table = _tables(self).of(window, self.around(poses))
        _, ny, nx = self.shape
        grid_kernels.log_interpolated(
            table.h, poses, (*self.origin, self.cell), (ny, nx), table.corner, out
        )
        return out

    def table(self, window: Floats, asked: "Nodes | None" = None) -> "Table":
        """Compute h under a window of increments (F, 3), at all nodes or at those asked for.

        Backwards, each step is done for no more nodes than the ones before it can lead to.
        """
        window = increments(window)
        headings, ny, nx = self.shape
        before = [asked or Nodes(0, 0, nx, ny, np.ones(headings, np.bool_))]
        turns, spreads, farthest = [], [self.motion.spread(action) for action in window], 0.0
        ways = [distance_and_bearing(action) for action in window]
        for (distance, _), turn, (sd, sd_turn) in zip(
            ways, window[:, 2].tolist(), spreads, strict=True
        ):
            turns.append(_turn_weights(turn, sd_turn, headings))
            far = (abs(distance) + _SIGMAS[-1] * sd) / self.cell
            before.append(before[-1].led_to(far, *turns[-1], (ny, nx)))
            farthest = max(farthest, far)
        widest = before[-2] if len(before) > 1 else before[0]
        # more nodes than any drive goes to a side, counted to the border at most
        pad = math.ceil(min(farthest, max(ny, nx) + 1.0)) + 1
        rows, columns = widest.high - widest.low, widest.right - widest.left
        h = np.full((headings, (rows + 2 * pad) * (columns + 2 * pad)), _SCALE)
        out = h.copy()
        charge, least = np.float32(math.exp(-self.beta)), LEAST * _SCALE
        drives: dict[tuple[float, float, float], Drives] = {}
        for step in range(len(window))[::-1]:
            drive, nodes = (*ways[step], spreads[step][0]), before[step]
            if drive not in drives:
                drives[drive] = _among(_drives(self, *drive), widest, pad)
            grid_kernels.stepped_back(
                h, columns + 2 * pad, pad, drives[drive], charge, turns[step], least,
                (nodes.low - widest.low, nodes.high - widest.low), nodes.headings, out,
            )  # fmt: skip
            h, out = out, h
        nodes, planes = before[0], h.reshape(headings, rows + 2 * pad, -1)
        left, low = pad + nodes.left - widest.left, pad + nodes.low - widest.low
        inner = planes[:, low : low + nodes.high - nodes.low]
        return Table(inner[:, :, left : left + nodes.right - nodes.left] / _SCALE, nodes)

    def around(self, poses: Singles) -> "Nodes":
        """Return the nodes that h of poses (3, n) is interpolated between."""
        headings, ny, nx = self.shape
        x, y, heading = poses.astype(np.float64)
        xy = (np.stack([x, y]) - np.array(self.origin)[:, None]) / self.cell
        last = np.array([nx, ny]) - 2
        left, low = np.clip(xy.min(axis=1), 0, last).astype(np.intp).tolist()
        right, high = np.clip(xy.max(axis=1), 0, last).astype(np.intp).tolist()
        turns = heading / (2 * np.pi)
        first = ((turns - np.floor(turns)) * headings).astype(np.intp)
        wanted = np.zeros(headings, np.bool_)
        wanted[[first % headings, (first + 1) % headings]] = True
        return Nodes(left, low, right + 2, high + 2, wanted)

    @property
    def origin(self) -> tuple[float, float]:
        """The first node (x, y)."""
        x0, y0, _, _ = self.floor_plan.bounds
        return x0 - self.cell, y0 - self.cell

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of nodes (H, ny, nx)."""
        x0, y0, x1, y1 = self.floor_plan.bounds
        nx, ny = (math.ceil(length / self.cell) + 3 for length in (x1 - x0, y1 - y0))
        return self.headings, ny, nx


class Nodes(NamedTuple):
    """A rectangle of nodes, columns [left, right) and rows [low, high), at some headings, (H,)."""

    left: int
    low: int
    right: int
    high: int
    headings: Bools

    def led_to(self, far: float, first: int, weights: Singles, shape: tuple[int, int]) -> "Nodes":
        """Return the nodes a step leads to from here: ``far`` cells ahead, turned as weighted."""
        (ny, nx), reach = shape, math.ceil(min(far, max(shape) + 1.0))
        turned = np.zeros_like(self.headings)
        ahead = np.flatnonzero(self.headings)[:, None] + (first + np.arange(weights.size))
        turned[ahead % turned.size] = True
        left, low = max(self.left - reach, 0), max(self.low - reach, 0)
        return Nodes(left, low, min(self.right + reach, nx), min(self.high + reach, ny), turned)

    def hold(self, other: "Nodes") -> bool:
        """Whether all of the others are among these."""
        columns = self.left <= other.left and other.right <= self.right
        rows = self.low <= other.low and other.high <= self.high
        return columns and rows and not bool((other.headings & ~self.headings).any())


class Table(NamedTuple):
    """h at some nodes, (H, rows, columns); meaningless at headings that were not asked for."""

    h: Singles
    nodes: Nodes

    @property
    def corner(self) -> tuple[int, int]:
        """Column and row of the first node."""
        return self.nodes.left, self.nodes.low


class _Tables:
    """The latest tables of a grid; a second request for a window computes its whole table."""

    def __init__(self, grid: LookaheadGrid) -> None:
        size = math.prod(grid.shape) * np.float32().itemsize
        self._grid, self._most = grid, max(1, CACHE_BYTES // size)
        self._kept: dict[bytes, Table] = {}  # the one used last comes last

    def of(self, window: Floats, asked: Nodes) -> Table:
        """Return a table of h under a window of increments (F, 3), at these nodes or more."""
        key = window.tobytes()
        table = self._kept.pop(key, None)
        if table is None:
            table = self._grid.table(window, asked)
        elif not table.nodes.hold(asked):
            table = self._grid.table(window)
        self._kept[key] = table
        if len(self._kept) > self._most:
            del self._kept[next(iter(self._kept))]
        return table


@lru_cache(maxsize=2)
def _tables(grid: LookaheadGrid) -> _Tables:
    return _Tables(grid)


Drives = tuple[NDArray[np.int64], Singles, Singles, Bools]


@lru_cache(maxsize=32)
def _drives(grid: LookaheadGrid, distance: float, bearing: float, sd: float) -> Drives:
    """Return shifts, their shares and which collide, as ``stepped_back`` has them, (…, ny, nx)."""
    distances = np.array([distance + sd * z for z in (_SIGMAS if sd > 0 else (0.0,))])
    shares = np.array(_SHARES if sd > 0 else (1.0,), dtype=np.float32)
    angles = np.arange(grid.headings) * (2 * math.pi / grid.headings) + bearing
    directions = np.column_stack([arrays.cos(angles), arrays.sin(angles)])
    shifts = distances[:, None, None] * directions  # (Q, H, 2)
    _, ny, nx = grid.shape
    x0, y0 = grid.origin
    x, y = np.meshgrid(x0 + grid.cell * np.arange(nx), y0 + grid.cell * np.arange(ny))
    nodes = np.column_stack([x.ravel(), y.ravel()])
    collides = np.empty((*shifts.shape[:2], ny, nx), np.bool_)
    for q, heading in np.ndindex(shifts.shape[:2]):
        ends = nodes + shifts[q, heading]
        collides[q, heading] = grid.floor_plan.collides(nodes, ends, grid.radius).reshape(ny, nx)
    far = max(ny, nx) + 1.0  # from there on all is the border
    shifts = np.clip(shifts / grid.cell, -far, far)
    cells = np.floor(shifts)
    return cells.astype(np.int64), (shifts - cells).astype(np.float32), shares, collides


def _among(drives: Drives, nodes: Nodes, pad: int) -> Drives:
    """Return which collide from some of the nodes, their rows ``pad`` longer on either side."""
    cells, parts, shares, collides = drives
    seen = collides[..., nodes.low : nodes.high, nodes.left : nodes.right]
    wide = np.pad(seen, [(0, 0)] * 3 + [(0, 2 * pad)])
    return cells, parts, shares, wide.reshape(*collides.shape[:2], -1)


def _turn_weights(turn: float, sd: float, headings: int) -> tuple[int, Singles]:
    """Weights of the headings ``first``, ``first`` + 1, … from here: E of linear interpolation.

    The hat around node k is a second difference of max(0, ·), whose mean under N(m, s²) is known:
    E max(0, X - k) = s (z Φ(z) + φ(z)), z = (m - k) / s.
    """
    spacing = 2 * math.pi / headings
    mean, s = math.remainder(turn, 2 * math.pi) / spacing, sd / spacing
    if s > headings:  # noise of more than a full turn: every heading alike
        return 0, np.full(headings, 1 / headings, np.float32)
    first = math.floor(mean - _REACH * s)
    k = np.arange(first - 1.0, math.floor(mean + _REACH * s) + 3.0)
    if s > 0:
        z = (mean - k) / s
        ramp = s * (z * normal_cdf(z) + normal_pdf(z))
    else:
        ramp = np.maximum(mean - k, 0.0)
    weights = ramp[:-2] - 2 * ramp[1:-1] + ramp[2:]
    return first, (weights / weights.sum()).astype(np.float32)
