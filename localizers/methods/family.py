"""What the particle filters of the family share: their parameters and how one is built."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from inspect import Parameter, Signature, signature
from typing import Any, Generic, TypeVar

from deqmcl_gym.validation import InputError, integer, keep_plain, number, one_of, shown
from localizers.inference.bayes_filter import Filter, FilterLocalizer
from localizers.inference.parts import Feasibility
from localizers.inference.plan_evidence import PlanEvidence
from localizers.inference.resampling import SCHEMES, Resampling
from localizers.inference.start import InformedStart, Injection, Recovery
from localizers.models.cost_map import CostImage, CostMap, Inflation
from localizers.models.plan_sensor import FreeSpace, PlanSensor
from localizers.models.prior import UniformPrior
from localizers.models.robot import RobotModel

ON_THE_MAP = ("inflation_radius", "cost_scaling_factor", "cost_map")  # what a step costs
FOR_THE_LOST = (
    "plan_beta",
    "start_draws",
    "start_jitter",
    "scan_keep",
    "recovery_alpha_slow",
    "recovery_alpha_fast",
)  # parameters of the methods that can find a lost robot


@dataclass(frozen=True, kw_only=True)
class Shared:
    """Parameters of several methods; each method takes those it needs.

    Attributes:
        particles: N.
        lag: L, how many past steps are smoothed, and how many planned steps are read.
        beta: β ≥ 0; a step that collides is charged exp(-β), inf rejects it outright; None: the
            robot's.
        inflation_radius: distance from a wall, in the map's unit, below which a step is charged for
            where it ends, see ``Inflation``; None: only steps that collide are charged.
        cost_scaling_factor: how fast that cost falls, per unit of length; None is Nav2's 10 / m.
        cost_map: instead of these, a file with the cost of each cell, see ``CostImage.load``.
        beam_filter: which beams of a scan are used: "none", of the filters, all of them;
            "distance", see ``DistanceFilter``; "entropy", see ``EntropyFilter``.
        resampler: "systematic", "stratified" or "multinomial".
        ess_threshold: resample only when the effective sample size is below this share of N;
            None resamples at every step, as the paper does.
        plan_beta: β ≥ 0 per colliding step of a plan that is used as evidence; None: the robot's.
        start_draws: K, draws from the prior per particle, chosen by how feasible the plan shown at
            reset is from them; 1 ignores the plan. Poses injected after a new route are chosen in
            the same way.
        start_jitter: standard deviation added to the chosen draws, in the map's unit; 0 is exact
            importance sampling.
        scan_keep: κ, the least share of the effective sample size that a scan leaves; 0 is exact.
        recovery_alpha_slow, recovery_alpha_fast: rates of ``Recovery``, which injects random poses;
            0 and 0 inject none.
    """

    particles: int = 1000
    lag: int = 20
    beta: float | None = None
    inflation_radius: float | None = None
    cost_scaling_factor: float | None = None
    cost_map: str | None = None
    beam_filter: str = "none"
    resampler: str = "systematic"
    ess_threshold: float | None = None
    plan_beta: float | None = None
    start_draws: int = 1
    start_jitter: float = 0.0
    scan_keep: float = 0.0
    recovery_alpha_slow: float = 0.0
    recovery_alpha_fast: float = 0.0

    def __post_init__(self) -> None:
        integer("particles", self.particles, low=1)
        integer("lag", self.lag)
        for name in ("beta", "plan_beta"):
            if (beta := getattr(self, name)) is not None:
                number(name, beta, low=0, finite=False)
        integer("start_draws", self.start_draws, low=1)
        number("start_jitter", self.start_jitter, low=0)
        number("scan_keep", self.scan_keep, low=0, high=1)
        keep_plain(self)
        if self.start_jitter > 0 and self.start_draws == 1:
            raise InputError(
                f"start_jitter is {self.start_jitter:g}, but it is used only if start_draws is "
                "2 or more: give start_draws, or leave start_jitter out."
            )
        if self.cost_scaling_factor is not None and self.inflation_radius is None:
            raise InputError(
                f"cost_scaling_factor is {shown(self.cost_scaling_factor)}, but it is used only "
                "with an inflation_radius: give one, or leave cost_scaling_factor out."
            )
        if self.cost_map is not None and self.inflation_radius is not None:
            raise InputError(
                "cost_map and inflation_radius are both given, but each says what a step costs: "
                "give one of them."
            )

    @property
    def resampling(self) -> Resampling:
        """When to resample, and how."""
        scheme = SCHEMES[one_of("resampler", self.resampler, SCHEMES)]
        return Resampling(scheme, self.ess_threshold)

    def feasibility(self, robot: RobotModel) -> Feasibility:
        """What a step is charged."""
        floor_plan, radius = robot.floor_plan, robot.radius
        beta = robot.beta if self.beta is None else self.beta
        cost: CostImage | Inflation
        if self.cost_map is not None:
            cost = CostImage.load(self.cost_map, floor_plan, radius)
        elif self.inflation_radius is not None:
            cost = Inflation(
                floor_plan=floor_plan,
                radius=radius,
                inflation_radius=self.inflation_radius,
                cost_scaling_factor=self.cost_scaling_factor,
            )
        else:
            return FreeSpace(floor_plan=floor_plan, radius=radius, beta=beta)
        return CostMap(floor_plan=floor_plan, radius=radius, cost=cost, beta=beta)

    def sensor(self, robot: RobotModel) -> PlanSensor:
        """The sensor model of plans."""
        beta = robot.beta if self.plan_beta is None else self.plan_beta
        return PlanSensor(floor_plan=robot.floor_plan, radius=robot.radius, beta=beta)

    def start(self, robot: RobotModel) -> InformedStart | None:
        """How the first particles are chosen."""
        if self.start_draws == 1:
            return None
        evidence = PlanEvidence(sensor=self.sensor(robot))
        return InformedStart(evidence=evidence, draws=self.start_draws, jitter=self.start_jitter)

    def injection(self, robot: RobotModel) -> Injection | None:
        """Which random poses are mixed in, and when."""
        recovery = Recovery(
            alpha_slow=self.recovery_alpha_slow, alpha_fast=self.recovery_alpha_fast
        )
        if recovery.alpha_fast == 0:
            return None
        poses = UniformPrior(floor_plan=robot.floor_plan, radius=robot.radius)
        return Injection(recovery=recovery, poses=poses, start=self.start(robot))


_F = TypeVar("_F", bound=Filter[Any])


@dataclass(frozen=True)
class FamilyMethod(Generic[_F]):
    """A method of the family: ``method(robot, **parameters)`` makes a localizer.

    Attributes:
        build: ``build(robot, shared, **own)`` returns its filter.
        takes: names of the shared parameters it accepts.
    """

    build: Callable[..., _F]
    takes: tuple[str, ...]

    def __call__(self, robot: RobotModel, **params: Any) -> FilterLocalizer[Any]:
        """Make a localizer for a robot."""
        own = {name: value for name, value in params.items() if name not in self.takes}
        shared = {name: value for name, value in params.items() if name in self.takes}
        return FilterLocalizer(robot, self.build(robot, Shared(**shared), **own))

    @property
    def __signature__(self) -> Signature:
        """The robot, the accepted shared parameters, its own parameters; for ``inspect``."""
        robot, _, *own = signature(self.build).parameters.values()
        shared = [
            Parameter(field.name, Parameter.KEYWORD_ONLY, default=field.default)
            for field in fields(Shared)
            if field.name in self.takes
        ]
        return Signature([robot, *shared, *own])


def method(*takes: str) -> Callable[[Callable[..., _F]], FamilyMethod[_F]]:
    """Decorate a build function as a method that accepts these ``Shared`` parameters."""
    return lambda build: FamilyMethod(build, takes)
