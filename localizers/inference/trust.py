"""P(not lost | recent scans), the quality of a belief: is the robot where the belief says it is?

A hidden Markov model of two states. While the belief is right, a scan has the density that the
belief predicts; while the robot is lost, that of a robot somewhere in free space. Both come from
the localizer's own scan model, so what is wrong with that model cancels to first order.
"""

import math
from typing import NamedTuple

import numpy as np

from deqmcl_gym.numerics.types import Floats
from localizers.inference import kernels
from localizers.inference.parts import Scan, States, made
from localizers.inference.weights import log_sum_exp

LOST = 0.01  # probability of getting lost, per step
FOUND = 0.01  # probability of being found again, per step
MEMORY = 50  # scans looked back at: 1 / (LOST + FOUND)
ANYWHERE = 128  # poses that stand for "somewhere in free space"


class Evidence:
    """A scan, and how well the belief before it predicted it.

    Attributes:
        ranges: the scan, (B,) px.
        log_right: log Σ w p(o | x) over the belief before the scan; NaN if unknown.
        before: the scan before it, in its block of ``MEMORY`` scans.
    """

    __slots__ = ("_log_ratio", "before", "log_right", "ranges")

    def __init__(self, ranges: Floats, log_right: float, before: "Evidence | None") -> None:
        """Keep it; nothing is computed yet."""
        self.ranges, self.log_right, self.before = ranges, log_right, before
        self._log_ratio: float | None = None

    def log_ratio(self, scan: Scan, anywhere: States) -> float:
        """Log p(o | lost) - log p(o | belief); NaN if nothing is known or both deny the scan.

        Computed once, so ``scan`` and ``anywhere`` must be those of ``Trust`` at every call.
        """
        if self._log_ratio is None:
            likelihoods = scan.log_likelihood(anywhere, self.ranges)
            lost = log_sum_exp(likelihoods) - math.log(likelihoods.size)
            self._log_ratio = lost - self.log_right
        return self._log_ratio


class Trust(NamedTuple):
    """The evidence for and against a belief; looked at only when somebody asks, and then once.

    Scans come in blocks of ``MEMORY``, each scan linked to the one before: what is kept is this
    block and the one before, and a step copies none of it.

    Attributes:
        scan: p(o | x, m), the localizer's own.
        anywhere: poses spread evenly over free space, (3, M).
        start: probability of not being lost before the scans remembered.
        size: how many scans this block has.
        newest: the last of this block.
        earlier: the last of the block before.
    """

    scan: Scan
    anywhere: States
    start: float = 1.0 - LOST
    size: int = 0
    newest: Evidence | None = None
    earlier: Evidence | None = None

    def after(self, ranges: Floats, log_right: float) -> "Trust":
        """Return the trust after one more step; of a scan that is forgotten, only time remains.

        Args:
            ranges: its scan, (B,) px; it is kept, not copied.
            log_right: log Σ w p(o | x) over the belief before the scan; NaN if unknown.
        """
        scan, anywhere, start, size, newest, earlier = self
        if size == MEMORY:
            size, newest, earlier = 0, None, newest
        if earlier is not None:  # one more is forgotten
            start = start * (1.0 - LOST) + (1.0 - start) * FOUND
        newest = Evidence(ranges, log_right, newest)
        return made(Trust, (scan, anywhere, start, size + 1, newest, earlier))

    @property
    def remembered(self) -> list[Evidence]:
        """The latest scans, at most ``MEMORY``, oldest first."""
        found: list[Evidence] = []
        for last in (self.newest, self.earlier):
            evidence = last
            while evidence is not None and len(found) < MEMORY:
                found.append(evidence)
                evidence = evidence.before
        return found[::-1]

    @property
    def quality(self) -> float:
        """Probability of not being lost, in [0, 1].

        q⁻ = q (1 - LOST) + (1 - q) FOUND; then q ∝ q⁻ p(o | belief), 1 - q ∝ (1 - q⁻) p(o | lost).
        """
        ratios = [evidence.log_ratio(self.scan, self.anywhere) for evidence in self.remembered]
        return kernels.two_states(self.start, 1.0 - LOST, FOUND, np.array(ratios))
