"""The compiled beam models: from exact ranges to the log-likelihood of a scan.

Each multiplies densities in blocks of poses that fit the processor's cache, and takes a logarithm
of several beams at once. Loops are short and free of branches, so that they become SIMD code.
"""

from typing import Any

import numpy as np

from deqmcl_gym.numerics import Floats, Singles
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import exp64, logs64

_Scalar = Any  # a float64 inside a kernel
_POSES = 512  # looked at in one go
_FEW = 64  # the same where much is kept for each
_FOLD = 16  # beams multiplied before a logarithm is taken, …
_LEAST, _MOST = 1e-19, 1e19  # … where densities lie between: so the product is a normal float64
_FARTHEST = 39.0  # standard deviations: from there on the normal density is 0

_LOG2E = 1.4426950408889634
_SQRT_2PI = np.sqrt(2 * np.pi)
_ROUNDER = 6755399441055744.0  # 1.5 * 2**52: adding and subtracting it rounds
# 2^f on [-½, ½], through the Chebyshev nodes
_C0, _C1, _C2 = 1.0000000000000135, 0.6931471805599462, 0.2402265069564034
_C3, _C4, _C5 = 0.05550410866465169, 0.009618129193934344, 0.0013333558200794293
_C6, _C7, _C8 = 0.00015403433751204343, 1.5252672923793398e-05, 1.3259645259555697e-06
_C9 = 1.020590545408595e-07
# Interpolates (a + 5) Φ(-a) exp(a²/2) at 22 Chebyshev points of (a - 5) / (a + 5), a in [0, 39]
_T0, _T1, _T2 = 0.769193049750063, -0.6653825028900567, 0.49530561596997413
_T3, _T4, _T5 = -0.3135331566712971, 0.1650203661705007, -0.06911863870647982
_T6, _T7, _T8 = 0.020795066797569855, -0.002993376769094473, -0.0007978693748911934
_T9, _T10, _T11 = 0.000544899062695852, -5.937586616736071e-05, -4.9762853165030135e-05
_T12, _T13, _T14 = 1.668170360977268e-05, 3.981182741532577e-06, -2.7703209441469523e-06
_T15, _T16, _T17 = -3.374965203524632e-07, 4.3443907263764586e-07, 4.375841598285575e-08
_T18, _T19, _T20 = -6.667529339227571e-08, -1.0618274174239376e-08, 7.630410417873182e-09
_T21 = 2.224938767716443e-09


@compiled
def fold(least: float, most: float) -> int:
    """How many densities, none below ``least`` or above ``most``, make a normal product."""
    return _FOLD if least >= _LEAST and most <= _MOST else 1


@compiled
def gaussian_uniform(
    ranges: Floats,
    expected: Singles,
    sigma: float,
    hit: float,
    floor: float,
    low: float,
    high: float,
    atom: float,
    out: Floats,
) -> None:
    """Fill in Σ_b log(hit N(o_b; ô_b, σ²) + floor) for each pose; at the ends of the range, masses.

    They are hit Φ((low - ô) / σ) + atom at o ≤ low, hit Φ((ô - high) / σ) + atom at o ≥ high; low,
    high, atom are -inf, inf, inf if there are none. Ranges o are (B,), expected ones ô (B, n).
    """
    peak = hit / (sigma * _SQRT_2PI)
    together = fold(min(floor, atom), peak + floor)
    product, value = np.empty(_POSES), np.empty(_POSES)
    part, power = np.empty(_POSES), np.empty(_POSES)
    n = expected.shape[1]
    for start in range(0, n, _POSES):
        end = min(start + _POSES, n)
        count = end - start
        total = out[start:end]
        total[:] = 0.0
        for first in range(0, ranges.size, together):
            product[:] = 1.0
            for beam in range(first, min(first + together, ranges.size)):
                measured, row = ranges[beam], expected[beam, start:end]
                if (measured <= low) | (measured >= high):
                    at_low = measured <= low
                    _mass_beyond(row, low if at_low else high, at_low, sigma, part, power, value)
                    for i in range(count):
                        product[i] *= hit * value[i] + atom
                else:
                    _bell(row, measured, sigma, part, power, value)
                    for i in range(count):
                        product[i] *= peak * _scaled(value[i], power[i]) + floor
            logs64(product[:count], value[:count])
            for i in range(count):
                total[i] += value[i]


@compiled
def four_parts(
    ranges: Floats,
    expected: Singles,
    shares: tuple[float, float, float, float],
    sigma: float,
    decay: float,
    nearest: float,
    max_range: float,
    out: Floats,
) -> None:
    """Fill in Σ_b log of ``BeamModel.density``, of its shares, for each pose; ô is (B, n)."""
    hit, short, largest, rand = shares
    peak, anything = hit / (sigma * _SQRT_2PI), rand / max_range
    together = fold(min(largest, anything), 3.0 * peak + 2.0 / max_range + 2.0 * short / nearest)
    product, seen = np.empty(_POSES), np.empty(_POSES)
    part, power = np.empty(_POSES), np.empty(_POSES)
    value, below, above = np.empty(_POSES), np.empty(_POSES), np.empty(_POSES)
    n = expected.shape[1]
    for start in range(0, n, _POSES):
        end = min(start + _POSES, n)
        count = end - start
        total, at = out[start:end], seen[:count]
        total[:] = 0.0
        for first in range(0, ranges.size, together):
            product[:] = 1.0
            for beam in range(first, min(first + together, ranges.size)):
                measured, row = ranges[beam], expected[beam, start:end]
                for i in range(count):
                    at[i] = max_range if row[i] > max_range else np.float64(row[i])
                _mass_beyond(at, 0.0, True, sigma, part, power, below)
                _mass_beyond(at, max_range, False, sigma, part, power, above)
                always = largest if measured >= max_range else anything
                _bell(at, measured, sigma, part, power, value)
                for i in range(count):
                    normal = _scaled(value[i], power[i]) / (1.0 - above[i] - below[i])
                    value[i] = peak * normal + always
                for i in range(count):
                    t = decay * _LOG2E * (at[i] if at[i] > nearest else nearest)
                    part[i], power[i] = _split(t)
                _mantissas(part[:count], below)
                early = short * decay * exp64(-decay * measured)
                for i in range(count):
                    cut = early / (1.0 - _scaled(below[i], power[i]))
                    product[i] *= value[i] + (cut if measured <= at[i] else 0.0)
            logs64(product[:count], value[:count])
            for i in range(count):
                total[i] += value[i]


@compiled
def latent_share(
    ranges: Floats,
    expected: Singles,
    sigma: float,
    counts: tuple[float, float],
    floor: float,
    low: float,
    high: float,
    atom: float,
    out: Floats,
) -> None:
    """Fill in log ∫ Beta(u; a, b) Π_b ((1 - u) p_hit + u p_any) du for each pose.

    Pólya's urn: after j beams of which k were unexplained, the next is with probability
    (a + k) / (a + b + j), carried for all k; ``counts`` are a and b, the rest is as in
    ``gaussian_uniform``.
    """
    a, b = counts
    beams, n = ranges.size, expected.shape[1]
    rarest = min(a, b) / (a + b + beams)  # of an urn's draws
    together = fold(rarest, 1.0)
    # Left out are shares that no later beam can raise to 1e-40 of the whole, E[u^B] being at least
    # rarest / 2^B, 1e-154 of 512 beams: subnormal numbers would take ten times as long.
    tiny, least = 1e-40 * rarest, 1e-200 if together > 1 and beams <= 512 else 0.0
    few = min(n, _FEW)
    urn = np.empty((beams + 1, few))
    hit, miss, part, power = np.empty(few), np.empty(few), np.empty(few), np.empty(few)
    for start in range(0, n, few):
        end = min(start + few, n)
        logs = out[start:end]
        logs[:] = 0.0
        urn[:] = 0.0
        urn[0] = 1.0
        for j in range(beams):
            measured, row = ranges[j], expected[j, start:end]
            if (measured <= low) | (measured >= high):
                at_low = measured <= low
                _mass_beyond(row, low if at_low else high, at_low, sigma, part, power, hit)
                _shares(atom, tiny, hit, miss, part, logs)
            else:
                _bell(row, measured, sigma, part, power, hit)
                for i in range(end - start):
                    hit[i] = _scaled(hit[i], power[i]) / (sigma * _SQRT_2PI)
                _shares(floor, tiny, hit, miss, part, logs)
            _drawn(a, b, j, hit, miss, urn)
            if (j + 1) % together == 0 or j + 1 == beams:
                _emptied(urn[: j + 2], least, miss, part, logs)


@compiled
def _shares(
    other: float, tiny: float, hit: Floats, miss: Floats, part: Floats, total: Floats
) -> None:
    """Divide p_hit (0 if below ``tiny``) and p_any by their sum, whose log ``total`` gets."""
    count = total.size
    for i in range(count):
        miss[i] = hit[i] + other
    logs64(miss[:count], part[:count])
    for i in range(count):
        total[i] += part[i]
        share = hit[i] / miss[i]
        hit[i] = 0.0 if share < tiny else share
        miss[i] = other / miss[i]


@compiled
def _drawn(a: float, b: float, j: int, hit: Floats, miss: Floats, urn: Floats) -> None:
    """Turn probabilities of k unexplained of j beams, the rows, into those of j + 1 beams."""
    each, count = 1.0 / (a + b + j), hit.size
    for k in range(j + 1, 0, -1):
        row, before = urn[k], urn[k - 1]
        stays, turns = (b + (j - k)) * each, (a + (k - 1)) * each
        for i in range(count):
            row[i] = row[i] * stays * hit[i] + before[i] * turns * miss[i]
    for i in range(count):
        urn[0, i] *= (b + j) * each * hit[i]


@compiled
def _emptied(urn: Floats, least: float, sums: Floats, part: Floats, total: Floats) -> None:
    """Divide probabilities (K, n) by their sums, whose logs ``total`` gets; 0 below ``least``."""
    count = total.size
    sums[:] = 0.0
    for k in range(urn.shape[0]):
        for i in range(count):
            sums[i] += urn[k, i]
    logs64(sums[:count], part[:count])
    for i in range(count):
        total[i] += part[i]
        sums[i] = 1.0 if sums[i] == 0.0 else 1.0 / sums[i]
    for k in range(urn.shape[0]):
        for i in range(count):
            share = urn[k, i] * sums[i]
            urn[k, i] = 0.0 if share < least else share


@compiled
def chance_of_shorter(
    ranges: Floats, expected: Singles, weights: Floats, sigma: float, max_range: float, out: Floats
) -> None:
    """Fill in Σ w Φ((ô - o_b) / σ) for each beam, Σ w = 1, ô (B, n), no NaN, at most max_range."""
    n = weights.size
    seen, value, part, power = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for beam in range(ranges.size):
        for i in range(n):
            ahead = np.float64(expected[beam, i])
            seen[i] = max_range if ahead > max_range else ahead
        _mass_beyond(seen, ranges[beam], False, sigma, part, power, value)
        out[beam] = 0.0
        for i in range(n):
            out[beam] += weights[i] * value[i]


@compiled
def _bell(
    expected: _Scalar, measured: float, sigma: float, part: Floats, power: Floats, out: Floats
) -> None:
    """Fill in out and power, of which exp(-½ ((o - ô) / σ)²) is the ``_scaled``, for ô (n,)."""
    scale = np.sqrt(0.5 * _LOG2E) / sigma  # exp(-½ z²) = 2^-t for t = (scale (o - ô))²
    for i in range(expected.size):
        z = (measured - np.float64(expected[i])) * scale
        part[i], power[i] = _split(z * z)
    _mantissas(part[: expected.size], out)


@compiled
def _mass_beyond(
    expected: _Scalar,
    end: float,
    below: bool,
    sigma: float,
    part: Floats,
    power: Floats,
    out: Floats,
) -> None:
    """Fill in the share of N(ô, σ²) below an end, or above it, for exact ranges ô, (n,)."""
    _bell(expected, end, sigma, part, power, out)
    per_sd = 1.0 / sigma if below else -1.0 / sigma
    for i in range(expected.size):
        z = (end - np.float64(expected[i])) * per_sd
        a = abs(z)
        tail = _scaled(out[i], power[i]) * _tail(_FARTHEST if a > _FARTHEST else a)
        out[i] = tail if z < 0.0 else 1.0 - tail


@compiled
def _tail(a: _Scalar) -> _Scalar:
    """Return Φ(-a) / exp(-a²/2) for 0 ≤ a ≤ 39, to about 5e-16 of itself."""
    inverse = 1.0 / (a + 5.0)
    t = (a - 5.0) * inverse
    z = t * t
    even: _Scalar = ((((_T20 * z + _T18) * z + _T16) * z + _T14) * z + _T12) * z + _T10
    even = ((((even * z + _T8) * z + _T6) * z + _T4) * z + _T2) * z + _T0
    odd: _Scalar = ((((_T21 * z + _T19) * z + _T17) * z + _T15) * z + _T13) * z + _T11
    odd = ((((odd * z + _T9) * z + _T7) * z + _T5) * z + _T3) * z + _T1
    return (even + t * odd) * inverse


# 2^-t of t ≥ 0 is 2^-k 2^f, k the integer nearest to t and f in [-½, ½]; 0 beyond t = 1022.5.


@compiled
def _split(t: _Scalar) -> tuple[_Scalar, _Scalar]:
    """Return f, and a number whose lowest bits are k."""
    t = 1023.0 if t > 1023.0 else t  # NaN stays NaN
    rounded = t + _ROUNDER
    return (rounded - _ROUNDER) - t, rounded


@compiled
def _mantissas(f: Floats, out: Floats) -> None:
    """Fill in 2^f."""
    for i in range(f.size):
        z = f[i] * f[i]
        out[i] = (((_C8 * z + _C6) * z + _C4) * z + _C2) * z + _C0
    for i in range(f.size):
        z = f[i] * f[i]
        odd = (((_C9 * z + _C7) * z + _C5) * z + _C3) * z + _C1
        out[i] = out[i] + f[i] * odd


@compiled
def _scaled(mantissa: _Scalar, rounded: _Scalar) -> _Scalar:
    """Return 2^-k times the mantissa."""
    bits = (np.int64(1023) - np.float64(rounded).view(np.int64)) << np.int64(52)
    return mantissa * np.int64(bits).view(np.float64)
