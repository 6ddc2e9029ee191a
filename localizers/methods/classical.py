"""Two classical estimators: the extended Kalman filter, and dead reckoning.

Dead reckoning: x_t = x_{t-1} ⊕ a_t from the prior's mean, without scan, map and noise.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import Floats, Pose, arrays
from deqmcl_gym.numerics.arrays import cholesky
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos64, sin64
from deqmcl_gym.validation import InputError, number
from localizers.api import Points, Prior, mean_pose
from localizers.inference import (
    FilterLocalizer,
    checked_action,
    checked_plan,
    checked_rng,
    require_reset,
)
from localizers.inference.belief import Events
from localizers.inference.loss_detector import LossDetector
from localizers.inference.particles import log_evidence
from localizers.models import RobotModel
from localizers.models.motion import OdometryMotion, distance_and_bearing, odometry
from localizers.models.scan import LidarScan, Scan


@compiled
def predict(
    mean: Floats,
    covariance: Floats,
    distance: float,
    bearing: float,
    turn: float,
    sd_distance: float,
    sd_turn: float,
) -> None:
    """μ ← f(μ, a), P ← F P Fᵀ + V Q Vᵀ, in place: turn, then drive in direction θ' + bearing.

    F = ∂f/∂x and V = ∂f/∂ε at the mean; Q = diag(sd_distance², sd_turn²).
    """
    heading = mean[2] + turn
    sine, cosine = sin64(heading + bearing), cos64(heading + bearing)
    mean[0] += distance * cosine
    mean[1] += distance * sine
    mean[2] = heading
    lever_x, lever_y = -distance * sine, distance * cosine
    for j in range(3):  # F P
        covariance[0, j] += lever_x * covariance[2, j]
        covariance[1, j] += lever_y * covariance[2, j]
    for i in range(3):  # (F P) Fᵀ
        covariance[i, 0] += lever_x * covariance[i, 2]
        covariance[i, 1] += lever_y * covariance[i, 2]
    drive, swing = (cosine, sine, 0.0), (lever_x, lever_y, 1.0)
    for i in range(3):
        for j in range(3):
            covariance[i, j] += sd_distance * drive[i] * (sd_distance * drive[j])
            covariance[i, j] += sd_turn * swing[i] * (sd_turn * swing[j])


@compiled
def correct(
    mean: Floats,
    covariance: Floats,
    innovations: Floats,
    slopes: Floats,
    variances: Floats,
    gate: float,
) -> int:
    """Take in independent measurements one after another, in place; return how many were gated.

    Each has ν = o - h(μ), of variance S = H P Hᵀ + R; left out if ν² > gate S. All are linearised
    at the mean before the first: innovations o - h, (B,), slopes H, (B, 3), variances R ≥ 0. P in
    Joseph's form stays symmetric and positive. A beam with S = 0, as all walls are far, is skipped.
    """
    moved = np.zeros(3)  # of the mean since the linearisation
    projected, gain = np.empty(3), np.empty(3)
    simple = np.empty((3, 3))
    gated = 0
    for b in range(innovations.size):
        slope = slopes[b]
        innovation, spread = innovations[b], variances[b]
        for i in range(3):
            projected[i] = 0.0
            for j in range(3):
                projected[i] += covariance[i, j] * slope[j]
        for i in range(3):
            innovation -= slope[i] * moved[i]
            spread += slope[i] * projected[i]
        if innovation * innovation > gate * spread:
            gated += 1
            continue
        for i in range(3):
            gain[i] = projected[i] / spread if spread > 0.0 else 0.0
            moved[i] += gain[i] * innovation
        for i in range(3):  # (I - K H) P
            for j in range(3):
                simple[i, j] = covariance[i, j] - gain[i] * projected[j]
        for i in range(3):
            along = 0.0
            for j in range(3):
                along += simple[i, j] * slope[j]
            for j in range(3):  # ((I - K H) P)(I - K H)ᵀ + K R Kᵀ
                covariance[i, j] = simple[i, j] - along * gain[j] + gain[i] * variances[b] * gain[j]
    for i in range(3):
        mean[i] += moved[i]
    return gated


def covariance_of(offsets: Floats) -> Floats:
    """Return the mean products of offsets (d, n) from a mean, (d, d)."""
    rows = np.ascontiguousarray(offsets)
    return np.asarray((rows[:, None] * rows).mean(axis=2))


POINTS = 512
# Powers -1 to -4 of 1.1673039782614187, the steps of an even sequence in four dimensions; written
# out, as NumPy's powers differ between processors.
_EVEN_STEPS = np.array(
    [0.8566748838545029, 0.733891856627126, 0.6287067210378086, 0.53859725722361]
)


def gaussian_points(mean: Floats, covariance: Floats) -> Floats:
    """Return ``POINTS`` equally weighted poses with exactly this mean and covariance, (n, 3).

    Fixed points that look standard normal, in pairs ±z, through the Cholesky factor: six sigma
    points lie on one ellipsoid, so that coverage, which counts points inside, would mean nothing.
    """
    x, y, z = _standard_points()
    offsets = [row[0] * x + row[1] * y + row[2] * z for row in cholesky(covariance)]
    return np.asarray(mean + np.stack(offsets, axis=1))


def sigma_points(mean: Floats, covariance: Floats) -> Floats:
    """Return the six poses μ ± √3 L_i, equally weighted, of this mean and covariance, (3, 6)."""
    root = cholesky(covariance)
    return np.asarray(mean[:, None] + math.sqrt(3) * np.hstack([root, -root]))


@lru_cache(maxsize=1)
def _standard_points() -> Floats:
    """Columns of mean 0 and covariance I, (3, n)."""
    even = (0.5 + np.arange(POINTS // 2)[:, None] * _EVEN_STEPS) % 1.0
    radius = np.sqrt(-2 * arrays.log(even[:, :2]))  # Box & Muller 1958
    angle = 2 * np.pi * even[:, 2:]
    half = np.hstack([radius * arrays.cos(angle), radius[:, :1] * arrays.sin(angle[:, :1])]).T
    points = np.hstack([half, -half])
    root = cholesky(covariance_of(points))
    for i in range(3):  # points ← root⁻¹ points, by forward substitution
        for j in range(i):
            points[i] -= root[i, j] * points[j]
        points[i] /= root[i, i]
    return points


# Half-widths of the central differences: px (scaled to the map's unit), px, rad. Above the float32
# resolution of the ray cast, below the size of walls.
_STEPS = np.array([1.0, 1.0, 0.01])


@dataclass(frozen=True)
class GaussianEvents(Events):
    """Counts also of beams that are left out: gated, or predicted outside the outer wall."""

    gated_beams: int = 0
    unpredicted_beams: int = 0


class GaussianBelief(NamedTuple):
    """One Gaussian over (x, y, θ rad), mean (3,) and covariance (3, 3)."""

    mean: Floats
    covariance: Floats
    detector: LossDetector
    events: GaussianEvents = GaussianEvents()

    def points(self, offset: int = 0) -> Points | None:
        """Return equally weighted poses (n, 3) of exactly these moments; at offset 0 only.

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
        return self.detector.quality


@dataclass(frozen=True, kw_only=True)
class KalmanFilter:
    """The extended Kalman filter: a Gaussian, predicted and corrected beam by beam."""

    motion: OdometryMotion
    scan: LidarScan
    gate: float  # the largest ν² / S of a beam that is used
    detector: LossDetector

    def initial(self, prior: Prior, plan: Floats, rng: np.random.Generator) -> GaussianBelief:
        """Return the Gaussian of the prior's mean, or that of its draws, and their covariance."""
        draws = np.asarray(prior.sample(10_000, rng.spawn(1)[0]), dtype=np.float64)
        even = np.full(len(draws), 1 / len(draws))
        mean = np.array(mean_pose(draws, even) if prior.mean is None else prior.mean, np.float64)
        offsets = draws - mean
        offsets[:, 2] = arrays.wrapped(offsets[:, 2])
        return GaussianBelief(mean, covariance_of(offsets.T), self.detector)

    def step(
        self,
        belief: GaussianBelief,
        scan: Scan,
        action: Floats,
        plan: Floats,
        rng: np.random.Generator,
    ) -> GaussianBelief:
        mean, covariance = belief.mean.copy(), belief.covariance.copy()
        way, turn = distance_and_bearing(action), float(action[2])
        predict(mean, covariance, *way, turn, *self.motion.spread(action))
        predicted = np.ascontiguousarray(sigma_points(mean, covariance), dtype=np.float32)
        likelihoods = self.scan.log_likelihood(predicted, scan)
        detector = belief.detector.scanned(scan, log_evidence(np.zeros(6), likelihoods, 6))
        gated, unpredicted = self._corrected(mean, covariance, scan)
        events = belief.events.plus(gated_beams=gated, unpredicted_beams=unpredicted)
        mean[2] = float(arrays.arctan2(arrays.sin(mean[2]), arrays.cos(mean[2])))
        return GaussianBelief(mean, covariance, detector, events)

    def _corrected(self, mean: Floats, covariance: Floats, scan: Scan) -> tuple[int, int]:
        """Correct by a scan, in place; return the numbers of gated and of unpredicted beams."""
        floor_plan, lidar = self.scan.floor_plan, self.scan.lidar
        steps = _STEPS * np.array([pixel(floor_plan.unit), pixel(floor_plan.unit), 1.0])
        shifts = np.vstack([np.zeros(3), np.diag(steps), -np.diag(steps)])
        seen = lidar.ranges(floor_plan, (mean + shifts).T, scan.usable)
        predicted = np.isfinite(seen).all(axis=0)
        beam: Any = self.scan.beam  # has the mean and variance of one that hits the expected wall
        expected, variances = beam.hit_moments(
            seen[:, predicted].astype(np.float64), lidar.max_range
        )
        slopes = (expected[1:4] - expected[4:7]) / (2 * steps[:, None])
        gated = correct(
            mean, covariance, scan.ranges[scan.usable][predicted] - expected[0],
            np.ascontiguousarray(slopes.T), variances[0], self.gate,
        )  # fmt: skip
        return gated, int((~predicted).sum())


def ekf(
    robot: RobotModel,
    *,
    gate: Annotated[
        float, "share of beams used if all is as assumed, above 0, to 1; 1: every beam is used"
    ] = 0.99,
) -> FilterLocalizer[GaussianBelief]:
    """Return the extended Kalman filter, for ``OdometryMotion`` and a scan with ``hit_moments``.

    A beam is a measurement with these mean and variance; its Jacobian is by central differences of
    the ray cast. ``gate`` is by the χ² of its innovation, to which random readings are left. Of a
    prior the mean and covariance count: a uniform one over a building will hardly find the robot.
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
        gate=bound,
        detector=LossDetector.of(scan, robot.floor_plan),
    )
    return FilterLocalizer(robot, kalman)


_KEPT = 10_000  # poses, at least


@dataclass(frozen=True)
class _Track:
    """The last poses, a list that later steps append to, and the plan from the present on."""

    driven: list[Pose]
    present: int
    plan: Floats

    def points(self, offset: int = 0) -> tuple[Floats, Floats] | None:
        index = self.present + offset
        if not 0 <= index <= self.present + len(self.plan):
            return None
        pose = self.driven[min(index, self.present)]
        for action in self.plan[: max(offset, 0)].tolist():
            pose = _moved(pose, *action)
        return np.array([pose]), np.ones(1)


class DeadReckoning:
    """Dead reckoning; it does not use the robot model.

    Integrates the commands from the prior's mean, and the plan up to the offset asked for.
    """

    def __init__(self, robot: RobotModel) -> None:
        del robot
        self._driven: list[Pose] | None = None

    def reset(self, prior: Prior, plan: ArrayLike, rng: np.random.Generator) -> _Track:
        checked_rng(rng)
        if (mean := getattr(prior, "mean", None)) is None:
            raise InputError(
                f"the prior is a {type(prior).__name__} without a mean, but dead reckoning needs "
                "one to start from: give a GaussianPrior, or use another localizer."
            )
        track = _Track([mean], 0, checked_plan(plan))
        self._driven = track.driven
        return track

    def update(self, ranges: ArrayLike, action: ArrayLike, plan: ArrayLike) -> _Track:
        driven = require_reset(self._driven)
        command, ahead = checked_action(action), checked_plan(plan)
        if len(driven) >= 2 * _KEPT:
            self._driven = driven = driven[-_KEPT:]
        driven.append(_moved(driven[-1], *command.tolist()))
        return _Track(driven, len(driven) - 1, ahead)


def _moved(pose: Pose, forward: float, left: float, turn: float) -> Pose:
    x, y, heading = pose
    heading += turn
    cosine, sine = cos64(heading), sin64(heading)
    return x + (forward * cosine - left * sine), y + (forward * sine + left * cosine), heading
