"""A regular grid of poses: cells of x, y and heading."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deqmcl_gym.numerics.types import Floats, Indices, Singles
from deqmcl_gym.validation import InputError, integer, keep_plain, number

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
