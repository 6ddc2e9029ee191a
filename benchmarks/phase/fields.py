"""Place fields: discs along the lap."""

from dataclasses import dataclass

import numpy as np

from deqmcl_gym.numerics.types import Bools, Floats, Reals
from deqmcl_gym.world.course import Path


@dataclass(frozen=True)
class PlaceFields:
    """Discs of one radius that do not overlap.

    Attributes:
        path: the closed path that they lie on.
        centres: (K, 2).
        radius: of each.
        unit: of lengths.
    """

    path: Path
    centres: Floats
    radius: float
    unit: str = "px"

    @classmethod
    def along(cls, path: Path, count: int, start: float = 0.0, unit: str = "px") -> "PlaceFields":
        """Put ``count`` ≥ 2 fields at equal steps of arc length, the first half a step in.

        They are as large as they can be without overlap: the radius is half the distance of the
        two nearest centres.

        Args:
            path: closed.
            count: K.
            start: arc length from which the lap is driven.
            unit: of lengths.
        """
        arcs = start + path.length * (np.arange(count) + 0.5) / count
        centres = np.array([path.at(arc)[:2] for arc in arcs.tolist()])
        apart = np.hypot(*(centres[:, None] - centres[None]).transpose(2, 0, 1))
        nearest = float(apart[~np.eye(count, dtype=bool)].min())
        return cls(path, centres, nearest / 2, unit)

    def __len__(self) -> int:
        """Number of fields."""
        return len(self.centres)

    @property
    def decimals(self) -> int:
        """Of lengths in words."""
        return 1 if self.unit == "px" else 3

    def inside(self, points: Reals) -> Bools:
        """Whether each of n points (n, ≥ 2) is in each field, (K, n)."""
        x, y = np.asarray(points[:, :2], dtype=np.float64).T
        off_x, off_y = x - self.centres[:, :1], y - self.centres[:, 1:]
        inside: Bools = off_x * off_x + off_y * off_y < self.radius * self.radius
        return inside

    def arcs(self, points: Reals) -> list[float]:
        """Arc length on the path of each point (n, ≥ 2)."""
        return [self.path.arc((x, y)) for x, y in points[:, :2].tolist()]
