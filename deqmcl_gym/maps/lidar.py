"""The geometry of a lidar: a forward fan of beams."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.maps.kernels import mounted
from deqmcl_gym.maps.units import LENGTH
from deqmcl_gym.numerics.elementary import cos64, sin64
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import array, integer, keep_plain, number

CENTRE = (0.0, 0.0)


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
        mounting: place on the robot from which the rays start, x ahead and y left of its centre.
    """

    beams: int = 1
    field_of_view: float = math.pi / 2
    max_range: float = field(default=400.0, metadata=LENGTH)
    sigma: float = field(default=100.0, metadata=LENGTH)
    mounting: tuple[float, float] = field(default=CENTRE, metadata=LENGTH)

    def __post_init__(self) -> None:
        integer("lidar.beams", self.beams, low=1, high=100_000)
        number("lidar.field_of_view", self.field_of_view, low=0, high=2 * math.pi, above=True)
        number("lidar.max_range", self.max_range, low=0, above=True)
        number("lidar.sigma", self.sigma, low=0)
        ahead, aside = array("lidar.mounting", self.mounting, (2,)).tolist()
        object.__setattr__(self, "mounting", (ahead, aside))
        keep_plain(self)

    @property
    def bearings(self) -> Floats:
        """Angles of the beams against the heading, counterclockwise, (beams,) rad, ascending."""
        if self.beams == 1:
            return np.zeros(1)
        half = self.field_of_view / 2
        full_circle = self.field_of_view > 2 * math.pi - 1e-9
        return np.linspace(-half, half, self.beams, endpoint=not full_circle)

    def origins(self, poses: NDArray[Any]) -> NDArray[Any]:
        """Return the poses that the rays of robots at ``poses`` (3, n) start from, (3, n) float32.

        Rows x, y, θ; the poses themselves if the lidar is in the robot's centre.
        """
        if self.mounting == CENTRE:
            return poses
        out = np.empty(poses.shape, np.float32)
        mounted(np.ascontiguousarray(poses, np.float32), *self.mounting, out)
        return out

    def origin(self, pose: ArrayLike) -> Floats:
        """Return the pose that the rays of a robot at ``pose`` (x, y, θ) start from, (3,)."""
        x, y, heading = np.asarray(pose, dtype=np.float64).tolist()
        ahead, aside = self.mounting
        cosine, sine = cos64(heading), sin64(heading)
        at = (x + (ahead * cosine - aside * sine), y + (ahead * sine + aside * cosine), heading)
        return np.array(at)
