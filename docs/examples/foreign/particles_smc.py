"""
A filter of another library: a particle filter of particles
===========================================================

``SMC`` of `particles <https://github.com/nchopin/particles>`_ (Chopin) as a localizer: a
Feynman-Kac model of the robot's motion and scans, resampled systematically below half of the
effective sample size. Run it beside others with
``deqmcl sweep ranking --with docs/examples/foreign/particles_smc.py:Smc``.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from deqmcl_gym.validation import InputError
from localizers import Belief, PointsBelief, Prior, RobotModel
from localizers.models.scan import Scan

try:
    from particles import SMC, FeynmanKac
except ModuleNotFoundError:
    raise InputError(
        "particles_smc.py needs particles: run pip install scipy joblib, then pip install "
        "--no-deps particles, which asks for NumPy below 2, but runs with 2.4."
    ) from None


class Localization(FeynmanKac):
    """Poses as rows (n, 3): M0 is the prior, M the assumed motion, G the likelihood of a scan."""

    def __init__(self, robot: RobotModel, prior: Prior, rng: np.random.Generator) -> None:
        super().__init__(T=math.inf)
        self.robot, self.prior, self.rng = robot, prior, rng
        self.scan = robot.scan_model()
        self.ranges = self.action = None

    def M0(self, N: int) -> np.ndarray:  # noqa: N802, N803 - named by particles
        return self.prior.sample(N, self.rng).astype(np.float32)

    def M(self, t: int, xp: np.ndarray) -> np.ndarray:  # noqa: N802
        states = np.ascontiguousarray(xp.T, dtype=np.float32)
        return self.robot.motion.sample(states, self.action, self.rng).T

    def logG(self, t: int, xp: np.ndarray, x: np.ndarray) -> np.ndarray:  # noqa: N802
        """Log p(ranges | pose, map); there is no scan before the first step."""
        if self.ranges is None:
            return np.zeros(len(x))
        scan = Scan.of(self.ranges, self.robot.lidar.max_range)
        found = self.scan.log_likelihood(np.ascontiguousarray(x.T), scan)
        return np.maximum(found, -1e6)  # no pose is impossible


class Smc:
    """The bootstrap filter of particles.

    Args:
        robot: the map, the lidar and the assumed noise.
        particles: how many there are.
    """

    def __init__(self, robot: RobotModel, *, particles: int = 500) -> None:
        self.robot, self.particles = robot, particles

    def reset(self, prior: Prior, plan: np.ndarray, rng: np.random.Generator) -> Belief:
        """Draw the cloud from what is known of the start."""
        self.model = Localization(self.robot, prior, rng)
        self.smc = SMC(fk=self.model, N=self.particles, collect="off")
        return self._next()

    def update(self, ranges: np.ndarray, action: np.ndarray, plan: np.ndarray) -> Belief:
        """Resample, move and weight the cloud."""
        self.model.ranges, self.model.action = ranges, action
        belief = self._next()
        self.model.ranges = self.model.action = None  # the caller's
        return belief

    def _next(self) -> Belief:
        with numpy_seeded(self.model.rng):
            next(self.smc)
        return PointsBelief(self.smc.X, self.smc.W)


@contextmanager
def numpy_seeded(rng: np.random.Generator) -> Iterator[None]:
    """Seed NumPy's global generator, from which particles resamples; leave it as it was."""
    before = np.random.get_state()  # noqa: NPY002
    np.random.seed(rng.integers(2**32, dtype=np.uint32))  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(before)  # noqa: NPY002
