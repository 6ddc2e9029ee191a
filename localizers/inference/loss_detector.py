"""P(not lost | recent scans), the quality of a belief: is the robot where the belief says it is?

A hidden Markov model of two states. While the belief is right, a scan has the density that the
belief predicts; while the robot is lost, that of a robot somewhere in free space. Both come from
the localizer's own scan model, so errors of that model cancel to first order.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np

from deqmcl_gym.maps import Map
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import exp64
from deqmcl_gym.numerics.types import Floats
from localizers.inference.particles import Memory, States, log_sum_exp
from localizers.models.prior import even_poses
from localizers.models.scan import LidarScan, Scan, ScanModel, ScanTable

LOST = 0.01  # probability of getting lost, per step
FOUND_AGAIN = 0.01  # probability of being found again, per step
MEMORY = 50  # scans kept: 1 / (LOST + FOUND_AGAIN)
ANYWHERE = 128  # that represent "somewhere in free space"


@compiled
def _two_states(start: float, stay: float, enter: float, log_ratios: Floats) -> float:
    """Probability of the first of two states after observations, by the forward recursion.

    Args:
        start: its probability before them.
        stay, enter: probabilities of staying in it and of entering it, before each observation.
        log_ratios: log p(o | second) - log p(o | first); NaN is no information.
    """
    first = start
    for i in range(log_ratios.size):
        first = first * stay + (1.0 - first) * enter
        ratio = log_ratios[i]
        if ratio > 0.0:
            likely = first * exp64(-ratio)
            first = likely / (likely + (1.0 - first))
        elif ratio <= 0.0:
            first = first / (first + (1.0 - first) * exp64(ratio))
    return first


@dataclass(frozen=True)
class LostDensity:
    """p(o | lost): the density of a scan of a robot somewhere in free space.

    Attributes:
        model: p(o | x, m), the localizer's own.
        poses: spread evenly over free space, (3, M).
    """

    model: ScanModel
    poses: States

    def log_density(self, scan: Scan) -> float:
        """Log-density of a scan."""
        likelihoods = self._log_likelihood(scan)
        return log_sum_exp(likelihoods) - math.log(likelihoods.size)

    @cached_property
    def _log_likelihood(self) -> Callable[[Scan], Floats]:
        """Log-likelihood at the poses; a lidar's rays are cast once, as they never move."""
        if isinstance(self.model, LidarScan):
            return ScanTable(self.model, self.poses).log_likelihood
        return partial(self.model.log_likelihood, self.poses)


@dataclass(frozen=True, eq=False)
class ScanEvidence:
    """A scan, and how well the belief before it predicted it.

    Attributes:
        scan: o.
        log_right: log Σ w p(o | x) over the belief before the scan; NaN if unknown.
        lost: p(o | lost).
    """

    scan: Scan
    log_right: float
    lost: LostDensity

    @cached_property
    def log_ratio(self) -> float:
        """Log p(o | lost) - log p(o | belief); NaN if either is unknown or both are 0."""
        return self.lost.log_density(self.scan) - self.log_right


@dataclass(frozen=True)
class LossDetector(Memory):
    """The evidence for and against a belief; evaluated only when ``quality`` is read.

    Attributes:
        lost: p(o | lost).
        evidence: the latest scans, at most ``MEMORY``, oldest first.
        start: probability of not being lost before them.
        known: log-ratios of the first of them, as far as an earlier detector was read.
    """

    lost: LostDensity
    evidence: tuple[ScanEvidence, ...] = ()
    start: float = 1.0 - LOST
    known: Floats = field(default_factory=partial(np.empty, 0))

    @classmethod
    def of(cls, model: ScanModel, floor_plan: Map) -> "LossDetector":
        """Return the detector before the first scan, for a localizer with this scan model."""
        return cls(LostDensity(model, even_poses(floor_plan, ANYWHERE)))

    def scanned(self, scan: Scan, log_evidence: float) -> "LossDetector":
        """Return the detector after one more step; of scans no longer kept only the time counts.

        Args:
            scan: of the step; kept, not copied.
            log_evidence: log Σ w p(o | x) over the belief before the scan; NaN if unknown.
        """
        evidence, start = self.evidence, self.start
        known = vars(self).get("_ratios", self.known)
        if len(evidence) == MEMORY:
            evidence, start = evidence[1:], start * (1.0 - LOST) + (1.0 - start) * FOUND_AGAIN
            known = known[1:]
        latest = ScanEvidence(scan, log_evidence, self.lost)
        return LossDetector(self.lost, (*evidence, latest), start, known)

    @property
    def log_right(self) -> float:
        """Log Σ w p(o | x) of the latest scan; NaN before the first."""
        return self.evidence[-1].log_right if self.evidence else math.nan

    @property
    def quality(self) -> float:
        """Probability of not being lost, in [0, 1].

        q⁻ = q (1 - LOST) + (1 - q) FOUND_AGAIN, then q ∝ q⁻ p(o | belief) and
        1 - q ∝ (1 - q⁻) p(o | lost).
        """
        return _two_states(self.start, 1.0 - LOST, FOUND_AGAIN, self._ratios)

    @cached_property
    def _ratios(self) -> Floats:
        ratios, read = np.empty(len(self.evidence)), self.known.size
        ratios[:read] = self.known
        for i in range(read, len(self.evidence)):
            ratios[i] = self.evidence[i].log_ratio
        return ratios
