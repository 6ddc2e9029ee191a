"""
A trajectory with covariances of another library: filterpy's EKF
================================================================

``ExtendedKalmanFilter`` of `filterpy <https://filterpy.readthedocs.org>`_ (Labbe) carries a pose
and its covariance along the odometry of a log, from the reference's first pose, as an odometry node
does. ``deqmcl score`` says whether the covariance is honest:
``python docs/examples/foreign/filterpy_odometry.py lap.csv.gz lap.tum ekf.csv``.
"""

import csv
import math
import sys

import numpy as np

from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.validation import InputError

try:
    from filterpy.kalman import ExtendedKalmanFilter
except ModuleNotFoundError:
    raise InputError(
        "filterpy_odometry.py needs filterpy: run pip install filterpy scipy."
    ) from None

ALPHA = 0.2  # Nav2's defaults: variance of way and turn per m² and rad² of a step
COLUMNS = "time,x,y,heading,var_x,cov_xy,cov_x_heading,var_y,cov_y_heading,var_heading"


class Odometry(ExtendedKalmanFilter):
    """A pose (x, y, θ) that increments (forward, left, turn) move: turn first, then move."""

    def __init__(self, start: np.ndarray) -> None:
        super().__init__(dim_x=3, dim_z=3)
        self.x, self.P = np.array(start), np.zeros((3, 3))

    def predict_x(self, u: np.ndarray) -> None:
        """Move the pose by an increment; set the derivative F and the noise Q of the step."""
        forward, left, turn = u
        heading = self.x[2] + turn
        cosine, sine = math.cos(heading), math.sin(heading)
        dx, dy = forward * cosine - left * sine, forward * sine + left * cosine
        self.F = np.array([[1, 0, -dy], [0, 1, dx], [0, 0, 1]])
        of_noise = np.array([[cosine, -dy], [sine, dx], [0, 1]])  # by way and turn
        variance = ALPHA * (forward**2 + left**2 + turn**2)
        self.Q = variance * of_noise @ of_noise.T
        self.x = np.array([self.x[0] + dx, self.x[1] + dy, math.remainder(heading, math.tau)])


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit("usage: filterpy_odometry.py LOG REFERENCE.tum OUT.csv")
    played = LogEnv(log=sys.argv[1], reference=sys.argv[2], every="0.2m,5deg").log
    log = played.of_records(np.arange(played.referenced[0], len(played)))
    ekf, rows = Odometry(log.reference[0]), []
    for record, time in enumerate(log.times.tolist()):
        if record:
            ekf.predict(log.increments[record - 1])
        rows.append([time, *ekf.x.tolist(), *ekf.P[np.triu_indices(3)].tolist()])
    with open(sys.argv[3], "w", newline="") as file:
        csv.writer(file).writerows([COLUMNS.split(","), *rows])
