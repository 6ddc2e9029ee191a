"""How likely a plan is to be shown at a pose: nobody plans through walls.

g(x', x) = exp(-β C(x', x)) is the paper's p(x_t | m), whether a step is feasible on the map;
p(π_t | x_t, m) is its product over the steps of a plan.
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from deqmcl_gym.maps import Map
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos64, sin64
from deqmcl_gym.numerics.types import Floats, Ints, Singles
from deqmcl_gym.validation import number
from localizers.models.motion import ChargedDrives, OdometryMotion, increments


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
        if not isinstance(motion, OdometryMotion):
            return None
        return ChargedDrives(
            motion=motion, floor_plan=self.floor_plan, radius=self.radius, beta=self.beta
        )


@final
@dataclass(frozen=True, kw_only=True)
class PlanSensor:
    """Log p(π_t | x_t, m) = -β C(x_t, π_t), up to a constant; C planned steps collide.

    C = Σ_k C(y_{k-1}, y_k), y_0 = x_t and y_k = y_{k-1} moved by the k-th planned action without
    noise: the author corrects for noise on the way, so a plan is feasible as written. All
    poses follow one path, rotated and shifted; nothing is drawn. Only collisions count, also where
    steps are charged by a ``CostMap``: that nobody plans through walls holds of every author, how
    far from them he keeps does not, and L small costs would add up to a claim about him.

    Attributes:
        floor_plan: the map m.
        radius: of the robot's disc, in the map's unit.
        beta: β ≥ 0; inf rules out poses from which a planned step collides.
    """

    floor_plan: Map
    radius: float
    beta: float = 10.0

    def __post_init__(self) -> None:
        number("plan_beta", self.beta, low=0, finite=False)

    def log_likelihood(self, states: Singles, plan: Floats) -> Floats:
        """Log p(π | x, m) of a plan (h, 3) at poses (3, n), up to a constant: 0 if feasible."""
        return charges(self.beta, self.collisions(states, plan))

    def collisions(self, states: Singles, plan: Floats, first: int = 0) -> Ints:
        """How many planned steps collide from each pose.

        Args:
            states: rows x, y, θ, (3, n).
            plan: actions (distance, turn rad) or increments (forward, left, turn rad), (h, 2 or 3).
            first: index of the first step counted.

        Returns:
            C, (n,).
        """
        poses, path = np.ascontiguousarray(states, np.float32), plan_path(plan)[first:]
        if len(path) < 2:
            return np.zeros(poses.shape[1], np.int32)
        return self.floor_plan.collisions_along(poses, path, self.radius)


def charges(beta: float, collisions: Ints) -> Floats:
    """Return -β C of each C, (n,); 0 where C is 0, even if β is infinite."""
    found = np.empty(collisions.size)
    _charge(beta, collisions, found)
    return found


@compiled
def _charge(beta: float, collisions: Ints, out: Floats) -> None:
    for i in range(out.size):
        out[i] = -beta * collisions[i] if collisions[i] > 0 else 0.0


def plan_path(plan: Floats) -> Singles:
    """Where actions (h, 2 or 3) lead without noise, seen from where they start, (h + 1, 2)."""
    path = np.empty((len(plan) + 1, 2), np.float32)
    _drive_on(increments(plan), path)
    return path


@compiled
def _drive_on(moves: Floats, out: Singles) -> None:
    x, y, heading = 0.0, 0.0, 0.0
    out[0] = 0.0
    for k in range(len(moves)):
        forward, left = moves[k, 0], moves[k, 1]
        heading += moves[k, 2]
        cosine, sine = cos64(heading), sin64(heading)
        x += forward * cosine - left * sine
        y += forward * sine + left * cosine
        out[k + 1, 0], out[k + 1, 1] = x, y
