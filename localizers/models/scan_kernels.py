"""The compiled inner loops of scans: which beams are usable, and their log-likelihood."""

import numpy as np

from deqmcl_gym.maps.ray_kernels import cast
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import logs64
from deqmcl_gym.numerics.types import Bools, Floats, Singles

_POSES = 512  # looked at in one go
_KEPT = 8192  # poses whose exact ranges are kept at one time, in the processor's cache
_FOLD = 16  # beams multiplied before a logarithm is taken
LEAST_FLOOR = 1e-19  # so that the product of _FOLD densities is a normal float64

_LOG2E = 1.4426950408889634
_ROUNDER = 6755399441055744.0  # 1.5 * 2**52: adding and subtracting it rounds
# 2^f on [-½, ½], through the Chebyshev nodes
_C0, _C1, _C2 = 1.0000000000000135, 0.6931471805599462, 0.2402265069564034
_C3, _C4, _C5 = 0.05550410866465169, 0.009618129193934344, 0.0013333558200794293
_C6, _C7, _C8 = 0.00015403433751204343, 1.5252672923793398e-05, 1.3259645259555697e-06
_C9 = 1.020590545408595e-07


@compiled
def usable(range_: float, max_range: float) -> bool:
    """Whether a range is a number in [0, max_range]."""
    return (range_ >= 0.0) & (range_ <= max_range)  # both are false for NaN


@compiled
def mark_usable(ranges: Floats, max_range: float, out: Bools) -> None:
    """Fill in which ranges are usable, (B,)."""
    for i in range(ranges.size):
        out[i] = usable(ranges[i], max_range)


@compiled
def count_usable(ranges: Floats, max_range: float) -> int:
    """How many ranges (B,) are usable."""
    count = 0
    for i in range(ranges.size):
        count += usable(ranges[i], max_range)
    return count


@compiled
def usable_if_sound(
    ranges: Floats, action: Floats, plan: Floats, beams: int, max_range: float
) -> int:
    """``count_usable`` of a step; -1 if it is not one.

    That is, unless there are as many ranges as ``beams``, and the action (2,) and those of the plan
    (h, 2) are pairs of finite numbers.
    """
    if ranges.size != beams or action.size != 2 or plan.shape[1] != 2:
        return -1
    amiss = 0
    for i in range(action.size):
        amiss += not np.isfinite(action[i])
    planned = plan.ravel()
    for i in range(planned.size):
        amiss += not np.isfinite(planned[i])
    return count_usable(ranges, max_range) if amiss == 0 else -1


@compiled
def fill_where_nan(marks: Singles, value: float, out: Floats) -> None:
    """Overwrite ``out`` by ``value`` where ``marks`` is NaN, (n,)."""
    for i in range(out.size):
        out[i] = value if np.isnan(marks[i]) else out[i]


@compiled
def mixture(
    ranges: Floats, expected: Singles, sigma: float, peak: float, floor: float, out: Floats
) -> None:
    """Fill in Σ_b log(peak exp(-½ ((o_b - ô_b) / σ)²) + floor) for each pose.

    Args:
        ranges: o, (B,) px.
        expected: ô, (B, n) px.
        sigma: px.
        peak, floor: floor ≥ ``LEAST_FLOOR``.
        out: (n,).
    """
    scale = np.sqrt(0.5 * _LOG2E) / sigma  # exp(-½ z²) = 2^-t for t = (scale (o - ô))²
    product = np.empty(_POSES, np.float64)
    rounded = np.empty(_POSES, np.float64)
    fraction = np.empty(_POSES, np.float64)
    even = np.empty(_POSES, np.float64)
    n = expected.shape[1]
    for start in range(0, n, _POSES):
        count = min(_POSES, n - start)
        total = out[start : start + count]
        for i in range(count):
            total[i] = 0.0
        for first in range(0, ranges.size, _FOLD):
            for i in range(count):
                product[i] = 1.0
            for beam in range(first, min(first + _FOLD, ranges.size)):
                measured = ranges[beam]
                row = expected[beam, start : start + count]
                for i in range(count):
                    z = (measured - row[i]) * scale
                    t = 1000.0 if z * z > 1000.0 else z * z  # NaN stays NaN
                    rounded[i] = t + _ROUNDER  # its lowest bits are the integer k nearest to t
                    fraction[i] = (rounded[i] - _ROUNDER) - t  # f = k - t, in [-½, ½]
                for i in range(count):
                    z = fraction[i] * fraction[i]
                    even[i] = (((_C8 * z + _C6) * z + _C4) * z + _C2) * z + _C0
                for i in range(count):
                    z = fraction[i] * fraction[i]
                    odd = (((_C9 * z + _C7) * z + _C5) * z + _C3) * z + _C1
                    fraction[i] = even[i] + fraction[i] * odd
                for i in range(count):
                    power = (np.int64(1023) - np.float64(rounded[i]).view(np.int64)) << np.int64(52)
                    hit = peak * (fraction[i] * np.int64(power).view(np.float64))
                    product[i] *= hit + floor
            logs = even  # no longer needed
            logs64(product[:count], logs)
            for i in range(count):
                total[i] += logs[i]


@compiled
def scan_mixture(
    poses: Singles,
    ranges: Floats,
    out: Floats,
    bearings: Singles,
    walls: tuple[Singles, ...],
    max_range: float,
    sigma: float,
    peak: float,
    floor: float,
    ends: bool,
    outside: float,
) -> bool:
    """Cast rays and fill in ``mixture`` at once; False, and fill in nothing, if a range is amiss.

    Args:
        poses: rows x px, y px, θ rad, (3, n).
        ranges: o, (B,) px; each must be a number in [0, max_range], without the ends if not
            ``ends``.
        out: (n,).
        bearings, walls: as for ``cast``.
        sigma, peak, floor: as for ``mixture``.
        outside: what a pose gets that is outside the outer wall.
    """
    if ranges.size != bearings.size:
        return False
    for i in range(ranges.size):
        at_end = (ranges[i] <= 0.0) | (ranges[i] >= max_range)
        if not usable(ranges[i], max_range) or (at_end and not ends):
            return False
    n = poses.shape[1]
    for start in range(0, n, _KEPT):
        end = min(start + _KEPT, n)
        # rows without gaps are quicker
        part = poses if n <= _KEPT else poses[:, start:end].copy()
        expected = np.empty((bearings.size, part.shape[1]), np.float32)
        cast(part, bearings, walls, expected)
        mixture(ranges, expected, sigma, peak, floor, out[start:end])
        fill_where_nan(expected[0], outside, out[start:end])
    return True
