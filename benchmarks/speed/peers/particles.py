"""MCL by ``particles`` (Chopin & Papaspiliopoulos): a Feynman-Kac model and its SMC loop."""

import numpy as np
import particles

from benchmarks.speed.numpy_baseline import Cloud, NumpyModels
from deqmcl_gym.numerics.types import Reals
from localizers import Prior, RobotModel

_FOR_EVER = 10**9


class _Localization(particles.FeynmanKac):
    """The bootstrap filter's model, told action and scan before each step."""

    def __init__(self, models: NumpyModels, prior: Prior, rng: np.random.Generator) -> None:
        super().__init__(_FOR_EVER)
        self.models, self.prior, self.rng = models, prior, rng
        self.action: Reals = np.zeros(2)
        self.scan: Reals | None = None

    def M0(self, N: int) -> Reals:  # noqa: N802, N803 (the names are the library's)
        return self.prior.sample(N, self.rng).astype(np.float32)

    def M(self, t: int, xp: Reals) -> Reals:  # noqa: N802
        return self.models.moved(xp.T, self.action, self.rng).T

    def logG(self, t: int, xp: Reals, x: Reals) -> Reals:  # noqa: N802
        if self.scan is None:
            return np.zeros(len(x))
        return self.models.log_likelihood(x.T, self.scan)


class ParticlesMCL:
    """MCL; systematic resampling at every step."""

    def __init__(self, robot: RobotModel, *, particles: int) -> None:
        """Make MCL for a robot."""
        self._models, self._particles = NumpyModels(robot), particles

    def reset(self, prior: Prior, plan: Reals, rng: np.random.Generator) -> Cloud:
        """Start anew."""
        del plan
        self._model = _Localization(self._models, prior, rng)
        self._smc = particles.SMC(
            fk=self._model, N=self._particles, resampling="systematic", ESSrmin=2.0, collect="off"
        )
        next(self._smc)
        return self._belief()

    def update(self, ranges: Reals, action: Reals, plan: Reals) -> Cloud:
        """Go one step on."""
        del plan
        self._model.action, self._model.scan = action, ranges
        next(self._smc)
        return self._belief()

    def _belief(self) -> Cloud:
        return Cloud(self._smc.X, self._smc.W)
