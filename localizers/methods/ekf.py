"""N(μ_t, P_t) ≈ p(x_t | a_{1:t}, o_{1:t}, m): the extended Kalman filter on ray-cast ranges.

Leonard & Durrant-Whyte 1991; Thrun et al. 2005, sections 3.3 and 7.4, with gated beams instead of
landmarks. One Gaussian: it can follow a robot, not find one.
"""

from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError, number
from localizers.api import Points, Prior, RobotModel, checked_plan, checked_step
from localizers.inference import gaussian_kernels as kernels
from localizers.inference.belief import Events
from localizers.inference.gaussian import gaussian_points, sigma_points
from localizers.inference.kernels import log_evidence
from localizers.inference.trust import ANYWHERE, Trust
from localizers.models.free_space import even_poses
from localizers.models.motion import OdometryMotion, odometry
from localizers.models.scan import LidarScan, usable_beams

PRIOR_DRAWS = 10_000  # from which the prior's covariance is taken
# Half-widths of the central differences: px, px, rad. Beyond the ray cast's resolution (float32),
# below the size of what it sees.
STEPS = np.array([1.0, 1.0, 0.01])


@runtime_checkable
class HitMoments(Protocol):
    """A beam model that knows mean and variance of a beam that hits what it should."""

    def hit_moments(self, expected: Floats, max_range: float) -> tuple[Floats, Floats]:
        """Mean (px) and variance (px²), (n, B) each."""
        ...


@dataclass(frozen=True)
class GaussianEvents(Events):
    """Counts of trouble of a Kalman filter.

    Attributes:
        gated_beams: too far from what was expected to be believed.
        unpredicted_beams: the mean, or a pose next to it, lay outside the outer wall.
    """

    gated_beams: int = 0
    unpredicted_beams: int = 0


@dataclass(frozen=True)
class GaussianBelief:
    """One Gaussian over (x, y, θ).

    Attributes:
        mean: px, px, rad, (3,).
        covariance: (3, 3).
        trust: evidence for and against this belief.
        events: counted trouble since reset.
    """

    mean: Floats
    covariance: Floats
    trust: Trust
    events: GaussianEvents = field(default_factory=GaussianEvents)

    def points(self, offset: int = 0) -> Points | None:
        """Return poses (n, 3) of exactly this mean and covariance, equally weighted; at offset 0.

        The headings are not wrapped: the Gaussian is on the line, not on the circle.
        """
        if offset != 0:
            return None
        poses = gaussian_points(self.mean, self.covariance)
        return poses, np.full(len(poses), 1 / len(poses))

    @property
    def quality(self) -> float:
        """P(not lost | o_{1:t}), in [0, 1]."""
        return self.trust.quality


class KalmanLocalizer:
    """A ``Localizer`` that runs an extended Kalman filter."""

    def __init__(
        self, robot: RobotModel, motion: OdometryMotion, beam: HitMoments, gate: float
    ) -> None:
        """Make a localizer for ``robot``; ``gate``: largest ν² / S of a beam that is believed."""
        self.robot = robot
        self._motion, self._beam, self._gate = motion, beam, gate
        self._scan = LidarScan(floor_plan=robot.floor_plan, lidar=robot.lidar, beam=robot.scan)
        self._belief: GaussianBelief | None = None

    def reset(self, prior: Prior, plan: ArrayLike, rng: np.random.Generator) -> GaussianBelief:
        """Start anew; see ``Localizer.reset``. The plan is not used."""
        checked_plan(plan)
        mean, covariance = _moments(prior, rng.spawn(1)[0])
        trust = Trust(self._scan, even_poses(self.robot.floor_plan, ANYWHERE))
        self._belief = GaussianBelief(mean, covariance, trust)
        return self._belief

    def update(self, ranges: ArrayLike, action: ArrayLike, plan: ArrayLike) -> GaussianBelief:
        """Go one step on; see ``Localizer.update``."""
        if self._belief is None:
            raise RuntimeError(
                "update was called before reset: call reset(prior, plan, rng) first."
            )
        before = self._belief
        scan, command, _, usable = checked_step(ranges, action, plan, self.robot.lidar)
        mean, covariance = before.mean.copy(), before.covariance.copy()
        distance, turn = command.tolist()
        kernels.predict(mean, covariance, distance, turn, *self._motion.spread(command))
        events = before.events.of_scan(scan.size, usable)
        predicted = np.ascontiguousarray(sigma_points(mean, covariance), dtype=np.float32)
        likelihoods = self._scan.log_likelihood(predicted, scan)
        trust = before.trust.after(scan, log_evidence(np.zeros(6), likelihoods, 6))
        gated, unpredicted = self._corrected(mean, covariance, scan)
        if gated or unpredicted:
            events = events.plus(gated_beams=gated, unpredicted_beams=unpredicted)
        mean[2] = float(arrays.arctan2(arrays.sin(mean[2]), arrays.cos(mean[2])))
        self._belief = GaussianBelief(mean, covariance, trust, events)
        return self._belief

    def _corrected(self, mean: Floats, covariance: Floats, scan: Floats) -> tuple[int, int]:
        """Take in a scan, in place; return how many beams were gated, and how many unpredicted."""
        lidar = self.robot.lidar
        usable = usable_beams(scan, lidar.max_range)
        shifts = np.vstack([np.zeros(3), np.diag(STEPS), -np.diag(STEPS)])
        seen = self.robot.floor_plan.ranges(mean + shifts, lidar.bearings[usable])
        predicted = np.isfinite(seen).all(axis=0)
        expected, variances = self._beam.hit_moments(
            seen[:, predicted].astype(np.float64), lidar.max_range
        )
        slopes = (expected[1:4] - expected[4:7]) / (2 * STEPS[:, None])
        gated = kernels.correct(
            mean,
            covariance,
            scan[usable][predicted] - expected[0],
            np.ascontiguousarray(slopes.T),
            variances[0],
            self._gate,
        )
        return gated, int((~predicted).sum())


def ekf(robot: RobotModel, *, gate: float = 0.99) -> KalmanLocalizer:
    """Return the extended Kalman filter.

    A beam is a measurement of mean and variance as the robot's scan model has them for a beam that
    hits what it should; its Jacobian is taken by central differences of the ray cast. The share of
    beams that measure anything at all is left to the gate.

    Args:
        robot: its motion must be an ``OdometryMotion``, its scan model have ``hit_moments``.
        gate: share of beams that pass if all is as assumed, by the χ² of their innovation; 1 lets
            every beam pass.
    """
    number("gate", gate, low=0, high=1, above=True)
    if not isinstance(robot.scan, HitMoments):
        raise InputError(
            f"the scan model is {robot.scan!r}, but the localizer 'ekf' needs the mean and the "
            "variance of a beam: give one with a method hit_moments(expected, max_range)."
        )
    bound = NormalDist().inv_cdf((1 + gate) / 2) ** 2 if gate < 1 else np.inf
    return KalmanLocalizer(robot, odometry(robot.motion, "ekf"), robot.scan, bound)


def _moments(prior: Prior, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Mean of a prior and covariance about it, the headings taken as differences in [-π, π]."""
    mean = np.array(prior.mean, dtype=np.float64)
    apart = np.asarray(prior.sample(PRIOR_DRAWS, rng), dtype=np.float64) - mean
    apart[:, 2] -= 2 * np.pi * np.rint(apart[:, 2] / (2 * np.pi))
    covariance = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            covariance[i, j] = (apart[:, i] * apart[:, j]).mean()
    return mean, covariance
