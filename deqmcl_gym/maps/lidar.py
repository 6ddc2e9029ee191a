"""The geometry of a lidar: a forward fan of beams."""

import math
from dataclasses import dataclass, field

import numpy as np

from deqmcl_gym.maps.units import LENGTH
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import integer, keep_plain, number


@dataclass(frozen=True, kw_only=True)
class Lidar:
    """A fan of range beams, centred on the robot's heading. Lengths are in the map's unit.

    The defaults are the paper preset's, in px.

    Attributes:
        beams: number of beams, 1 or more. One beam looks straight ahead.
        field_of_view: angle between the outermost beams, in (0, 2π] rad. At 2π the beams are
            spread evenly, with only one at the back.
        max_range: largest range reported.
        sigma: standard deviation of the range noise; added before clipping to [0, max_range].
    """

    beams: int = 1
    field_of_view: float = math.pi / 2
    max_range: float = field(default=400.0, metadata=LENGTH)
    sigma: float = field(default=100.0, metadata=LENGTH)

    def __post_init__(self) -> None:
        integer("lidar.beams", self.beams, low=1, high=100_000)
        number("lidar.field_of_view", self.field_of_view, low=0, high=2 * math.pi, above=True)
        number("lidar.max_range", self.max_range, low=0, above=True)
        number("lidar.sigma", self.sigma, low=0)
        keep_plain(self)

    @property
    def bearings(self) -> Floats:
        """Angles of the beams against the heading, counterclockwise, (beams,) rad, ascending."""
        if self.beams == 1:
            return np.zeros(1)
        half = self.field_of_view / 2
        full_circle = self.field_of_view > 2 * math.pi - 1e-9
        return np.linspace(-half, half, self.beams, endpoint=not full_circle)
