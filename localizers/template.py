"""Monte-Carlo localization in NumPy: a starting point for your own localizer."""

import numpy as np

from localizers import Belief, PointsBelief, Prior, RobotModel
from localizers.models.scan import Scan


class MyLocalizer:
    """Moves a cloud of poses by the commands, weights it by the scans, resamples it."""

    def __init__(self, robot: RobotModel, *, particles: int = 500) -> None:
        self.robot, self.particles = robot, particles
        self.scan = robot.scan_model()

    def reset(self, prior: Prior, plan: np.ndarray, rng: np.random.Generator) -> Belief:
        """Draw the cloud from what is known of the start."""
        self.rng = rng  # the only randomness
        self.cloud = prior.sample(self.particles, rng).T.astype(np.float32)  # rows x, y, heading
        return PointsBelief(self.cloud.T)

    def update(self, ranges: np.ndarray, action: np.ndarray, plan: np.ndarray) -> Belief:
        """Advance one step: ``action`` was carried out, then ``ranges`` were measured."""
        self.cloud = self.robot.motion.sample(self.cloud, action, self.rng)
        log_likelihood = self._log_likelihood(ranges)
        weights = np.exp(log_likelihood - log_likelihood.max())
        belief = PointsBelief(self.cloud.T, weights)
        chosen = self.rng.choice(self.particles, self.particles, p=weights / weights.sum())
        self.cloud = self.cloud[:, chosen]
        return belief

    def _log_likelihood(self, ranges: np.ndarray) -> np.ndarray:
        """Log p(ranges | pose, map) of each pose; beams out of range are skipped."""
        scan = Scan.of(ranges, self.robot.lidar.max_range)
        found = self.scan.log_likelihood(self.cloud, scan)
        return np.maximum(found, -1e6)  # no pose is impossible
