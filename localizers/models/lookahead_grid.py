"""h_t(x) = E[Π g of the planned steps | x_t = x], tabulated on a grid of poses."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.maps import Map
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Bools, Floats, Singles
from deqmcl_gym.validation import InputError, integer, number
from localizers.models import lookahead_kernels as grid_kernels
from localizers.models.motion import OdometryMotion
from localizers.models.normal import normal_cdf, normal_pdf

LEAST = np.float32(1e-30)  # keeps every h a normal float32 and its logarithm finite
MAX_NODES = 20_000_000
CACHE_BYTES = 2**27  # of the tables kept for one grid
# Gauss-Hermite quadrature of the distance driven
_SIGMAS, _SHARES = (-math.sqrt(3.0), 0.0, math.sqrt(3.0)), (1 / 6, 4 / 6, 1 / 6)
_REACH = 5.0  # standard deviations of the turn that are summed over


@dataclass(frozen=True, kw_only=True)
class LookaheadGrid:
    """h ← Σ_{x'} p(x' | x, u) g(x, x') h(x'), backwards over a window of actions, from 1.

    The nodes stand ``cell`` px apart, from a cell outside the map's bounds to a cell outside again,
    for ``headings`` directions. A step is a turn, then a drive, so backwards it is a drive, then a
    turn. The drive is a sum over three distances, h interpolated linearly between nodes; the turn
    a sum over headings, its weights those of linear interpolation averaged over the noise. A pose
    off the grid counts as the nearest on it.

    h is at least ``LEAST``: where no future is feasible, it says nothing. Tables are kept for all
    localizers of a process with an equal grid.

    Attributes:
        floor_plan, radius, beta: of g, as in ``FreeSpace``.
        motion: p(x' | x, u).
        cell: px.
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
        integer("headings", self.headings, low=1)
        if math.prod(self.shape) > MAX_NODES:
            raise InputError(
                f"cells of {self.cell:g} {self.floor_plan.unit} and {self.headings} headings make "
                f"{math.prod(self.shape):,} nodes of this map, but allowed are {MAX_NODES:,}: "
                "give a larger cell or fewer headings."
            )

    def log_h(self, poses: Singles, window: Floats) -> Floats:
        """Log h of poses (3, n) under a window of actions (F, 2), (n,)."""
        out = np.empty(poses.shape[1])
        table = _tables(self)(window.tobytes())
        grid_kernels.log_interpolated(table, poses, *self.origin, self.cell, out)
        return out

    def table(self, window: Floats) -> Singles:
        """Compute h at the nodes under a window of actions (F, 2), (H, ny, nx)."""
        headings, ny, nx = self.shape
        pad = self._reach(window)
        height, width = ny + 2 * pad, nx + 2 * pad
        h = np.ones((headings, height * width), np.float32)
        out = np.ones_like(h)
        charge = np.float32(math.exp(-self.beta))
        for action in window[::-1]:
            distance, turn = action.tolist()
            sd_distance, sd_turn = self.motion.spread(action)
            drives = _drives(self, distance, sd_distance, pad)
            turns = _turn_weights(turn, sd_turn, headings)
            grid_kernels.stepped_back(h, width, pad, *drives, charge, *turns, LEAST, out)
            h, out = out, h
        inner = h.reshape(headings, height, width)[:, pad : pad + ny, pad : pad + nx]
        return np.ascontiguousarray(inner)

    def _reach(self, window: Floats) -> int:
        """More nodes than any drive of a window goes to a side, counted to the border at most."""
        farthest = 0.0
        for action in window:
            sd, _ = self.motion.spread(action)
            farthest = max(farthest, abs(float(action[0])) + _SIGMAS[-1] * sd)
        _, ny, nx = self.shape
        return math.ceil(min(farthest / self.cell, max(ny, nx) + 1.0)) + 1

    @property
    def origin(self) -> tuple[float, float]:
        """The first node (x, y), px."""
        x0, y0, _, _ = self.floor_plan.bounds
        return x0 - self.cell, y0 - self.cell

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of nodes (H, ny, nx)."""
        x0, y0, x1, y1 = self.floor_plan.bounds
        nx, ny = (math.ceil(length / self.cell) + 3 for length in (x1 - x0, y1 - y0))
        return self.headings, ny, nx


Drives = tuple[NDArray[np.int64], Singles, Singles, Bools]


@lru_cache(maxsize=2)
def _tables(grid: LookaheadGrid) -> Callable[[bytes], Singles]:
    """Return the table of a window of actions; the latest are kept."""
    size = math.prod(grid.shape) * np.float32().itemsize

    @lru_cache(maxsize=max(1, CACHE_BYTES // size))
    def table(window: bytes) -> Singles:
        return grid.table(np.frombuffer(window).reshape(-1, 2))

    return table


@lru_cache(maxsize=8)
def _drives(grid: LookaheadGrid, distance: float, sd: float, pad: int) -> Drives:
    """Return shifts, their shares and which collide, as ``grid_kernels.stepped_back`` has them."""
    distances = np.array([distance + sd * z for z in (_SIGMAS if sd > 0 else (0.0,))])
    shares = np.array(_SHARES if sd > 0 else (1.0,), dtype=np.float32)
    angles = np.arange(grid.headings) * (2 * math.pi / grid.headings)
    directions = np.column_stack([arrays.cos(angles), arrays.sin(angles)])
    shifts = distances[:, None, None] * directions  # (Q, H, 2) px
    _, ny, nx = grid.shape
    x0, y0 = grid.origin
    x, y = np.meshgrid(x0 + grid.cell * np.arange(nx), y0 + grid.cell * np.arange(ny))
    nodes = np.column_stack([x.ravel(), y.ravel()])
    collides = np.zeros((*shifts.shape[:2], ny, nx + 2 * pad), np.bool_)
    for q, heading in np.ndindex(shifts.shape[:2]):
        ends = nodes + shifts[q, heading]
        blocked = grid.floor_plan.collides(nodes, ends, grid.radius)
        collides[q, heading, :, :nx] = blocked.reshape(ny, nx)
    far = max(ny, nx) + 1.0  # from there on all is the border
    shifts = np.clip(shifts / grid.cell, -far, far)
    cells = np.floor(shifts)
    parts = (shifts - cells).astype(np.float32)
    return cells.astype(np.int64), parts, shares, collides.reshape(*shifts.shape[:2], -1)


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
