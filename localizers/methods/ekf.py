"""N(μ_t, P_t) ≈ p(x_t | a_{1:t}, o_{1:t}, m): the extended Kalman filter on ray-cast ranges.

Leonard & Durrant-Whyte 1991; Thrun et al. 2005, sections 3.3 and 7.4, with gated beams instead of
landmarks. A single Gaussian can track a robot, but not find a lost one.
"""

from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np

from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError, number
from localizers.api import Points, Prior
from localizers.beliefs import mean_pose
from localizers.inference import gaussian as kernels
from localizers.inference.bayes_filter import FilterLocalizer
from localizers.inference.belief import Events
from localizers.inference.gaussian import covariance_of, gaussian_points, sigma_points
from localizers.inference.loss_detector import LossDetector
from localizers.inference.weights import log_evidence
from localizers.models.motion import OdometryMotion, distance_and_bearing, odometry
from localizers.models.robot import RobotModel
from localizers.models.scan import LidarScan, Scan

PRIOR_DRAWS = 10_000  # from which the prior's covariance is taken
# Half-widths of the central differences: px (scaled to the map's unit), px, rad. Above the float32
# resolution of the ray cast, below the size of walls.
_STEPS = np.array([1.0, 1.0, 0.01])


@dataclass(frozen=True)
class GaussianEvents(Events):
    """Counts of irregular events of a Kalman filter.

    Attributes:
        gated_beams: beams left out because their innovation was too large.
        unpredicted_beams: beams left out because the mean, or a pose beside it, was outside the
            outer wall.
    """

    gated_beams: int = 0
    unpredicted_beams: int = 0


class GaussianBelief(NamedTuple):
    """One Gaussian over (x, y, θ).

    Attributes:
        mean: x, y, θ rad, (3,).
        covariance: (3, 3).
        detector: evidence for and against this belief.
        events: counts since reset.
    """

    mean: Floats
    covariance: Floats
    detector: LossDetector
    events: GaussianEvents = GaussianEvents()

    def points(self, offset: int = 0) -> Points | None:
        """Return poses (n, 3) of exactly this mean and covariance, equally weighted; at offset 0.

        The headings are not wrapped: the Gaussian is on the line, not on the circle.
        """
        if offset != 0:
            return None
        poses = gaussian_points(self.mean, self.covariance)
        return poses, np.full(len(poses), 1 / len(poses))

    @property
    def scan_log_evidence(self) -> float:
        """Log of the mean of p(o_t | x) over six sigma points of the belief before the scan."""
        return self.detector.log_right

    @property
    def quality(self) -> float:
        """P(not lost | o_{1:t}), in [0, 1]."""
        return self.detector.quality


@dataclass(frozen=True, kw_only=True)
class KalmanFilter:
    """The extended Kalman filter: a Gaussian, predicted and corrected beam by beam.

    Attributes:
        motion: p(x_t | x_{t-1}, a_t).
        scan: p(o_t | x_t, m), from which the quality is computed.
        beam: with ``hit_moments``, the mean and variance of a beam that hits the expected wall.
        gate: largest ν² / S of a beam that is used.
        detector: evidence for and against its beliefs at t = 0.
    """

    motion: OdometryMotion
    scan: LidarScan
    beam: Any
    gate: float
    detector: LossDetector

    def initial(self, prior: Prior, plan: Floats, rng: np.random.Generator) -> GaussianBelief:
        """Return the Gaussian of the prior's moments. The plan is not used."""
        return GaussianBelief(*_gaussian(prior, rng.spawn(1)[0]), self.detector)

    def step(
        self,
        belief: GaussianBelief,
        scan: Scan,
        action: Floats,
        plan: Floats,
        rng: np.random.Generator,
    ) -> GaussianBelief:
        """Return the belief after one increment (3,) and one scan."""
        mean, covariance = belief.mean.copy(), belief.covariance.copy()
        way, turn = distance_and_bearing(action), float(action[2])
        kernels.predict(mean, covariance, *way, turn, *self.motion.spread(action))
        predicted = np.ascontiguousarray(sigma_points(mean, covariance), dtype=np.float32)
        likelihoods = self.scan.log_likelihood(predicted, scan)
        detector = belief.detector.scanned(scan, log_evidence(np.zeros(6), likelihoods, 6))
        gated, unpredicted = self._corrected(mean, covariance, scan)
        events = belief.events
        if gated or unpredicted:
            events = events.plus(gated_beams=gated, unpredicted_beams=unpredicted)
        mean[2] = float(arrays.arctan2(arrays.sin(mean[2]), arrays.cos(mean[2])))
        return GaussianBelief(mean, covariance, detector, events)

    def _corrected(self, mean: Floats, covariance: Floats, scan: Scan) -> tuple[int, int]:
        """Correct by a scan, in place; return the numbers of gated and of unpredicted beams."""
        floor_plan, lidar = self.scan.floor_plan, self.scan.lidar
        steps = _STEPS * np.array([pixel(floor_plan.unit), pixel(floor_plan.unit), 1.0])
        shifts = np.vstack([np.zeros(3), np.diag(steps), -np.diag(steps)])
        seen = lidar.ranges(floor_plan, (mean + shifts).T, scan.usable)
        predicted = np.isfinite(seen).all(axis=0)
        expected, variances = self.beam.hit_moments(
            seen[:, predicted].astype(np.float64), lidar.max_range
        )
        slopes = (expected[1:4] - expected[4:7]) / (2 * steps[:, None])
        gated = kernels.correct(
            mean, covariance, scan.ranges[scan.usable][predicted] - expected[0],
            np.ascontiguousarray(slopes.T), variances[0], self.gate,
        )  # fmt: skip
        return gated, int((~predicted).sum())


def ekf(robot: RobotModel, *, gate: float = 0.99) -> FilterLocalizer[GaussianBelief]:
    """Return the extended Kalman filter.

    A beam is a measurement with the mean and the variance that the robot's scan model gives to a
    beam that hits the expected wall; its Jacobian is computed by central differences of the ray
    cast. Random readings are left to the gate. A prior is reduced to its mean and covariance, so a
    uniform prior over a building becomes one Gaussian, which will hardly find the robot.

    Args:
        robot: its motion must be an ``OdometryMotion``, its scan model have ``hit_moments``.
        gate: share of beams that pass if all is as assumed, by the χ² of their innovation; 1 lets
            every beam pass.
    """
    number("gate", gate, low=0, high=1, above=True)
    if not hasattr(robot.scan, "hit_moments"):
        raise InputError(
            f"the scan model is {robot.scan!r}, but the localizer 'ekf' needs the mean and the "
            "variance of a beam: give one with a method hit_moments(expected, max_range)."
        )
    bound = NormalDist().inv_cdf((1 + gate) / 2) ** 2 if gate < 1 else np.inf
    scan = robot.beam_scan("the localizer 'ekf'")
    kalman = KalmanFilter(
        motion=odometry(robot.motion, "ekf"),
        scan=scan,
        beam=robot.scan,
        gate=bound,
        detector=LossDetector.of(scan, robot.floor_plan),
    )
    return FilterLocalizer(robot, kalman)


def _gaussian(prior: Prior, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Mean of a prior (that of its draws, if it has none) and covariance about it.

    The headings are taken as differences in [-π, π].
    """
    draws = np.asarray(prior.sample(PRIOR_DRAWS, rng), dtype=np.float64)
    even = np.full(len(draws), 1 / len(draws))
    mean = np.array(mean_pose(draws, even) if prior.mean is None else prior.mean, np.float64)
    apart = draws - mean
    apart[:, 2] = arrays.wrapped(apart[:, 2])
    return mean, covariance_of(apart.T)
