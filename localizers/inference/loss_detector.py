"""Is the robot where the belief says it is? P(not lost | scans), and averages to recover by.

A hidden Markov model of two states. While the belief is right, a scan has the density that the
belief predicts; while the robot is lost, that of a robot somewhere in free space. Both come from
the localizer's own scan model, so errors of that model cancel to first order.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Self

import numpy as np

from deqmcl_gym.maps import Map
from deqmcl_gym.numerics import Floats, arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import exp64
from deqmcl_gym.validation import number
from localizers.inference.particles import Actions, log_sum_exp
from localizers.models.prior import even_poses
from localizers.models.scan import LidarScan, Scan, ScanModel

LOST = 0.01  # probability of getting lost, per step
FOUND_AGAIN = 0.01  # probability of being found again, per step
MEMORY = 50  # scans kept: 1 / (LOST + FOUND_AGAIN)


@compiled
def _two_states(start: float, log_ratios: Floats) -> float:
    """P(first of two states) by log p(o | second) - log p(o | first); NaN is no information."""
    first = start
    for i in range(log_ratios.size):
        first = first * (1.0 - LOST) + (1.0 - first) * FOUND_AGAIN
        ratio = log_ratios[i]
        if ratio > 0.0:
            likely = first * exp64(-ratio)
            first = likely / (likely + (1.0 - first))
        elif ratio <= 0.0:
            first = first / (first + (1.0 - first) * exp64(ratio))
    return first


@dataclass(frozen=True)
class LossDetector:
    """The evidence for and against a belief."""

    # log p(o | x) at poses spread over free space, (M,), whose mean is p(o | lost)
    anywhere: Callable[[Scan], Floats]
    # log p(o | lost) - log p(o | belief) of the latest ``MEMORY`` scans, oldest first; NaN if
    # either is unknown or both are 0
    log_ratios: Floats = field(default_factory=partial(np.empty, 0))
    start: float = 1.0 - LOST  # probability of not being lost before them
    log_right: float = math.nan  # log Σ w p(o | x) of the latest; NaN before the first

    @classmethod
    def of(cls, model: ScanModel, floor_plan: Map) -> "LossDetector":
        """Return the detector before the first scan, for a localizer with this scan model."""
        poses = even_poses(floor_plan, 128)
        if isinstance(model, LidarScan):
            return cls(model.at(poses))
        return cls(partial(model.log_likelihood, poses))

    def scanned(self, scan: Scan, log_evidence: float) -> "LossDetector":
        """Return the detector after one more step; of scans no longer kept only the time counts."""
        log_ratios, start = self.log_ratios, self.start
        if log_ratios.size == MEMORY:
            log_ratios, start = log_ratios[1:], start * (1.0 - LOST) + (1.0 - start) * FOUND_AGAIN
        likelihoods = self.anywhere(scan)
        ratio = log_sum_exp(likelihoods) - math.log(likelihoods.size) - log_evidence
        return LossDetector(self.anywhere, np.append(log_ratios, ratio), start, log_evidence)

    @property
    def quality(self) -> float:
        """Probability of not being lost, in [0, 1].

        q⁻ = q (1 - LOST) + (1 - q) FOUND_AGAIN, then q ∝ q⁻ p(o | belief) and
        1 - q ∝ (1 - q⁻) p(o | lost).
        """
        return _two_states(self.start, self.log_ratios)


@dataclass(frozen=True, kw_only=True)
class Averages:
    """w_slow and w_fast: max(0, 1 - w_fast / w_slow) of the draws are random poses.

    Exponential averages of how likely the scans were (Thrun et al. 2005, table 8.3).
    """

    alpha_slow: float = 0.0  # rate in [0, 1], per scan
    alpha_fast: float = 0.0  # likewise, alpha_slow or more
    slow: float = 0.0  # w_slow; 0 before the first scan
    fast: float = 0.0  # w_fast, likewise

    def __post_init__(self) -> None:
        number("recovery_alpha_slow", self.alpha_slow, low=0, high=1)
        what = "recovery_alpha_fast (at least recovery_alpha_slow)"
        number(what, self.alpha_fast, low=self.alpha_slow, high=1)

    @property
    def share(self) -> float:
        """Probability that a draw is a random pose."""
        return max(0.0, 1.0 - self.fast / self.slow) if self.slow > 0 else 0.0

    def towards(self, likelihood: float, at_least: float) -> Self:
        """Return the averages after a scan, their rates at least so much: 1 begins anew."""
        slow, fast = max(self.alpha_slow, at_least), max(self.alpha_fast, at_least)
        return replace(
            self,
            slow=self.slow + slow * (likelihood - self.slow),
            fast=self.fast + fast * (likelihood - self.fast),
        )


@dataclass(frozen=True, kw_only=True)
class Recovery(Averages):
    """``Averages`` that are plain means over the first 1 / α scans: the first soon counts little.

    With both rates 0 there are no random poses.
    """

    scans: int = 0

    def after(self, log_evidence: float, beams: int) -> "Recovery":
        """Return the averages after a scan; no beam, or evidence that is NaN, changes nothing.

        The likelihood averaged is that of one beam, the geometric mean, as beams may be lost.
        """
        if beams == 0 or math.isnan(log_evidence) or self.alpha_fast == 0:
            return self
        # exp of x ≤ 0 only: 1 / exp(-x) where a beam's density is above 1
        log_beam = log_evidence / beams
        size = float(arrays.exp(-abs(log_beam)))
        likelihood = size if log_beam <= 0 else 1.0 / size
        scans = self.scans + 1
        return replace(self.towards(likelihood, 1 / scans), scans=scans)


@dataclass(frozen=True)
class Watch:
    """What an injection remembers of scans and plans."""

    recovery: Recovery
    plan: Actions
    news: int = 0  # for how many more steps, this one included, the route counts as new

    def scanned(self, scan: Scan, log_evidence: float) -> "Watch":
        """Return the same with the averages after a scan."""
        return replace(self, recovery=self.recovery.after(log_evidence, scan.beams))
