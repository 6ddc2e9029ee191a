"""p(x_0): where the robot may have been put down."""

from dataclasses import dataclass

import numpy as np

from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import number, pose


@dataclass(frozen=True, kw_only=True)
class GaussianPrior:
    """x_0 ~ N(mean, diag(sd_position², sd_position², sd_heading²)).

    Attributes:
        mean: (x px, y px, θ rad).
        sd_position: in x and in y, px.
        sd_heading: rad.
    """

    mean: tuple[float, float, float]
    sd_position: float = 10.0
    sd_heading: float = 0.1

    def __post_init__(self) -> None:
        object.__setattr__(self, "mean", pose("the prior's mean", self.mean))
        number("prior.sd_position", self.sd_position, low=0)
        number("prior.sd_heading", self.sd_heading, low=0)

    def sample(self, n: int, rng: np.random.Generator) -> Floats:
        """Draw n poses, (n, 3)."""
        return np.array(self.mean) + rng.standard_normal((n, 3)) * self._sd

    def log_density(self, poses: Floats) -> Floats:
        """Log p(x_0) of poses (n, 3), the heading difference wrapped to [-π, π], (n,)."""
        apart = np.asarray(poses, dtype=np.float64) - np.array(self.mean)
        apart[:, 2] -= 2 * np.pi * np.rint(apart[:, 2] / (2 * np.pi))
        with np.errstate(divide="ignore", invalid="ignore"):
            log_density: Floats = (
                -0.5 * np.square(apart / self._sd) - arrays.log(self._sd * np.sqrt(2 * np.pi))
            ).sum(axis=1)
        return log_density

    @property
    def _sd(self) -> Floats:
        return np.array([self.sd_position, self.sd_position, self.sd_heading])
