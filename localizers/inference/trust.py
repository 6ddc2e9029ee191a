"""P(not lost | recent scans), the quality of a belief: is the robot where the belief says it is?

A hidden Markov model of two states. While the belief is right, a scan has the density that the
belief predicts; while the robot is lost, that of a robot somewhere in free space. Both come from
the localizer's own scan model, so errors of that model cancel to first order.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from deqmcl_gym.maps import Map
from deqmcl_gym.numerics.types import Floats
from localizers.inference import weight_kernels
from localizers.inference.parts import Scan, States
from localizers.inference.weight_kernels import log_sum_exp
from localizers.models.prior import even_poses

LOST = 0.01  # probability of getting lost, per step
FOUND = 0.01  # probability of being found again, per step
MEMORY = 50  # scans kept: 1 / (LOST + FOUND)
POSES = 128  # that represent "somewhere in free space"


@dataclass(frozen=True)
class Anywhere:
    """p(o | lost): the density of a scan of a robot somewhere in free space.

    Attributes:
        scan: p(o | x, m), the localizer's own.
        poses: spread evenly over free space, (3, M).
    """

    scan: Scan
    poses: States

    def log_density(self, ranges: Floats) -> float:
        """Log-density of a scan (B,)."""
        likelihoods = self.scan.log_likelihood(self.poses, ranges)
        return log_sum_exp(likelihoods) - math.log(likelihoods.size)


@dataclass(frozen=True, eq=False)
class Evidence:
    """A scan, and how well the belief before it predicted it.

    Attributes:
        ranges: the scan, (B,).
        log_right: log Σ w p(o | x) over the belief before the scan; NaN if unknown.
        anywhere: p(o | lost).
    """

    ranges: Floats
    log_right: float
    anywhere: Anywhere

    @cached_property
    def log_ratio(self) -> float:
        """Log p(o | lost) - log p(o | belief); NaN if either is unknown or both are 0."""
        return self.anywhere.log_density(self.ranges) - self.log_right


class Trust(NamedTuple):
    """The evidence for and against a belief; evaluated only when ``quality`` is read.

    Attributes:
        anywhere: p(o | lost).
        scans: the latest, at most ``MEMORY``, oldest first.
        start: probability of not being lost before them.
    """

    anywhere: Anywhere
    scans: tuple[Evidence, ...] = ()
    start: float = 1.0 - LOST

    @classmethod
    def of(cls, scan: Scan, floor_plan: Map) -> "Trust":
        """Return the trust before the first scan, for a localizer whose scan model is ``scan``."""
        return cls(Anywhere(scan, even_poses(floor_plan, POSES)))

    def after(self, ranges: Floats, log_right: float) -> "Trust":
        """Return the trust after one more step; of scans no longer kept only the time counts.

        Args:
            ranges: the scan of the step, (B,); kept, not copied.
            log_right: log Σ w p(o | x) over the belief before the scan; NaN if unknown.
        """
        anywhere, scans, start = self
        if len(scans) == MEMORY:
            scans, start = scans[1:], start * (1.0 - LOST) + (1.0 - start) * FOUND
        return Trust(anywhere, (*scans, Evidence(ranges, log_right, anywhere)), start)

    @property
    def quality(self) -> float:
        """Probability of not being lost, in [0, 1].

        q⁻ = q (1 - LOST) + (1 - q) FOUND; then q ∝ q⁻ p(o | belief), 1 - q ∝ (1 - q⁻) p(o | lost).
        """
        ratios = np.array([evidence.log_ratio for evidence in self.scans])
        return weight_kernels.two_states(self.start, 1.0 - LOST, FOUND, ratios)
