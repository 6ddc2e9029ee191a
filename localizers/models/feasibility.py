"""How feasible a step is on the map, and a plan from a pose: nobody plans through walls.

g(x', x) = exp(-β C(x', x)) is the paper's p(x_t | m), "based on the configuration space (C-space)
or cost map": see ``CostMap``. p(π_t | x_t, m) is its product over the steps of a plan.
"""

from dataclasses import dataclass

import numpy as np

from deqmcl_gym.maps import Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Floats, Ints, Singles, arrays
from deqmcl_gym.validation import number
from localizers.models.motion import increments


@dataclass(frozen=True, kw_only=True)
class PlanSensor:
    """Log p(π_t | x_t, m) = -β C(x_t, π_t), up to a constant; C planned steps collide.

    C = Σ_k C(y_{k-1}, y_k), y_0 = x_t and y_k = y_{k-1} moved by the k-th planned action without
    noise, as its author corrects for that on the way. Only collisions count, also beside a
    ``CostMap``: nobody plans through walls, but how far from them authors keep is not known. β ≥ 0;
    inf rules out poses from which a planned step collides.
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
        """How many planned steps, (h, 2 or 3), collide from each pose, (n,), from ``first`` on."""
        poses, path = np.ascontiguousarray(states, np.float32), plan_path(plan)[first:]
        if len(path) < 2:
            return np.zeros(poses.shape[1], np.int32)
        return self.floor_plan.collisions_along(poses, path, self.radius)


def charges(beta: float, collisions: Ints) -> Floats:
    """Return -β C of each C, (n,); 0 where C is 0, even if β is infinite."""
    charge = np.zeros(collisions.size)
    return np.multiply(collisions, -beta, out=charge, where=collisions > 0)


def plan_path(plan: Floats) -> Singles:
    """Where actions (h, 2 or 3) lead without noise, seen from where they start, (h + 1, 2)."""
    forward, left, turn = increments(plan).T
    headings = np.cumsum(turn)
    cosine, sine = arrays.cos(headings), arrays.sin(headings)
    path = np.zeros((len(plan) + 1, 2), np.float32)
    path[1:, 0] = np.cumsum(forward * cosine - left * sine)
    path[1:, 1] = np.cumsum(forward * sine + left * cosine)
    return path


@dataclass(frozen=True, kw_only=True)
class CostMap:
    """Log g = -β cost: 1 if the disc, swept from x' to x, touches a wall or leaves free space.

    So it is the map-based motion model of the paper's eq. (1) with p(x_t | m) = exp(-β C), C in
    {0, 1} per step; Thrun et al. 2005, section 5.5. With an ``inflation_radius`` other steps have
    the cost at x, which is larger the nearer to a wall it is (nav2_costmap_2d, inflation_layer):
    exp(-cost_scaling_factor (d - radius)) up to d = inflation_radius from a wall, 0 beyond, d the
    exact distance of the robot's centre; Nav2 takes that of cells. A step is charged for where it
    ends, not for its way: a way is charged by the states along it, each once. β ≥ 0; 0 charges
    nothing, at inf every step that costs anything is rejected.
    """

    floor_plan: Map
    radius: float  # of the robot's disc, Nav2's inscribed radius
    inflation_radius: float | None = None  # at least ``radius``; None: only a collision costs
    #: per unit of length; None is Nav2's 10 / m, 0.2 / px
    cost_scaling_factor: float | None = None
    beta: float = 10.0

    def __post_init__(self) -> None:
        number("beta", self.beta, low=0, finite=False)
        if self.inflation_radius is not None:
            what = "inflation_radius (from a wall to the robot's centre)"
            number(what, self.inflation_radius, low=self.radius)
        if self.cost_scaling_factor is not None:
            number("cost_scaling_factor", self.cost_scaling_factor, low=0)

    def log_g(self, before: Singles, after: Singles) -> Floats:
        """-β cost of each step, (n,)."""
        collides = self.floor_plan.collides(before.T, after.T, self.radius)
        if self.inflation_radius is None:
            return np.where(collides, -self.beta, 0.0)
        usual, told = 10.0 / metre(self.floor_plan.unit), self.cost_scaling_factor
        distance = self.floor_plan.distance(after[:2].T).astype(np.float64)
        beyond = np.maximum(distance - self.radius, 0.0)
        near = (distance > self.radius) & (distance <= self.inflation_radius)
        cost = np.where(near, arrays.exp(-(usual if told is None else told) * beyond), 0.0)
        cost[collides] = 1.0
        charge = np.zeros(cost.size)
        return np.multiply(cost, -self.beta, out=charge, where=cost > 0.0)  # -inf · 0 is no charge
