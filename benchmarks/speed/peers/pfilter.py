"""MCL by ``pfilter`` (Williamson): functions for dynamics, observation and weight."""

from typing import Any

import numpy as np
from pfilter import ParticleFilter, systematic_resample

from benchmarks.speed.numpy_baseline import Cloud, NumpyModels
from deqmcl_gym.numerics.types import Reals
from localizers import Prior, RobotModel


class PfilterMCL:
    """MCL; systematic resampling at every step."""

    def __init__(self, robot: RobotModel, *, particles: int) -> None:
        """Make MCL for a robot."""
        self._models, self._particles = NumpyModels(robot), particles

    def reset(self, prior: Prior, plan: Reals, rng: np.random.Generator) -> Cloud:
        """Start anew."""
        del plan
        models = self._models

        def dynamics(particles: Reals, *, action: Reals, **_: Any) -> Reals:
            return models.moved(particles.T, action, rng).T

        def weight(particles: Reals, scan: Reals, **_: Any) -> Reals:
            log_likelihood = models.log_likelihood(particles.T, scan[0])
            relative: Reals = np.exp(log_likelihood - log_likelihood.max())
            return relative

        self._filter = ParticleFilter(
            prior_fn=lambda n: prior.sample(n, rng).astype(np.float32),
            n_particles=self._particles,
            observe_fn=lambda particles, **_: particles,
            dynamics_fn=dynamics,
            noise_fn=lambda particles, **_: particles,
            weight_fn=weight,
            resample_fn=systematic_resample,
            n_eff_threshold=2.0,
        )
        return self._belief()

    def update(self, ranges: Reals, action: Reals, plan: Reals) -> Cloud:
        """Go one step on."""
        del plan
        with np.errstate(divide="ignore", invalid="ignore"):  # its entropy of weights that are 0
            self._filter.update(ranges, action=action)
        return self._belief()

    def _belief(self) -> Cloud:
        return Cloud(self._filter.original_particles, self._filter.original_weights)
