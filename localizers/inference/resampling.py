"""When to resample (always, or by effective sample size) and how (systematic, …).

A scan's likelihood may be tempered before, so that a coarse cloud survives a sharp sensor.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from deqmcl_gym.numerics.types import Floats, Indices
from deqmcl_gym.validation import number, one_of
from localizers.inference import weight_kernels
from localizers.inference.belief import ParticleBelief
from localizers.inference.parts import LogWeights, Weights
from localizers.inference.weight_kernels import effective_sample_size


class Tempering(Protocol):
    """The exponent λ of p(o_t | x_t, m)."""

    def __call__(self, log_weights: LogWeights, log_likelihood: LogWeights) -> float:
        """Return λ in [0, 1], given the weights before the scan, (n,), and its likelihoods."""
        ...


@dataclass(frozen=True)
class Untempered:
    """λ = 1: Bayes' rule."""

    def __call__(self, log_weights: LogWeights, log_likelihood: LogWeights) -> float:
        """Return 1."""
        return 1.0


@dataclass(frozen=True)
class KeepsSampleSize:
    """λ_t, the largest in [0, 1] that leaves ``keep`` of the effective sample size.

    In a cloud spread over a building no particle is close enough to explain many sharp beams, and
    the least wrong one would take all the weight. λ grows as the cloud contracts. It depends on
    the cloud, so the filter is exact only at ``keep`` = 0.

    Attributes:
        keep: κ in [0, 1].
    """

    keep: float

    def __post_init__(self) -> None:
        number("scan_keep", self.keep, low=0, high=1)

    def __call__(self, log_weights: LogWeights, log_likelihood: LogWeights) -> float:
        """Return λ; 1 if no particle explains the scan."""
        return weight_kernels.power_that_keeps(log_weights, log_likelihood, self.keep)


Scheme = Callable[[Weights, np.random.Generator], Indices]
Selection = Callable[[ParticleBelief], LogWeights]


def systematic(weights: Weights, rng: np.random.Generator) -> Indices:
    """One uniform offset for n equidistant pointers: each particle ⌊n w⌋ or ⌈n w⌉ times.

    Thrun et al. 2005, table 4.4 ("low variance sampler"); Kitagawa 1996.
    """
    chosen = np.empty(weights.size, np.intp)
    weight_kernels.systematic(weights, rng.random(), chosen)
    return chosen


def stratified(weights: Weights, rng: np.random.Generator) -> Indices:
    """One uniform pointer in each of n equal strata (Kitagawa 1996)."""
    pointers = np.empty(weights.size)
    weight_kernels.strata(rng.random(weights.size), pointers)
    return _pointed_at(weights, pointers)


def multinomial(weights: Weights, rng: np.random.Generator) -> Indices:
    """N independent draws by weight (Gordon, Salmond & Smith 1993)."""
    return _pointed_at(weights, np.sort(rng.random(weights.size)))


SCHEMES: dict[str, Scheme] = {
    "systematic": systematic,
    "stratified": stratified,
    "multinomial": multinomial,
}


@dataclass(frozen=True)
class Always:
    """Resample at every step, as the paper does."""

    scheme: Scheme = systematic

    def ancestors(self, weights: Weights, rng: np.random.Generator) -> Indices | None:
        """Return the particles to keep, (n,)."""
        return self.scheme(weights, rng)


@dataclass(frozen=True)
class WhenDegenerate:
    """Resample when the effective sample size falls below ``threshold`` times n.

    The random numbers are drawn whether or not it triggers, so that runs stay comparable.
    """

    threshold: float
    scheme: Scheme = systematic

    def ancestors(self, weights: Weights, rng: np.random.Generator) -> Indices | None:
        """Return the particles to keep, (n,), or None to keep all with their weights."""
        chosen = self.scheme(weights, rng)
        degenerate = effective_sample_size(weights) < self.threshold * weights.size
        return chosen if degenerate else None


def by_own_weight(belief: ParticleBelief) -> LogWeights:
    """Resample by w: the look-ahead stays out of the filter."""
    return belief.log_weights


def by_reported_weight(belief: ParticleBelief) -> LogWeights:
    """Resample by w h_t(x_t); the particles kept carry on with w = 1 / h_t(x_t).

    Beside the new evidence, the next resampling thus sees log h_{t+1}(x_{t+1}) - log h_t(x_t): a
    twisted particle filter (Whiteley & Lee 2014).
    """
    return belief.reported_log_weights


def resampling(resampler: str, ess_threshold: float | None) -> Always | WhenDegenerate:
    """Return the strategy of these two parameters; ``ess_threshold`` None means always."""
    scheme = SCHEMES[one_of("resampler", resampler, SCHEMES)]
    if ess_threshold is None:
        return Always(scheme)
    return WhenDegenerate(number("ess_threshold", ess_threshold, low=0, high=1), scheme)


def _pointed_at(weights: Floats, pointers: Floats) -> Indices:
    chosen = np.empty(weights.size, np.intp)
    weight_kernels.pointed_at(weights, pointers, chosen)
    return chosen
