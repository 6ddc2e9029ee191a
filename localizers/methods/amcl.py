"""p(x_t | o_{1:t}, u_{1:t}, m): adaptive Monte-Carlo localization, as Nav2's ``nav2_amcl`` has it.

Thrun et al. 2005, table 8.4 (KLD-sampling, Fox 2003) and table 8.3 (random particles). Parameters
have Nav2's names, defaults and units; docs/classical.md lists what differs, with source files.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.maps.map import metre, scaled
from deqmcl_gym.numerics import Floats, arrays
from deqmcl_gym.validation import InputError, boolean, integer, number, one_of
from localizers.api import Motion, Prior
from localizers.inference import (
    checked_plan,
    checked_prior,
    checked_rng,
    checked_step,
    require_reset,
)
from localizers.inference.belief import ParticleBelief, Queue
from localizers.inference.loss_detector import Averages, LossDetector
from localizers.inference.particle_filter import MAX_PARTICLES
from localizers.inference.particles import BeamFilter, KldSampling
from localizers.models import RobotModel
from localizers.models.nav2_motion import DifferentialMotion, OmniMotion, composed_increment, moved
from localizers.models.nav2_scan import BeamCubes, BeamSkipping, LikelihoodField
from localizers.models.prior import random_poses
from localizers.models.scan import ScanModel

DIFFERENTIAL, OMNI = "nav2_amcl::DifferentialMotionModel", "nav2_amcl::OmniMotionModel"


def has_moved(since: Floats, heading: float, distance: float, angle: float) -> bool:
    """Whether an increment (3,) from an odometry's heading is more than either, in x or y, or θ."""
    forward, left, turn = since.tolist()
    at = [heading + turn]
    cosine, sine = float(arrays.cos(at)[0]), float(arrays.sin(at)[0])
    x, y = forward * cosine - left * sine, forward * sine + left * cosine
    return bool(max(abs(x), abs(y)) > distance or abs(turn) > angle)


def averages_after(averages: Averages, log_evidence: float, particles: int) -> Averages:
    """Return averages of the mean weight of a cloud's particles after a scan, not yet normalised.

    Each weighs 1 / n before the scan, so the mean falls as n grows. After random poses were drawn
    the averages start anew; the first scan sets both. Source: pf.c.
    """
    mean = float(arrays.exp([log_evidence])[0]) / particles
    if not 0.0 < mean < math.inf:
        return averages
    return averages.towards(mean, at_least=0.0 if averages.slow > 0 else 1.0)


@dataclass(frozen=True)
class _Running:
    """What is carried from step to step."""

    belief: ParticleBelief
    since: Floats  # the increment since the latest update, (3,)
    heading: float  # the odometry's at it, rad
    averages: Averages
    updates: int
    converged: bool  # whether the cloud was small when it was last resampled
    rng: np.random.Generator


@dataclass(kw_only=True)
class AdaptiveLocalizer:
    """A ``Localizer`` that draws as many particles as the spread of its belief requires.

    An update moves the cloud, weighs it by the scan and resamples it, in this order (amcl_node.cpp,
    laserReceived). A robot that has not moved enough gets none: its belief is the latest cloud
    moved along the odometry, without noise. The first scan is always used.
    """

    robot: RobotModel
    motion: Motion
    scan: ScanModel
    kld: KldSampling
    averages: Averages
    interval: int  # updates between two resamplings
    selective: bool  # whether to resample only if ESS ≤ N / 2
    distance: float  # in the map's unit; this or ``angle`` is exceeded before each update
    angle: float  # rad
    skipping: BeamFilter | None = None  # None: no beam is skipped

    def __post_init__(self) -> None:
        self._detector = LossDetector.of(self.scan, self.robot.floor_plan)
        self._running: _Running | None = None

    def reset(self, prior: Prior, plan: ArrayLike, rng: np.random.Generator) -> ParticleBelief:
        """Start a new run with the largest cloud; see ``Localizer.reset``. The plan is not used."""
        prior = checked_prior(prior, self.robot)
        ahead = checked_plan(plan)
        started = checked_rng(rng).spawn(1)[0]
        cloud = np.ascontiguousarray(prior.sample(self.kld.most, started).T, np.float32)
        even = np.zeros(cloud.shape[1])
        belief = ParticleBelief(Queue((cloud,)), even, ahead[:0], detector=self._detector)
        self._running = _Running(belief, np.zeros(3), 0.0, self.averages, 0, False, rng)
        return belief

    def update(self, ranges: ArrayLike, action: ArrayLike, plan: ArrayLike) -> ParticleBelief:
        now = require_reset(self._running)
        scan, command, _ = checked_step(ranges, action, plan, self.robot.lidar)
        since = composed_increment(now.since, command)
        belief = now.belief._replace(events=now.belief.events.of_scan(scan))
        if now.updates and not has_moved(since, now.heading, self.distance, self.angle):
            self._running = replace(now, belief=belief, since=since)
            return belief._replace(queue=Queue((moved(belief.present, since),)))
        cloud = self.motion.sample(belief.present, since, now.rng)
        used = scan
        if now.converged and self.skipping is not None:
            used = self.skipping.kept(cloud, belief.log_weights, scan)
        weighed = belief._replace(queue=Queue((cloud,))).scanned(
            used, self.scan.log_likelihood(cloud, used), most=cloud.shape[1]
        )
        averages = now.averages
        if scan.beams > 0:
            averages = averages_after(averages, weighed.scan_log_evidence, cloud.shape[1])
        heading = float(arrays.wrapped([now.heading + float(since[2])])[0])
        running = _Running(
            weighed, np.zeros(3), heading, averages, now.updates + 1, now.converged, now.rng
        )
        if running.updates % self.interval == 0 and not (
            self.selective and weighed.effective_sample_size > weighed.log_weights.size / 2
        ):
            running = self._resampled(running)
        self._running = running
        return running.belief

    def _resampled(self, now: _Running) -> _Running:
        """Draw independently, by weight or at random poses, until KLD-sampling is satisfied."""
        belief, share = now.belief, now.averages.share
        cumulative = np.cumsum(belief.weights)
        pointers = now.rng.random(self.kld.most) * cumulative[-1]
        anywhere = now.rng.random(self.kld.most) < share
        chosen = np.searchsorted(cumulative, pointers, side="right").clip(max=cumulative.size - 1)
        drawn = belief.present.take(chosen, axis=1)
        if count := int(np.count_nonzero(anywhere)):
            drawn[:, anywhere] = random_poses(self.robot.floor_plan, count, now.rng)
        enough = self.kld.enough(drawn)
        events = belief.events.plus(random_poses=int(np.count_nonzero(anywhere[:enough])))
        poses = np.ascontiguousarray(drawn[:, :enough])
        cloud = belief._replace(
            queue=Queue((poses,)), log_weights=np.zeros(poses.shape[1]), events=events
        )
        off = np.abs(poses[:2] - poses[:2].mean(axis=1, dtype=np.float64, keepdims=True))
        return replace(
            now,
            belief=cloud,
            averages=replace(now.averages, slow=0.0, fast=0.0) if share > 0 else now.averages,
            converged=float(off.max()) <= 0.5 * metre(self.robot.floor_plan.unit),  # pf.c
        )


def amcl(
    robot: RobotModel,
    *,
    max_particles: Annotated[int, "most particles, at least min_particles"] = 2000,
    min_particles: Annotated[int, "least particles, at least 1"] = 500,
    pf_err: Annotated[float, "ε of KLD-sampling, above 0; bins are 0.5 m x 0.5 m x 10°"] = 0.05,
    pf_z: Annotated[float, "z of KLD-sampling"] = 0.99,
    recovery_alpha_slow: Annotated[
        float, "slow rate of random poses, 0 to 1; Nav2 recommends 0.001"
    ] = 0.0,
    recovery_alpha_fast: Annotated[
        float, "fast rate, from the slow one to 1; Nav2 recommends 0.1; with both 0 none"
    ] = 0.0,
    resample_interval: Annotated[int, "updates between two resamplings, at least 1"] = 1,
    selective_resampling: Annotated[
        bool, "ROS 1's: resample only if the effective particles are at most half"
    ] = False,
    update_min_d: Annotated[float, "m of odometry until the next scan is used, 0 or more"] = 0.25,
    update_min_a: Annotated[float, "rad of odometry until the next scan is used, 0 or more"] = 0.2,
    robot_model_type: Annotated[
        str, "motion: this, nav2_amcl::OmniMotionModel, or robot (the robot's own)"
    ] = DIFFERENTIAL,
    alpha1: Annotated[float, "noise of turns by turns, 0 or more"] = 0.2,
    alpha2: Annotated[float, "noise of turns by distance"] = 0.2,
    alpha3: Annotated[float, "noise of distance by distance"] = 0.2,
    alpha4: Annotated[float, "noise of distance by turns"] = 0.2,
    alpha5: Annotated[float, "noise of moves to the side, of the omni model"] = 0.2,
    laser_model_type: Annotated[
        str, "scans: this, likelihood_field_prob, beam, or robot (its own, all beams)"
    ] = "likelihood_field",
    max_beams: Annotated[
        int, "every so many-th beam is used, so that these are about as many; at least 2"
    ] = 60,
    z_hit: Annotated[
        float, "weight of a return from the map, 0 or more; weights need no sum of 1"
    ] = 0.5,
    z_short: Annotated[float, "weight of a return from before it; of beam only"] = 0.05,
    z_max: Annotated[float, "weight of no return; of beam only"] = 0.05,
    z_rand: Annotated[float, "weight of a random return"] = 0.5,
    sigma_hit: Annotated[float, "SD of a return, m, above 0"] = 0.2,
    lambda_short: Annotated[
        float, "how fast short returns get rare, per m, 0 or more; of beam only"
    ] = 0.1,
    laser_likelihood_max_dist: Annotated[
        float, "distance from walls, m, that fields reach, above 0"
    ] = 2.0,
    do_beamskip: Annotated[
        bool, "whether likelihood_field_prob leaves out beams while the cloud is small"
    ] = False,
    beam_skip_distance: Annotated[
        float, "m to a wall within which a particle agrees with a beam, 0 or more"
    ] = 0.5,
    beam_skip_threshold: Annotated[float, "share of particles that must agree, 0 to 1"] = 0.3,
    beam_skip_error_threshold: Annotated[
        float, "share of beams left out, 0 to 1, from which all are used"
    ] = 0.9,
    field_cell: Annotated[
        float, "edge of a cell of the field on a map of polygons, m, above 0"
    ] = 0.02,
) -> AdaptiveLocalizer:
    """Return Nav2's AMCL, with its units: metres on a map in px, too (1 px is 0.02 m)."""
    integer("max_particles", max_particles, low=1, high=MAX_PARTICLES)
    fields = "likelihood_field", "likelihood_field_prob"
    one_of("laser_model_type", laser_model_type, (*fields, "beam", "robot"))
    one_of("robot_model_type", robot_model_type, (DIFFERENTIAL, OMNI, "robot"))
    boolean("do_beamskip", do_beamskip)
    weights = {"z_hit": z_hit, "z_short": z_short, "z_max": z_max, "z_rand": z_rand}
    for name, weight in weights.items():
        number(name, weight, low=0)
    if z_hit + z_rand <= 0:
        raise InputError(f"z_hit is {z_hit:g} and z_rand is {z_rand:g}: one must be above 0.")
    number("beam_skip_distance", beam_skip_distance, low=0)
    number("beam_skip_threshold", beam_skip_threshold, low=0, high=1)
    number("beam_skip_error_threshold", beam_skip_error_threshold, low=0, high=1)
    plan, lidar = robot.floor_plan, robot.lidar
    size = metre(plan.unit)
    alphas = {"alpha1": alpha1, "alpha2": alpha2, "alpha3": alpha3, "alpha4": alpha4}
    motions: dict[str, Motion] = {
        DIFFERENTIAL: scaled(DifferentialMotion(**alphas), size),
        OMNI: scaled(OmniMotion(**alphas, alpha5=alpha5), size),
        "robot": robot.motion,
    }
    sigma = number("sigma_hit", sigma_hit, low=0, above=True) * size
    scan: ScanModel
    if laser_model_type == "robot":
        scan = robot.scan_model()
    elif laser_model_type == "beam":
        scan = BeamCubes(
            floor_plan=plan, lidar=lidar, hit=z_hit, short=z_short, max=z_max, rand=z_rand,
            sigma=sigma, decay=number("lambda_short", lambda_short, low=0) / size,
            max_beams=max_beams,
        )  # fmt: skip
    else:
        farthest = number("laser_likelihood_max_dist", laser_likelihood_max_dist, low=0, above=True)
        scan = LikelihoodField(
            floor_plan=plan, lidar=lidar, sigma=sigma, farthest=farthest * size, hit=z_hit,
            rand=z_rand, max_beams=max_beams, product=laser_model_type == fields[1],
            cell=number("field_cell", field_cell, low=0, above=True) * size,
        )  # fmt: skip
    skipping = None
    if do_beamskip and isinstance(scan, LikelihoodField) and scan.product:
        skipping = BeamSkipping(
            field=scan, distance=beam_skip_distance * size, threshold=beam_skip_threshold,
            error_threshold=beam_skip_error_threshold,
        )  # fmt: skip
    return AdaptiveLocalizer(
        robot=robot,
        motion=motions[robot_model_type],
        scan=scan,
        kld=KldSampling(
            least=min_particles,
            most=max_particles,
            error=pf_err,
            quantile=pf_z,
            bin_size=(0.5 * size, 0.5 * size, math.pi / 18),  # pf_kdtree.c
        ),
        averages=Averages(alpha_slow=recovery_alpha_slow, alpha_fast=recovery_alpha_fast),
        interval=integer("resample_interval", resample_interval, low=1),
        selective=boolean("selective_resampling", selective_resampling),
        distance=number("update_min_d", update_min_d, low=0) * size,
        angle=number("update_min_a", update_min_a, low=0),
        skipping=skipping,
    )
