"""
A filter of another library: filterpy's UKF
===========================================

``UnscentedKalmanFilter`` of `filterpy <https://filterpy.readthedocs.org>`_ (Labbe) as a localizer:
a Gaussian over (x, y, θ), moved by the assumed motion and corrected by the beams that hit a wall.
Run it beside others with ``deqmcl sweep ranking --with docs/examples/foreign/filterpy_ukf.py:Ukf``.
"""

import math

import numpy as np

from deqmcl_gym.validation import InputError
from localizers import Belief, PointsBelief, Prior, RobotModel
from localizers.models.motion import increments

try:
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
except ModuleNotFoundError:
    raise InputError("filterpy_ukf.py needs filterpy: run pip install filterpy scipy.") from None

DRAWS = 500  # of the prior, and of a step, whose covariances are taken
MOST = 1e6  # length or turn of a step, beyond which covariances lose all digits


def turned(angle):
    """An angle in [-π, π)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The difference of two poses; that of their headings is an angle."""
    return np.array([a[0] - b[0], a[1] - b[1], turned(a[2] - b[2])])


def mean_of(poses: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The weighted mean of poses (n, 3); that of the headings is a direction."""
    x, y = weights @ poses[:, :2]
    sine, cosine = weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2])
    return np.array([x, y, math.atan2(sine, cosine)])


def moved(pose: np.ndarray, action: np.ndarray) -> np.ndarray:
    """A pose after an increment without noise: turn first, then move."""
    forward, left, turn = action
    heading = pose[2] + turn
    cosine, sine = math.cos(heading), math.sin(heading)
    way = forward * cosine - left * sine, forward * sine + left * cosine
    return np.array([pose[0] + way[0], pose[1] + way[1], heading])


def positive(covariance: np.ndarray, least: float) -> np.ndarray:
    """The nearest symmetric matrix whose eigenvalues are ``least`` or more."""
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    return (vectors * np.maximum(values, least)) @ vectors.T


class Ukf:
    """filterpy's unscented Kalman filter on ray-cast ranges.

    Args:
        robot: the map, the lidar and the assumed noise.
        gate: largest innovation of a beam that is used, in standard deviations.
    """

    def __init__(self, robot: RobotModel, *, gate: float = 3.0) -> None:
        self.robot, self.gate = robot, gate

    def reset(self, prior: Prior, plan: np.ndarray, rng: np.random.Generator) -> Belief:
        """Return the Gaussian of the prior's moments."""
        self.rng = rng
        # alpha = 1 and kappa = 0: no weight is negative, so covariances stay positive
        sigma_points = MerweScaledSigmaPoints(3, alpha=1.0, beta=2.0, kappa=0.0, subtract=apart)
        self.filter = UnscentedKalmanFilter(
            dim_x=3, dim_z=1, dt=1.0, hx=None, fx=None, points=sigma_points,
            x_mean_fn=mean_of, residual_x=apart,
        )  # fmt: skip
        self.filter.x, self.filter.P = self._moments(prior.sample(DRAWS, rng))
        return self._belief()

    def update(self, ranges: np.ndarray, action: np.ndarray, plan: np.ndarray) -> Belief:
        """Predict by the action, correct by the beams that are within the gate."""
        step, ukf = increments(action), self.filter
        if np.abs(step).max() > MOST:
            raise InputError(f"the action is {step.tolist()}, but must be below {MOST:g}.")
        at = np.tile(ukf.x[:, None], DRAWS).astype(np.float32)
        ukf.Q = self._moments(self.robot.motion.sample(at, action, self.rng).T)[1]
        ukf.predict(fx=lambda pose, dt: moved(pose, step))
        ukf.P = positive(ukf.P, self._least)
        self._correct(ranges)
        ukf.P = positive(ukf.P, self._least)
        ukf.x[2] = turned(ukf.x[2])
        return self._belief()

    def _correct(self, ranges: np.ndarray) -> None:
        lidar, ukf = self.robot.lidar, self.filter
        usable = (ranges >= 0) & (ranges < lidar.max_range)
        poses = np.vstack([ukf.x, ukf.points_fn.sigma_points(ukf.x, ukf.P)])
        seen = lidar.ranges(self.robot.floor_plan, poses.T.astype(np.float32), usable)
        inside = np.isfinite(seen).all(axis=0)  # no sigma point is beyond a wall
        if not inside.any():
            return
        seen = seen[:, inside].astype(float)
        expected, variances = self.robot.scan.hit_moments(seen[:1], lidar.max_range)
        spread = variances[0] + seen[1:].var(axis=0)
        measured = ranges[usable][inside]
        fits = (measured - expected[0]) ** 2 < self.gate**2 * spread
        if not fits.any():
            return
        rows = iter(self.robot.scan.hit_moments(seen[1:][:, fits], lidar.max_range)[0])
        ukf.sigmas_f = poses[1:]
        noise = np.diag(np.maximum(variances[0, fits], self._least))  # 0 far beyond max_range
        ukf.update(measured[fits], R=noise, hx=lambda pose: next(rows))

    def _moments(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (3,) and covariance (3, 3) of poses (n, 3)."""
        mean = mean_of(poses, np.full(len(poses), 1 / len(poses)))
        off = np.column_stack([poses[:, :2] - mean[:2], turned(poses[:, 2] - mean[2])])
        return mean, positive(off.T @ off / len(poses), self._least)

    @property
    def _least(self) -> float:
        """Least variance: that of a thousandth of the robot's radius."""
        return (1e-3 * self.robot.radius) ** 2

    def _belief(self) -> Belief:
        """Return the sigma points by their weights, all positive at this spread."""
        mean, root = self.filter.x, np.linalg.cholesky(3 * self.filter.P)
        return PointsBelief(np.vstack([mean + root.T, mean - root.T]))
