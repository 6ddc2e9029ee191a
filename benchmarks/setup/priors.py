"""The prior p(x_0) as a part of a scenario, before there is a room."""

from dataclasses import dataclass, field
from types import MappingProxyType

from benchmarks.setup.trial_env import TrialEnv
from deqmcl_gym.maps.map import LENGTH, POSE
from deqmcl_gym.validation import number, pose
from localizers import GaussianPrior, Prior, UniformPrior


@dataclass(frozen=True, kw_only=True)
class Gaussian:
    """x_0 ~ N(mean, diag(sd_position², sd_position², sd_heading²)).

    Attributes:
        mean: (x px, y px, θ rad); None is the planned start, which need not be the true one, and
            in a log its reference.
        sd_position: in x and in y, px.
        sd_heading: rad.
    """

    mean: tuple[float, float, float] | None = field(default=None, metadata=POSE)
    sd_position: float = field(default=10.0, metadata=LENGTH)
    sd_heading: float = 0.1

    def __post_init__(self) -> None:
        if self.mean is not None:
            object.__setattr__(self, "mean", pose("prior.mean", self.mean))
        number("prior.sd_position", self.sd_position, low=0)
        number("prior.sd_heading", self.sd_heading, low=0)

    def of(self, room: TrialEnv) -> Prior:
        """Return p(x_0) in the episode that a room has begun last."""
        mean = room.expected_start if self.mean is None else self.mean
        return GaussianPrior(mean=mean, sd_position=self.sd_position, sd_heading=self.sd_heading)


@dataclass(frozen=True, kw_only=True)
class Uniform:
    """x_0 is anywhere in free space, in any heading: global localization."""

    def of(self, room: TrialEnv) -> Prior:
        """Return p(x_0) in a room."""
        return UniformPrior(floor_plan=room.floor_plan, radius=room.radius)


PRIORS = MappingProxyType({"gaussian": Gaussian, "uniform": Uniform})
