"""A closed polygonal path: where on it one is, and how far one has come."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deqmcl_gym.numerics.elementary import TURN, centred64
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.world import path_kernels

Pose = tuple[float, float, float]


def wrapped(angle: float) -> float:
    """Return the same direction in [-π, π), rad."""
    heading: float = centred64(angle, TURN)
    return heading


@dataclass(frozen=True)
class Path:
    """A closed polygonal path, driven in the order of its corners.

    Attributes:
        corners: (k, 2).
    """

    corners: Floats

    @cached_property
    def length(self) -> float:
        """Once around."""
        return float(self._lengths.sum())

    def arc(self, point: tuple[float, float]) -> float:
        """Arc length from corner 0 to the path's point nearest to ``point``."""
        x, y = point
        return path_kernels.nearest_arc(x, y, self.edges)

    def at(self, arc: float) -> Pose:
        """Pose on the path at an arc length, heading along it."""
        arc %= self.length
        edge = int(np.searchsorted(self._before, arc, side="right")) - 1
        dx, dy = self._along[edge]
        share = (arc - self._before[edge]) / self._lengths[edge]
        x, y = self.corners[edge] + share * self._along[edge]
        return float(x), float(y), math.atan2(dy, dx)

    def advance(self, before: float, after: float) -> float:
        """Signed way along the path between two arc lengths, the shorter way round."""
        way: float = centred64(after - before, self.length)
        return way

    def follow(self, point: tuple[float, float], before: float) -> tuple[float, float]:
        """Return :meth:`arc` of a point, and how far one came to there from arc ``before``."""
        x, y = point
        return path_kernels.follow(x, y, before, self.edges, self.length)

    def bottom_centre(self) -> Pose:
        """Return the middle of the lowest edge, heading along the path."""
        middles = self.corners + self._along / 2
        return self.at(float((self._before + self._lengths / 2)[middles[:, 1].argmin()]))

    def corners_from(self, point: tuple[float, float]) -> Floats:
        """Return the points to drive to, once around from the path's point nearest to ``point``."""
        arc = self.arc(point)
        entry = np.array(self.at(arc)[:2])
        after = int(np.searchsorted(self._before, arc, side="right"))
        order = np.roll(self.corners, -after, axis=0)
        return np.vstack([entry, order, entry])

    @cached_property
    def edges(self) -> Floats:
        """Rows (x, y, dx, dy, length, arc length of the corner), (k, 6)."""
        return np.column_stack([self.corners, self._along, self._lengths, self._before])

    @cached_property
    def _along(self) -> Floats:
        return np.roll(self.corners, -1, axis=0) - self.corners

    @cached_property
    def _lengths(self) -> Floats:
        lengths: Floats = np.hypot(*self._along.T)
        return lengths

    @cached_property
    def _before(self) -> Floats:
        return np.concatenate([[0.0], np.cumsum(self._lengths)[:-1]])
