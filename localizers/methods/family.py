"""What the particle filters of the family share: their parameters, and how one is made by name."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from inspect import Parameter, Signature, signature
from typing import Any

from deqmcl_gym.validation import integer, number
from localizers.api import RobotModel
from localizers.inference.belief import ParticleBelief
from localizers.inference.localizer import FilterLocalizer
from localizers.inference.particle_filter import ParticleFilter
from localizers.inference.parts import Resampling
from localizers.inference.resampling import resampling


@dataclass(frozen=True, kw_only=True)
class Shared:
    """Parameters that several methods take, each those that it has a use for.

    Attributes:
        particles: N.
        lag: L, steps of the past that are smoothed, and of the plan that are looked ahead.
        beta: β ≥ 0; a step that collides is charged exp(-β), inf rejects it outright.
        resampler: "systematic", "stratified" or "multinomial".
        ess_threshold: resample only when the effective sample size is below this share of N;
            None resamples at every step, as the paper does.
    """

    particles: int = 1000
    lag: int = 20
    beta: float = 10.0
    resampler: str = "systematic"
    ess_threshold: float | None = None

    def __post_init__(self) -> None:
        integer("particles", self.particles, low=1)
        integer("lag", self.lag)
        number("beta", self.beta, low=0, finite=False)

    @property
    def resampling(self) -> Resampling:
        """When to resample, and how."""
        return resampling(self.resampler, self.ess_threshold)


Build = Callable[..., ParticleFilter]


@dataclass(frozen=True)
class Method:
    """A method of the family: ``method(robot, **parameters)`` makes a localizer.

    Attributes:
        build: ``build(robot, shared, **own)`` puts its filter together.
        takes: names of the shared parameters that it takes.
    """

    build: Build
    takes: tuple[str, ...]

    def __call__(self, robot: RobotModel, **params: Any) -> FilterLocalizer[ParticleBelief]:
        """Make a localizer for a robot."""
        own = {name: value for name, value in params.items() if name not in self.takes}
        shared = {name: value for name, value in params.items() if name in self.takes}
        return FilterLocalizer(robot, self.build(robot, Shared(**shared), **own))

    @property
    def __signature__(self) -> Signature:
        """The robot, the shared parameters that it takes, its own; for ``inspect``."""
        robot, _, *own = signature(self.build).parameters.values()
        shared = [
            Parameter(field.name, Parameter.KEYWORD_ONLY, default=field.default)
            for field in fields(Shared)
            if field.name in self.takes
        ]
        return Signature([robot, *shared, *own])


def method(*takes: str) -> Callable[[Build], Method]:
    """Make a function a method that takes these of the ``Shared`` parameters beside its own."""
    return lambda build: Method(build, takes)
