"""The exponent of a scan's likelihood, so that a coarse cloud survives a sharp sensor."""

from dataclasses import dataclass
from typing import Protocol

from deqmcl_gym.validation import number
from localizers.inference import kernels
from localizers.inference.parts import LogWeights


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
        return kernels.power_that_keeps(log_weights, log_likelihood, self.keep)
