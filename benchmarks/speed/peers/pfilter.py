"""MCL by ``pfilter`` (Williamson): functions for dynamics, observation and weight."""

from collections.abc import Callable
from typing import Any

import numpy as np
from pfilter import ParticleFilter, systematic_resample

from benchmarks.speed.numpy_baseline import Cloud, NumpyModels
from deqmcl_gym.numerics.types import Reals
from localizers import Prior, RobotModel


def mcl(
    robot: RobotModel, particles: int, prior: Prior, rng: np.random.Generator
) -> Callable[..., Cloud]:
    """Return ``update`` of MCL."""
    models = NumpyModels(robot)

    def dynamics(particles: Reals, *, action: Reals, **_: Any) -> Reals:
        return models.moved(particles.T, action, rng).T

    def weight(particles: Reals, scan: Reals, **_: Any) -> Reals:
        log_likelihood = models.log_likelihood(particles.T, scan[0])
        relative: Reals = np.exp(log_likelihood - log_likelihood.max())
        return relative

    filtering = ParticleFilter(
        prior_fn=lambda n: prior.sample(n, rng).astype(np.float32),
        n_particles=particles,
        observe_fn=lambda particles, **_: particles,
        dynamics_fn=dynamics,
        noise_fn=lambda particles, **_: particles,
        weight_fn=weight,
        resample_fn=systematic_resample,
        n_eff_threshold=2.0,
    )

    def update(scan: Reals, action: Reals, *_: object) -> Cloud:
        with np.errstate(divide="ignore", invalid="ignore"):  # its entropy of weights that are 0
            filtering.update(scan, action=action)
        return filtering.original_particles, filtering.original_weights

    return update
