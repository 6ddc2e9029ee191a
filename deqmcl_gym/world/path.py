"""Path: a polygonal path, closed or open, and arc lengths along it."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deqmcl_gym.numerics.elementary import TURN, atan2_64, centred64
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.world import path_kernels

Pose = tuple[float, float, float]
Point = tuple[float, float]


def wrapped(angle: float) -> float:
    """Return the same direction in [-π, π), rad."""
    heading: float = centred64(angle, TURN)
    return heading


@dataclass(frozen=True)
class Path:
    """A polygonal path, driven in the order of its corners.

    Attributes:
        corners: (k, 2).
        closed: whether the last corner is joined to the first.
    """

    corners: Floats
    closed: bool = True

    @cached_property
    def length(self) -> float:
        """Length once around, or from end to end."""
        return float(self._lengths.sum())

    @property
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
        edge = int(np.searchsorted(self._before, arc, side="right")) - 1
        dx, dy = self._along[edge]
        share = (arc - self._before[edge]) / self._lengths[edge]
        x, y = self.corners[edge] + share * self._along[edge]
        return float(x), float(y), atan2_64(dy, dx)

    def advance(self, before: float, after: float) -> float:
        """Signed distance along the path between two arc lengths, the shorter way round."""
        return path_kernels.shorter(after - before, self.period)

    def follow(self, start: Point, end: Point, before: float) -> tuple[float, float]:
        """Return the arc length at the end of a drive that began at arc ``before``, and progress.

        Where the path crosses itself, its order decides; see ``path_kernels.follow``.
        """
        return path_kernels.follow(*start, *end, before, self.edges, self.period)

    def bottom_centre(self) -> float:
        """Return the arc length of the middle of the lowest edge."""
        middles = self.corners + self._along / 2
        return float((self._before + self._lengths / 2)[middles[:, 1].argmin()])

    def corners_from(self, arc: float) -> Floats:
        """Return the points to drive to from an arc length: once around, or to the end."""
        entry = np.array(self.at(arc)[:2])
        after = int(np.searchsorted(self._before, arc, side="right"))
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
        starts = self.corners[: len(self._along)]
        return np.column_stack([starts, self._along, self._lengths, self._before])

    @cached_property
    def _along(self) -> Floats:
        if not self.closed:
            return np.diff(self.corners, axis=0)
        return np.roll(self.corners, -1, axis=0) - self.corners

    @cached_property
    def _lengths(self) -> Floats:
        lengths: Floats = np.sqrt((self._along**2).sum(axis=1))
        return lengths

    @cached_property
    def _before(self) -> Floats:
        return np.concatenate([[0.0], np.cumsum(self._lengths)[:-1]])
