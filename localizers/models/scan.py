"""p(o_t | x_t, m): how likely a lidar scan is at a pose, beam by beam."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.maps.casting import AllAtOnce
from deqmcl_gym.numerics.types import Bools, Floats, Singles
from localizers.models import scan_kernels
from localizers.models.beams import BeamDensity, CensoredGaussianUniform, GaussianUniform

OUTSIDE = -30.0  # log-likelihood of a whole scan at a pose outside the outer walls
_BLOCK = 1 << 16  # poses looked at in one go


@dataclass(frozen=True, kw_only=True)
class LidarScan:
    """Log p(o_t | x_t, m) = Σ over usable beams of log p(o | ô), ô by ray casting.

    A beam that is NaN, infinite or outside [0, max_range] is skipped; a scan without a usable beam
    says nothing. A pose outside the outer walls gets ``OUTSIDE`` for the whole scan.
    """

    floor_plan: Map
    lidar: Lidar
    beam: BeamDensity

    def log_likelihood(self, states: Singles, ranges: Floats) -> Floats:
        """Log-likelihood of the scan (B,) px at each pose (3, n), (n,)."""
        one_pass = self._one_pass
        if one_pass is not None:
            poses = np.ascontiguousarray(states, dtype=np.float32)
            log_likelihood = np.empty(poses.shape[1])
            if scan_kernels.scan_mixture(poses, ranges, log_likelihood, *one_pass):
                return log_likelihood
        return self._of_usable_beams(states, ranges)

    def _of_usable_beams(self, states: Singles, ranges: Floats) -> Floats:
        """Do it step by step: for any scan, beam model and floor plan."""
        max_range = self.lidar.max_range
        count = scan_kernels.count_usable(ranges, max_range)
        if count == 0:
            return np.zeros(states.shape[1])
        bearings, measured = self._bearings, ranges
        if count < ranges.size:
            usable = usable_beams(ranges, max_range)
            bearings, measured = bearings[usable], ranges[usable]
        expected = self.floor_plan.ranges(states.T, bearings)
        log_likelihood = self.beam.log_likelihood(measured, expected, max_range)
        scan_kernels.fill_where_nan(expected[:, 0], OUTSIDE, log_likelihood)
        return log_likelihood

    @cached_property
    def _bearings(self) -> Singles:
        return self.lidar.bearings.astype(np.float32)

    @cached_property
    def _one_pass(self) -> tuple[Any, ...] | None:
        """What ``scan_kernels.scan_mixture`` wants to know; None if the parts are not made for it.

        A subclass of a part may measure or weigh in another way.
        """
        beam, floor_plan, max_range = self.beam, self.floor_plan, self.lidar.max_range
        if not isinstance(floor_plan.caster, AllAtOnce):
            return None
        if type(beam) is not GaussianUniform and type(beam) is not CensoredGaussianUniform:
            return None
        mixture = beam.mixture(max_range)
        if mixture is None:
            return None
        return (self._bearings, tuple(floor_plan.caster.walls), max_range, *mixture, OUTSIDE)


class ScanTable:
    """``LidarScan`` at fixed poses, its ray casts made once."""

    def __init__(self, scan: LidarScan, states: Singles) -> None:
        """Cast the rays of poses (3, n)."""
        self._scan = scan
        self._expected = scan.floor_plan.ranges(states.T, scan.lidar.bearings).T  # (B, n)
        self._outside = np.isnan(self._expected[0])

    def log_likelihood(self, ranges: Floats) -> Floats:
        """Log-likelihood of the scan (B,) px at each pose, (n,)."""
        max_range = self._scan.lidar.max_range
        usable = usable_beams(ranges, max_range)
        log_likelihood = np.zeros(self._outside.size)
        if not usable.any():
            return log_likelihood
        for start in range(0, log_likelihood.size, _BLOCK):  # bounds the memory of a model's steps
            block = slice(start, start + _BLOCK)
            expected = np.ascontiguousarray(self._expected[usable, block])
            log_likelihood[block] = self._scan.beam.log_likelihood(
                ranges[usable], expected.T, max_range
            )
        log_likelihood[self._outside] = OUTSIDE
        return log_likelihood


def usable_beams(ranges: Floats, max_range: float) -> Bools:
    """Which beams are numbers in [0, max_range], (B,)."""
    usable = np.empty(len(ranges), np.bool_)
    scan_kernels.mark_usable(ranges, max_range, usable)
    return usable
