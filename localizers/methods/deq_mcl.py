"""The paper's methods, from MCL to DEQ-MCL, and those that take the plan as evidence.

Taniguchi, Fukawa & Yamakawa 2024; each differs from the one before in few parts. Targets and
sources stand with the functions that make them, and in docs/equations.md.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from inspect import Parameter, Signature, signature
from typing import Annotated, Any, Generic, TypeVar

from deqmcl_gym.validation import InputError, integer, keep_plain, number, one_of, shown
from localizers.inference import Filter, FilterLocalizer
from localizers.inference.beam_filters import beam_filter
from localizers.inference.futures import Foresight, PlanEvidence
from localizers.inference.hedge import Hedge
from localizers.inference.loss_detector import LossDetector, Recovery
from localizers.inference.particle_filter import InformedStart, Injection, ParticleFilter
from localizers.inference.particles import SCHEMES, Resampling
from localizers.models import RobotModel
from localizers.models.feasibility import CostMap, PlanSensor
from localizers.models.prior import UniformPrior

ON_THE_MAP = ("inflation_radius", "cost_scaling_factor")  # what a step costs
FOR_THE_LOST = (
    "plan_beta",
    "start_draws",
    "start_jitter",
    "scan_keep",
    "recovery_alpha_slow",
    "recovery_alpha_fast",
)  # parameters of the methods that can find a lost robot
_KEEP = "least share of effective particles that a plan leaves, κ, 0 to 1; 0 is exact"
_CHARGE = "always, or new: each planned step once, when it comes into view"


def refuse_idle(name: str, value: object, needed: str) -> None:
    """Refuse a parameter that is given, not None, without what it is used with."""
    if value is not None:
        raise InputError(
            f"{name} is {shown(value)}, but it is used only with {needed}: give that, or leave "
            f"{name} out."
        )


@dataclass(frozen=True, kw_only=True)
class Shared:
    """Parameters of several methods; each method takes those it needs."""

    particles: Annotated[int, "number of particles, N, at least 1"] = 1000
    lag: Annotated[
        int, "L, past steps kept, planned steps read, at least 0; more: a longer view, fewer poses"
    ] = 20
    beta: Annotated[
        float | None,
        "a colliding step weighs exp(-β); 0 or more, inf rejects it; None: the robot's",
    ] = None
    inflation_radius: Annotated[
        float | None,
        "charge steps that end nearer to a wall than this, at least the robot's radius; None: none",
    ] = None
    cost_scaling_factor: Annotated[
        float | None, "how fast that charge falls, per length, 0 or more; None: Nav2's 10 / m"
    ] = None
    beam_filter: Annotated[str, "which beams are left out: none, distance or entropy"] = "none"
    resampler: Annotated[str, "systematic, stratified or multinomial"] = "systematic"
    ess_threshold: Annotated[
        float | None, "resample below this share of effective particles, 0 to 1; None: always"
    ] = None
    plan_beta: Annotated[
        float | None, "β of a colliding step of a plan as evidence, 0 or more; None: the robot's"
    ] = None
    # poses injected after a new route are chosen in the same way
    start_draws: Annotated[
        int, "draws per particle at the start, chosen by the plan, at least 1; 1 ignores the plan"
    ] = 1
    start_jitter: Annotated[
        float, "SD added to those chosen, in the map's unit, 0 or more; 0 is exact"
    ] = 0.0
    scan_keep: Annotated[
        float, "least share of effective particles that a scan leaves, 0 to 1; 0 is exact"
    ] = 0.0
    recovery_alpha_slow: Annotated[
        float, "slow rate of a scan's likelihood, for random poses, 0 to 1; with both 0 none"
    ] = 0.0
    recovery_alpha_fast: Annotated[float, "fast rate, from the slow one to 1"] = 0.0

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
        if self.start_draws == 1:
            refuse_idle("start_jitter", self.start_jitter or None, "start_draws of 2 or more")
        if self.inflation_radius is None:
            refuse_idle("cost_scaling_factor", self.cost_scaling_factor, "an inflation_radius")

    def feasibility(self, robot: RobotModel) -> CostMap:
        """What a step is charged."""
        return CostMap(
            floor_plan=robot.floor_plan,
            radius=robot.radius,
            inflation_radius=self.inflation_radius,
            cost_scaling_factor=self.cost_scaling_factor,
            beta=robot.beta if self.beta is None else self.beta,
        )

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
    """A method of the family: ``method(robot, **parameters)`` makes a localizer."""

    build: Callable[..., _F]  # ``build(robot, shared, **own)`` returns its filter
    takes: tuple[str, ...]  # which of the shared parameters it has

    def __call__(self, robot: RobotModel, **params: Any) -> FilterLocalizer[Any]:
        """Make a localizer for a robot."""
        others = {name: value for name, value in params.items() if name not in self.takes}
        shared = {name: value for name, value in params.items() if name in self.takes}
        return FilterLocalizer(robot, self.build(robot, Shared(**shared), **others))

    @property
    def __wrapped__(self) -> Callable[..., _F]:
        """What has the docstring; for ``inspect``."""
        return self.build

    @property
    def __signature__(self) -> Signature:
        """The robot, the accepted shared parameters, its own parameters; for ``inspect``."""
        robot, _, *others = signature(self.build).parameters.values()
        shared = [
            Parameter(
                field.name, Parameter.KEYWORD_ONLY, default=field.default, annotation=field.type
            )
            for field in fields(Shared)
            if field.name in self.takes
        ]
        return Signature([robot, *shared, *others])


def method(*takes: str) -> Callable[[Callable[..., _F]], FamilyMethod[_F]]:
    """Decorate a build function as a method that accepts these ``Shared`` parameters."""
    return lambda build: FamilyMethod(build, takes)


@method("particles", "resampler", "ess_threshold", "beam_filter")
def mcl(robot: RobotModel, shared: Shared) -> ParticleFilter:
    """Return MCL, p(x_t | a_{1:t}, o_{1:t}, m), whose map serves the sensor model only.

    Dellaert et al. 1999; Thrun et al. 2005, table 8.2.
    """
    scan, scheme = robot.scan_model(), SCHEMES[one_of("resampler", shared.resampler, SCHEMES)]
    return ParticleFilter(
        motion=robot.motion,
        scan=scan,
        resampling=Resampling(scheme, shared.ess_threshold),
        particles=shared.particles,
        beams=beam_filter(shared.beam_filter, robot),
        detector=LossDetector.of(scan, robot.floor_plan),
    )


@method(*mcl.takes, "beta", *ON_THE_MAP, *FOR_THE_LOST)
def mcl_map(robot: RobotModel, shared: Shared) -> ParticleFilter:
    """Return MCL whose steps are charged exp(-``beta``) if they collide: the paper's eq. (1).

    p(x_t | x_{t-1}, a_t, m) ≈ p(x_t | x_{t-1}, a_t) p(x_t | m); Thrun et al. 2005, section 5.5; Oh
    et al. 2004. With an ``inflation_radius`` also for where they end. It reads
    plans only to choose poses, with ``start_draws`` of 2 or more.
    """
    return replace(
        mcl.build(robot, shared),
        feasibility=shared.feasibility(robot),
        start=shared.start(robot),
        keep=shared.scan_keep,
        injection=shared.injection(robot),
    )


@method(*mcl.takes, "lag")
def mcl_smoother(robot: RobotModel, shared: Shared) -> ParticleFilter:
    """Return MCL with a fixed-lag smoother, p(x_{t-L:t} | a_{1:t}, o_{1:t}, m), L = ``lag``.

    Kitagawa 1996: past states are resampled with the present. At x_t it is MCL, number for number.
    """
    return replace(mcl.build(robot, shared), past=shared.lag)


@method(*mcl.takes, "beta", *ON_THE_MAP, "lag")
def mcl_map_smoother(robot: RobotModel, shared: Shared) -> ParticleFilter:
    """Return map-based MCL with a smoother: DEQ-MCL without its future, the ablation."""
    return replace(mcl_map.build(robot, shared), past=shared.lag)


@method(*mcl_map_smoother.takes)
def deq_mcl(
    robot: RobotModel,
    shared: Shared,
    *,
    pilots: Annotated[int, "futures drawn per particle for a new plan, at least 1"] = 16,
) -> ParticleFilter:
    """Return DEQ-MCL, Q(t) = p(x_{t-L:t+L} | a_{1:t}, â_{t+1:T}, o_{1:t}, m), L = ``lag``.

    Taniguchi, Fukawa & Yamakawa 2024, eqs. (2)-(3): the planned future is drawn ahead, charged for
    collisions, and resampled together with the present. x_t is drawn L steps before its scan, and
    of these draws few survive a sharp sensor (docs/plan-sensor.md).
    """
    base = mcl_map_smoother.build(robot, shared)
    return replace(base, future=shared.lag, pilots=integer("pilots", pilots, low=1))


@method(*mcl_map_smoother.takes, *FOR_THE_LOST)
def mcl_plan(
    robot: RobotModel,
    shared: Shared,
    *,
    keep: Annotated[float, _KEEP] = 0.8,
    charge: Annotated[str, _CHARGE] = "always",
) -> ParticleFilter:
    """Return map-based MCL, p(x_t | a_{1:t}, o_{1:t}, π_{0:t}, m), of plans by their first L steps.

    Ours. p(π_t | x_t, m) ∝ exp(-β C), where C planned steps collide without noise, as nobody plans
    through walls. A plan made from the filter's own estimate merely confirms it; a stale one
    misleads.
    """
    new_only = one_of("charge", charge, ("always", "new")) == "new"
    sensor = shared.sensor(robot)
    evidence = PlanEvidence(sensor=sensor, steps=shared.lag, keep=keep, new_only=new_only)
    return replace(mcl_map_smoother.build(robot, shared), lookahead=evidence)


@method(*mcl_plan.takes)
def deq_mcl_fresh(
    robot: RobotModel,
    shared: Shared,
    *,
    evidence: Annotated[str, "future, or plan: the plan is evidence as in mcl-plan"] = "future",
    pilots: Annotated[int, "futures drawn per particle after each scan, at least 1"] = 8,
    keep: Annotated[float | None, _KEEP, "None: 0.8"] = None,
    charge: Annotated[str | None, _CHARGE, "None: new"] = None,
) -> ParticleFilter:
    """Return DEQ-MCL whose future is drawn anew from the present after each scan.

    The target is Q(t): p(x_t) ∝ α_t(x_t) h_t(x_t), α_t of the scans and steps so far, h_t(x) =
    E[Π g of the next L planned steps | x_t = x] from ``pilots`` roll-outs (Lin, Chen & Liu 2013).
    With ``evidence`` = "plan" the plan is evidence as ``mcl_plan`` reads it, and
    p(x_{t+1:t+L} | x_t, plan, m) changes no weight.
    """
    integer("pilots", pilots, low=1)
    if one_of("evidence", evidence, ("future", "plan")) == "plan":
        keep, charge = 0.8 if keep is None else keep, "new" if charge is None else charge
        base = mcl_plan.build(robot, shared, keep=keep, charge=charge)
    else:
        refuse_idle("keep", keep, "evidence = 'plan'")
        refuse_idle("charge", charge, "evidence = 'plan'")
        base = mcl_map_smoother.build(robot, shared)
    ahead = Foresight(
        rollout=base.rollout,
        steps=shared.lag,
        copies=pilots,
        weighs=evidence == "future",
        evidence=base.lookahead,
    )
    return replace(base, lookahead=ahead)


# without beam_filter: the two would be judged by different beams
@method(*(name for name in mcl_plan.takes if name != "beam_filter"))
def mcl_plan_hedged(
    robot: RobotModel,
    shared: Shared,
    *,
    switching: Annotated[
        float, "probability per step that plans become right or wrong, 0 to 0.5"
    ] = 0.001,
    trust: Annotated[float, "probability at the start that plans are right, 0 to 1"] = 0.5,
    mutual: Annotated[
        bool, "whether the half without plans takes over from the other, too"
    ] = False,
    plans: Annotated[
        str, "all: each is evidence; first: they only choose poses at the start"
    ] = "all",
    own_plans: Annotated[bool, "whether plans made from this very estimate are shown to it"] = True,
) -> Hedge:
    """Return a ``Hedge`` of ``mcl_plan``, exact, and ``mcl_map``, each with half of the particles.

    ``start_draws`` are for the half that is shown plans.
    """
    integer("particles", shared.particles, low=2)
    advised = replace(shared, particles=shared.particles // 2)
    protected = replace(
        shared, particles=shared.particles - advised.particles, start_draws=1, start_jitter=0.0
    )
    if one_of("plans", plans, ("all", "first")) == "all":
        shown = mcl_plan.build(robot, advised, keep=0.0)
    elif shared.start_draws > 1:
        shown = mcl_map_smoother.build(robot, advised)
    else:
        raise InputError(
            "plans is 'first' and start_draws 1, but so no plan is used: give start_draws of 2 or "
            "more, or plans = 'all'."
        )
    return Hedge(
        advised=shown,
        protected=mcl_map_smoother.build(robot, protected),
        switching=switching,
        trust=trust,
        mutual=mutual,
        own_plans=own_plans,
    )
