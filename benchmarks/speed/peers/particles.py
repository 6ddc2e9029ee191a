"""MCL by ``particles`` (Chopin & Papaspiliopoulos): a Feynman-Kac model and its SMC loop."""

from collections.abc import Callable

import numpy as np
import particles as library

from benchmarks.speed.numpy_baseline import Cloud, NumpyModels
from deqmcl_gym.numerics.types import Reals
from localizers import Prior, RobotModel

_FOR_EVER = 10**9


class _Localization(library.FeynmanKac):
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


def mcl(
    robot: RobotModel, particles: int, prior: Prior, rng: np.random.Generator
) -> Callable[..., Cloud]:
    """Return ``update`` of MCL."""
    model = _Localization(NumpyModels(robot), prior, rng)
    smc = library.SMC(fk=model, N=particles, resampling="systematic", ESSrmin=2.0, collect="off")
    next(smc)

    def update(scan: Reals, action: Reals, *_: object) -> Cloud:
        model.action, model.scan = action, scan
        next(smc)
        return smc.X, smc.W

    return update
