"""p(o_t | x_t, m): how likely a lidar scan is at a pose, beam by beam."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol, final, runtime_checkable

import numpy as np

from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.numerics import Bools, Floats, Singles, arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.validation import InputError
from localizers.models.beams import BeamDensity


@compiled
def _mark_usable(ranges: Floats, max_range: float, out: Bools) -> int:
    """Fill in which ranges are usable; return how many are."""
    count = 0
    for i in range(ranges.size):
        out[i] = 0.0 <= ranges[i] <= max_range  # false for NaN
        count += out[i]
    return count


class Scan(NamedTuple):
    """A scan o_t, (B,): which beams are ``usable``, numbers in [0, max_range], and how many."""

    ranges: Floats
    usable: Bools
    beams: int

    @classmethod
    def of(cls, ranges: Floats, max_range: float) -> "Scan":
        """Return a scan; the ranges (B,) are kept, not copied."""
        usable = np.empty(ranges.size, np.bool_)
        return cls(ranges, usable, _mark_usable(ranges, max_range, usable))

    def without(self, left_out: Bools) -> "Scan":
        """Return this scan with no measurement by the beams left out, (B,)."""
        usable = self.usable & ~left_out
        return Scan(np.where(left_out, np.nan, self.ranges), usable, int(usable.sum()))


class ScanModel(Protocol):
    """p(o_t | x_t, m)."""

    def log_likelihood(self, states: Singles, scan: Scan) -> Floats:
        """Log-likelihood of a scan at each of n poses, (n,), finite or -inf, up to a constant.

        Poses are rows x, y (in the map's unit), θ (rad), float32, (3, n): any, also in a wall or
        off the map. They and the scan's ranges, (B,), in the map's unit, are not to be written to.
        The constant is the same for all poses and scans.
        """


@runtime_checkable
class ScanSource(Protocol):
    """What makes a scan model for a map and a lidar."""

    def made(self, floor_plan: Map, lidar: Lidar) -> ScanModel:
        """Return the model of scans by this lidar on this map."""


@compiled
def fill_where_nan(marks: Singles, value: float, out: Floats) -> None:
    """Overwrite ``out`` by ``value`` where ``marks`` is NaN, (n,)."""
    for i in range(out.size):
        out[i] = value if np.isnan(marks[i]) else out[i]


OUTSIDE = -30.0
_BLOCK = 8192  # poses per block: their exact ranges fit the processor's cache
_VERBS = ("log_likelihood", "least_density")


@final
@dataclass(frozen=True, kw_only=True)
class LidarScan:
    """Log p(o_t | x_t, m) = Σ over usable beams of log p(o | ô), ô by ray casting.

    A beam that is NaN, infinite or outside [0, max_range] is skipped; a scan without a usable beam
    has log-likelihood 0. Rays start at the lidar's mounts; if a beam of one that is outside the
    outer wall is used, each counts -30 or less.
    """

    floor_plan: Map
    lidar: Lidar
    beam: BeamDensity

    def __post_init__(self) -> None:
        lacking = [verb for verb in _VERBS if not callable(getattr(self.beam, verb, None))]
        if lacking:
            raise InputError(
                f"the beam model is of type {type(self.beam).__name__}, without "
                f"{' and '.join(lacking)}: a beam model has log_likelihood(ranges, expected, "
                "max_range) and least_density(max_range)."
            )

    def log_likelihood(self, states: Singles, scan: Scan) -> Floats:
        """Log-likelihood of a scan at each pose (3, n), (n,)."""
        n = states.shape[1]
        if n > _BLOCK:
            blocks = [states[:, start : start + _BLOCK] for start in range(0, n, _BLOCK)]
            return np.concatenate([self.log_likelihood(block, scan) for block in blocks])
        if scan.beams == 0:
            return np.zeros(n)
        return self.weighed(*self.compared(states, scan))

    def compared(self, states: Singles, scan: Scan) -> tuple[Floats, Singles]:
        """Usable ranges, (B,), and the exact ones at each pose (3, n), NaN outside, (B, n)."""
        measured, used = scan.ranges, None
        if scan.beams < measured.size:
            measured, used = measured[scan.usable], scan.usable
        expected = np.empty((measured.size, states.shape[1]), np.float32)
        self.lidar.cast(self.floor_plan.cast, states, expected, used)
        if len(self.lidar.places) > 1:
            _leave_out(expected)
        return measured, expected

    def weighed(self, measured: Floats, expected: Singles) -> Floats:
        """Log-likelihood of usable ranges (B,), one or more, given the exact ones, (B, n), (n,)."""
        n = expected.shape[1]
        if n > _BLOCK:
            blocks = [expected[:, start : start + _BLOCK].copy() for start in range(0, n, _BLOCK)]
            return np.concatenate([self.weighed(measured, block) for block in blocks])
        out = self.beam.log_likelihood(measured, expected.T, self.lidar.max_range)
        fill_where_nan(expected[0], measured.size * self._outside, out)
        return out

    @cached_property
    def _outside(self) -> float:
        return log_outside(self.beam, self.lidar.max_range)


def log_outside(beam: BeamDensity, max_range: float) -> float:
    """Least of -30 and of a beam's log-density: no scan is likelier outside than inside."""
    return min(OUTSIDE, float(arrays.log(beam.least_density(max_range))))


def _leave_out(expected: Singles) -> None:
    """Mark a pose as outside, NaN in all of ``expected`` (b, n), if one of several mounts is."""
    expected[:, np.isnan(expected).any(axis=0)] = np.nan


class ScanTable:
    """``LidarScan`` at fixed poses, with the rays cast once."""

    def __init__(self, scan: LidarScan, states: Singles) -> None:
        """Cast the rays of poses (3, n)."""
        self._scan = scan
        self._expected = scan.lidar.ranges(scan.floor_plan, states).T  # (B, n)
        if len(scan.lidar.places) > 1:
            _leave_out(self._expected)

    def log_likelihood(self, scan: Scan) -> Floats:
        """Log-likelihood of a scan at each pose, (n,)."""
        if scan.beams == 0:
            return np.zeros(self._expected.shape[1])
        measured, expected = scan.ranges, self._expected
        if scan.beams < measured.size:
            measured, expected = measured[scan.usable], expected[scan.usable]
        return self._scan.weighed(measured, expected)
