"""g(x', x) = exp(-β C(x', x)), the paper's p(x_t | m): whether a step is feasible on the map."""

from dataclasses import dataclass
from typing import final

import numpy as np

from deqmcl_gym.maps import Map, RollOuts
from deqmcl_gym.numerics.types import Floats, Singles
from deqmcl_gym.validation import number
from localizers.models.drives import ChargedDrives
from localizers.models.motion import OdometryMotion


@final
@dataclass(frozen=True, kw_only=True)
class FreeSpace:
    """g = exp(-β) if the robot's disc, swept from x' to x, touches a wall or leaves free space.

    The map-based motion model of the paper's eq. (1) with p(x_t | m) = exp(-β C), C in {0, 1} per
    step. Thrun et al. 2005, section 5.5.

    Attributes:
        floor_plan: the map m.
        radius: of the robot's disc, in the map's unit.
        beta: β ≥ 0; 0 charges nothing, inf rejects the step outright.
    """

    floor_plan: Map
    radius: float
    beta: float = 10.0

    def __post_init__(self) -> None:
        number("beta", self.beta, low=0, finite=False)

    def log_g(self, before: Singles, after: Singles) -> Floats:
        """-β for each step that collides, else 0, (n,)."""
        collides = self.floor_plan.collides(before.T, after.T, self.radius)
        return np.where(collides, -self.beta, 0.0)

    def walk(self, motion: object) -> ChargedDrives | None:
        """Return whole roll-outs of an ``OdometryMotion`` in one pass; None for other motions."""
        if not isinstance(motion, OdometryMotion) or not isinstance(self.floor_plan, RollOuts):
            return None
        return ChargedDrives(
            motion=motion, floor_plan=self.floor_plan, radius=self.radius, beta=self.beta
        )
