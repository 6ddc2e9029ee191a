"""p(x_t | a_{1:t}, o_{1:t}, m): adaptive Monte-Carlo localization, as in the ROS navigation stack.

Thrun et al. 2005, table 8.4 (KLD-sampling, Fox 2003) and table 8.3 (random particles). Parameters
have the names and, where they carry over, the defaults of Nav2's ``amcl``; see docs/equations.md.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.maps import GridMap, Lidar, Map
from deqmcl_gym.maps.units import pixel
from deqmcl_gym.numerics.types import Bools
from deqmcl_gym.validation import InputError, boolean, integer, number, one_of
from localizers.api import Prior, RobotModel, checked_plan, checked_rng, checked_step, require_reset
from localizers.inference import adaptive_kernels
from localizers.inference.adaptive import KldSampling, Recovery
from localizers.inference.belief import Events, ParticleBelief
from localizers.inference.particle_filter import MAX_PARTICLES
from localizers.inference.parts import States
from localizers.inference.queue import Queue
from localizers.inference.trust import Trust
from localizers.models.beams import BeamModel
from localizers.models.free_space import random_poses
from localizers.models.likelihood_field import LikelihoodField
from localizers.models.scan import LidarScan

LASER_MODELS = ("likelihood_field", "beam", "robot")
_NO_ACTIONS = np.empty((0, 2))


@dataclass(frozen=True, kw_only=True)
class ResamplingTime:
    """When to resample: every ``interval`` updates; if ``selective``, only if ESS < N / 2."""

    interval: int = 1
    selective: bool = False

    def __post_init__(self) -> None:
        integer("resample_interval", self.interval, low=1)
        boolean("selective_resampling", self.selective)

    def has_come(self, updates: int, belief: ParticleBelief) -> bool:
        """Whether to resample after so many updates, one or more."""
        if updates % self.interval:
            return False
        return not self.selective or belief.effective_sample_size < belief.log_weights.size / 2


@dataclass(frozen=True)
class _Running:
    belief: ParticleBelief
    recovery: Recovery
    updates: int
    rng: np.random.Generator


class AdaptiveLocalizer:
    """A ``Localizer`` that draws as many particles as the spread of its belief requires."""

    def __init__(
        self,
        robot: RobotModel,
        *,
        scan: LidarScan | LikelihoodField,
        kld: KldSampling,
        recovery: Recovery,
        resampling: ResamplingTime,
        max_beams: int,
    ) -> None:
        """Make a localizer for ``robot`` from its parts; of a scan it uses ``max_beams``."""
        self.robot = robot
        self._scan, self._kld, self._recovery = scan, kld, recovery
        self._resampling = resampling
        self._trust = Trust.of(scan, robot.floor_plan)
        self._unused = _unused_beams(robot.lidar, max_beams)
        self._running: _Running | None = None

    def reset(self, prior: Prior, plan: ArrayLike, rng: np.random.Generator) -> ParticleBelief:
        """Start a new run with the largest cloud; see ``Localizer.reset``. The plan is not used."""
        checked_plan(plan)
        started = checked_rng(rng).spawn(1)[0]
        cloud = np.ascontiguousarray(prior.sample(self._kld.most, started).T, np.float32)
        belief = _cloud(cloud, Events(), self._trust)
        self._running = _Running(belief, self._recovery, 0, rng)
        return belief

    def update(self, ranges: ArrayLike, action: ArrayLike, plan: ArrayLike) -> ParticleBelief:
        """Advance one step; see ``Localizer.update``."""
        now = require_reset(self._running)
        scan, command, _, usable = checked_step(ranges, action, plan, self.robot.lidar)
        used = np.where(self._unused, np.nan, scan)
        belief = self._resampled(now)
        moved = self.robot.motion.sample(belief.present, command, now.rng)
        belief = belief._replace(queue=Queue((moved,)))
        after = belief.scanned(used, self._scan.log_likelihood(moved, used), most=moved.shape[1])
        after = after._replace(events=after.events.of_scan(scan.size, usable))
        beams = int(np.count_nonzero(self._scan.informative(used)))
        recovery = now.recovery.after(after.scan_log_evidence, beams)
        self._running = _Running(after, recovery, now.updates + 1, now.rng)
        return after

    def _resampled(self, now: _Running) -> ParticleBelief:
        """Draw independently, by weight or at random poses, until KLD-sampling is satisfied."""
        belief = now.belief
        if now.updates == 0 or not self._resampling.has_come(now.updates, belief):
            return belief
        cumulative = np.cumsum(belief.weights)
        pointers = now.rng.random(self._kld.most) * cumulative[-1]
        anywhere = now.rng.random(self._kld.most) < now.recovery.share
        chosen = np.empty(pointers.size, np.intp)
        adaptive_kernels.drawn(cumulative, pointers, chosen)
        drawn = belief.present.take(chosen, axis=1)
        if count := int(np.count_nonzero(anywhere)):
            drawn[:, anywhere] = random_poses(self.robot.floor_plan, count, now.rng)
        enough = self._kld.enough(drawn)
        events = belief.events
        if count:
            events = events.plus(random_poses=int(np.count_nonzero(anywhere[:enough])))
        return _cloud(np.ascontiguousarray(drawn[:, :enough]), events, belief.trust)


def amcl(
    robot: RobotModel,
    *,
    max_particles: int = 2000,
    min_particles: int = 500,
    pf_err: float = 0.05,
    pf_z: float = 0.99,
    recovery_alpha_slow: float = 0.0,
    recovery_alpha_fast: float = 0.0,
    resample_interval: int = 1,
    selective_resampling: bool = False,
    laser_model_type: str = "likelihood_field",
    max_beams: int = 60,
    z_hit: float = 0.5,
    z_short: float = 0.05,
    z_max: float = 0.05,
    z_rand: float = 0.5,
    sigma_hit: float | None = None,
    lambda_short: float | None = None,
    laser_likelihood_max_dist: float | None = None,
    field_cell: float | None = None,
) -> AdaptiveLocalizer:
    """Return adaptive Monte-Carlo localization.

    Args:
        robot: its motion model is used as it is.
        max_particles, min_particles: bounds of N.
        pf_err, pf_z: ε and z of KLD-sampling, with bins of 20 px x 20 px x 10° (0.4 m x 0.4 m x
            10° on a map in metres).
        recovery_alpha_slow, recovery_alpha_fast: 0 and 0 never draw random poses; Nav2 recommends
            0.001 and 0.1.
        resample_interval: updates between two resamplings.
        selective_resampling: resample only if the effective sample size is below N / 2.
        laser_model_type: "likelihood_field", "beam", or "robot": the robot's own scan model.
        max_beams: beams used of a scan, evenly spread.
        z_hit, z_short, z_max, z_rand: weights of the parts of a beam, relative to their sum. The
            likelihood field has z_hit and z_rand only.
        sigma_hit: in the map's unit; None: the sigma of the robot's scan model.
        lambda_short: per unit of length; None: 1 / max_range.
        laser_likelihood_max_dist: in the map's unit; None: 10 sigma_hit.
        field_cell: edge of a cell of the distance table, in the map's unit; None: the map's own
            cell, or 1 px (0.02 m) if it has none.
    """
    integer("max_particles", max_particles, low=1, high=MAX_PARTICLES)
    one_of("laser_model_type", laser_model_type, LASER_MODELS)
    weights = {"z_hit": z_hit, "z_short": z_short, "z_max": z_max, "z_rand": z_rand}
    for name, weight in weights.items():
        number(name, weight, low=0)
    if z_hit + z_rand <= 0:
        raise InputError(f"z_hit is {z_hit:g} and z_rand is {z_rand:g}: one must be above 0.")
    plan, lidar = robot.floor_plan, robot.lidar
    px, power = pixel(plan.unit), getattr(robot.scan, "power", 1.0)
    scan: LidarScan | LikelihoodField
    if laser_model_type == "robot":
        scan = LidarScan(floor_plan=plan, lidar=lidar, beam=robot.scan)
    elif laser_model_type == "beam":
        total = sum(weights.values())
        hit, short, largest, rand = (weight / total for weight in weights.values())
        decay = 1 / lidar.max_range if lambda_short is None else lambda_short
        beam = BeamModel(
            hit=hit,
            short=short,
            max=largest,
            rand=rand,
            sigma=_sigma(robot, sigma_hit),
            decay=number("lambda_short", decay, low=0, above=True),
            power=power,
        )
        scan = LidarScan(floor_plan=plan, lidar=lidar, beam=beam)
    else:
        sigma = _sigma(robot, sigma_hit)
        scan = LikelihoodField(
            floor_plan=plan,
            lidar=lidar,
            sigma=sigma,
            hit=z_hit / (z_hit + z_rand),
            farthest=10 * sigma if laser_likelihood_max_dist is None else laser_likelihood_max_dist,
            cell=_field_cell(plan) if field_cell is None else field_cell,
            power=power,
        )
    return AdaptiveLocalizer(
        robot,
        scan=scan,
        kld=KldSampling(
            least=min_particles,
            most=max_particles,
            error=pf_err,
            quantile=pf_z,
            bin_size=(20 * px, 20 * px, math.pi / 18),
        ),
        recovery=Recovery(alpha_slow=recovery_alpha_slow, alpha_fast=recovery_alpha_fast),
        resampling=ResamplingTime(interval=resample_interval, selective=selective_resampling),
        max_beams=integer("max_beams", max_beams, low=1),
    )


def _sigma(robot: RobotModel, sigma_hit: float | None) -> float:
    given = getattr(robot.scan, "sigma", None) if sigma_hit is None else sigma_hit
    if given is None:
        raise InputError(
            f"sigma_hit is None, but the scan model {robot.scan!r} has no sigma: give sigma_hit."
        )
    return number("sigma_hit", given, low=0, above=True)


def _field_cell(floor_plan: Map) -> float:
    return floor_plan.resolution if isinstance(floor_plan, GridMap) else pixel(floor_plan.unit)


def _unused_beams(lidar: Lidar, most: int) -> Bools:
    unused = np.ones(lidar.beams, np.bool_)
    unused[np.rint(np.linspace(0, lidar.beams - 1, min(most, lidar.beams))).astype(np.intp)] = False
    return unused


def _cloud(states: States, events: Events, trust: Trust | None) -> ParticleBelief:
    """Equally weighted particles (3, n), with the events and the trust since reset."""
    even = np.zeros(states.shape[1])
    return ParticleBelief(Queue((states,)), even, _NO_ACTIONS, events=events, trust=trust)
