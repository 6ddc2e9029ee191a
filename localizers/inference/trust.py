"""P(not lost | o_{1:t}), the quality of a belief: is the robot where the belief says it is?

A hidden Markov model of two states. While the belief is right, a scan has the density that the
belief predicts; while the robot is lost, that of a robot somewhere in free space. Both come from
the localizer's own scan model, so what is wrong with that model cancels to first order.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics import arrays
from localizers.inference.parts import Scan, States
from localizers.inference.weights import log_sum_exp

LOST = 0.01  # probability of getting lost, per step
FOUND = 0.01  # probability of being found again, per step
ANYWHERE = 128  # poses that stand for "somewhere in free space"
_PENDING = 32  # scans kept until somebody asks


@dataclass(frozen=True)
class Trust:
    """Evidence for and against a belief, looked at when it is asked for.

    Attributes:
        scan: p(o | x, m), the localizer's own.
        anywhere: poses spread evenly over free space, (3, M).
        start: probability of not being lost before the pending scans.
        pending: scans not yet looked at: (ranges (B,) px, log p(o | belief before it)).
    """

    scan: Scan
    anywhere: States
    start: float = 1.0 - LOST
    pending: tuple[tuple[NDArray[np.float64], float], ...] = ()

    def after(self, ranges: NDArray[np.float64], log_evidence: float) -> "Trust":
        """Return the trust after one more step.

        Args:
            ranges: its scan, (B,) px.
            log_evidence: log Σ w p(o | x) over the belief before the scan; NaN if unknown.
        """
        newest = (ranges.copy(), log_evidence)
        if "quality" in self.__dict__ or len(self.pending) == _PENDING:
            return replace(self, start=self.quality, pending=(newest,))
        return replace(self, pending=(*self.pending, newest))

    @cached_property
    def quality(self) -> float:
        """Probability of not being lost, in [0, 1].

        q⁻ = q (1 - LOST) + (1 - q) FOUND; then q ∝ q⁻ p(o | belief), 1 - q ∝ (1 - q⁻) p(o | lost).
        """
        quality = self.start
        for ranges, log_right in self.pending:
            quality = quality * (1.0 - LOST) + (1.0 - quality) * FOUND
            likelihoods = self.scan.log_likelihood(self.anywhere, ranges)
            apart = log_sum_exp(likelihoods) - float(arrays.log(likelihoods.size)) - log_right
            if np.isnan(apart):  # nothing is known of the scan, or both deny it
                continue
            less = float(arrays.exp(-abs(apart)))
            right, lost = (1.0, less) if apart < 0 else (less, 1.0)
            quality = quality * right / (quality * right + (1.0 - quality) * lost)
        return quality
