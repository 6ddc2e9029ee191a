"""Place fields: discs along the lap."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from deqmcl_gym.numerics.types import Floats, Reals
from deqmcl_gym.world.path import Path


@dataclass(frozen=True)
class PlaceFields:
    """Discs of one radius that do not overlap.

    Attributes:
        path: the closed path that they lie on.
        centres: (k, 2) px.
        radius: px.
    """

    path: Path
    centres: Floats
    radius: float

    @classmethod
    def along(cls, path: Path, count: int, start: float = 0.0) -> "PlaceFields":
        """Put ``count`` ≥ 2 fields at equal steps of arc length, the first half a step in.

        They are as large as they can be without overlap: the radius is half the distance of the
        two nearest centres.

        Args:
            path: closed.
            count: k.
            start: arc length from which the lap is driven, px.
        """
        arcs = start + path.length * (np.arange(count) + 0.5) / count
        centres = np.array([path.at(arc)[:2] for arc in arcs.tolist()])
        apart = np.hypot(*(centres[:, None] - centres[None]).transpose(2, 0, 1))
        nearest = float(apart[~np.eye(count, dtype=bool)].min())
        return cls(path, centres, nearest / 2)

    def __len__(self) -> int:
        """Number of fields."""
        return len(self.centres)

    def mass(self, points: Reals, weights: Floats) -> Floats:
        """P(x in the field) of weighted poses (n, ≥ 2), for each field, (k,)."""
        x, y = np.asarray(points[:, :2], dtype=np.float64).T
        off_x, off_y = x - self.centres[:, :1], y - self.centres[:, 1:]
        inside = off_x * off_x + off_y * off_y < self.radius * self.radius
        mass: Floats = np.where(inside, weights, 0.0).sum(axis=1)
        return mass

    def past_centres(self, points: Reals) -> Floats:
        """How far each point (n, ≥ 2) is past each field's centre along the lap, px, (n, k).

        Negative before it, the shorter way round.
        """
        homes = self._arcs(self.centres)
        return np.array(
            [[self.path.advance(home, arc) for home in homes] for arc in self._arcs(points)]
        )

    def progress(self, points: Reals) -> Floats:
        """How far along the lap each of a row of points (n, ≥ 2) is past the first, px, (n,)."""
        arcs = self._arcs(points)
        steps = [self.path.advance(*pair) for pair in pairwise(arcs)]
        return np.cumsum([0.0, *steps])

    def _arcs(self, points: Reals) -> list[float]:
        return [self.path.arc((x, y)) for x, y in np.asarray(points)[:, :2].tolist()]
