"""Exp, log and the normal distribution from + - * / alone, as ``elementary``."""

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import LANES, ROUNDER64, Scalar

_F = np.float32

# float32: ln 2 in two parts; log as 2 artanh by its series
_LN2_HIGH, _LN2_LOW = _F(0.693359375), _F(-2.12194440e-4)
_ONE = _F(1.0)
_A1, _A2, _A3, _A4 = _F(1 / 3), _F(1 / 5), _F(1 / 7), _F(1 / 9)
_SQRT_HALF_BITS = np.int32(0x3F3504F3)

# float64: ln 2 in two parts; sqrt ½
_LN2_HI, _LN2_LO = 6.93145751953125e-1, 1.42860682030941723212e-6
_SQRT_HALF = 0.70710678118654752440
_L1, _L2, _L3, _L4, _L5 = 1 / 3, 1 / 5, 1 / 7, 1 / 9, 1 / 11
_L6, _L7, _L8, _L9, _L10 = 1 / 13, 1 / 15, 1 / 17, 1 / 19, 1 / 21
_LEAST_NORMAL = 2.2250738585072014e-308
_LOG2E64 = 1.4426950408889634
_P0, _P1, _P2 = 1.26177193074810590878e-4, 3.02994407707441961300e-2, 9.99999999999999999910e-1
_Q0, _Q1, _Q2 = 3.00198505138664455042e-6, 2.52448340349684104192e-3, 2.27265548208155028766e-1
_INV_SQRT_2PI = 0.3989422804014327


@compiled
def log32(x: Scalar) -> Scalar:
    """Log of a normal float32 x > 0, to about 1e-7 of itself."""
    bits = np.float32(x).view(np.int32) - _SQRT_HALF_BITS
    e = np.float32(bits >> np.int32(23))
    m = np.int32((bits & np.int32(0x007FFFFF)) + _SQRT_HALF_BITS).view(np.float32)  # in [√½, √2)
    # log m = 2 artanh s, |s| < 0.172
    s = (m - _ONE) / (m + _ONE)
    z = s * s
    series = ((_A4 * z + _A3) * z + _A2) * z + _A1
    return e * _LN2_HIGH + (e * _LN2_LOW + (s + s + (s + s) * z * series))


@compiled
def exp64(x: Scalar) -> Scalar:
    """Exp of a float64 x ≤ 0, to about 2e-16; 0 below -708."""
    bounded: Scalar = x if x > -708.0 else -708.0
    rounded = bounded * _LOG2E64 + ROUNDER64  # its lowest bits are the integer k
    k = rounded - ROUNDER64
    r = (bounded - k * _LN2_HI) - k * _LN2_LO
    z = r * r
    p = r * ((_P0 * z + _P1) * z + _P2)
    q = ((_Q0 * z + _Q1) * z + _Q2) * z + 2.0
    mantissa = 1.0 + 2.0 * p / (q - p)
    power = (np.float64(rounded).view(np.int64) + np.int64(1023)) << np.int64(52)
    value: Scalar = mantissa * np.int64(power).view(np.float64)
    value = value if x > -708.0 else 0.0
    return x if np.isnan(x) else value


@compiled
def _log_reduced(x: Scalar) -> Scalar:
    """Return e and s with x = 2**e (1 + s) / (1 - s), |s| < 0.172."""
    bits = np.float64(x).view(np.int64)
    half = (bits & np.int64(0x000FFFFFFFFFFFFF)) | np.int64(0x3FE0000000000000)
    m = np.int64(half).view(np.float64)  # in [½, 1): x = m 2**e
    biased = (bits >> np.int64(52)) | np.int64(0x4330000000000000)
    e = np.int64(biased).view(np.float64) - (4503599627370496.0 + 1022.0)
    low = m < _SQRT_HALF
    m = 2.0 * m if low else m  # in [√½, √2)
    e = e - 1.0 if low else e
    return e, (m - 1.0) / (m + 1.0)


@compiled
def _log_series_high(z: Scalar) -> Scalar:
    series: Scalar = _L10 * z + _L9
    for coefficient in (_L8, _L7, _L6, _L5):
        series = series * z + coefficient
    return series


@compiled
def _log_series(z: Scalar, high: Scalar) -> Scalar:
    series: Scalar = high
    for coefficient in (_L4, _L3, _L2, _L1):
        series = series * z + coefficient
    return series


@compiled
def _log_of(x: Scalar, e: Scalar, s: Scalar, series: Scalar) -> Scalar:
    """Log x = e log 2 + 2 artanh s, and what it is where x is no normal number."""
    z = s * s
    value: Scalar = e * _LN2_HI + (e * _LN2_LO + (2.0 * s + 2.0 * s * z * series))
    value = value if x >= _LEAST_NORMAL else -np.inf
    value = value if x < np.inf else np.inf
    return value if x >= 0.0 else np.nan


@compiled
def log64(x: Scalar) -> Scalar:
    """Log of a float64, to about 2e-16; -inf at 0 (and below the normal numbers), NaN below."""
    e, s = _log_reduced(x)
    z = s * s
    return _log_of(x, e, s, _log_series(z, _log_series_high(z)))


@compiled
def logs64(x: Scalar, out: Scalar) -> None:
    """Fill in log64 of numbers (n,); the arrays share no memory. In short loops, as sincos32."""
    e = np.empty(LANES, np.float64)
    s = np.empty(LANES, np.float64)
    for start in range(0, x.size, LANES):
        count = min(LANES, x.size - start)
        given, log = x[start : start + count], out[start : start + count]
        for i in range(count):
            e[i], s[i] = _log_reduced(given[i])
        for i in range(count):
            log[i] = _log_series_high(s[i] * s[i])
        for i in range(count):
            log[i] = _log_series(s[i] * s[i], log[i])
        for i in range(count):
            log[i] = _log_of(given[i], e[i], s[i], log[i])


@compiled
def normal_cdf64(z: Scalar) -> Scalar:
    """Φ(z) of a float64, to about 1e-15 absolutely; series of Marsaglia (2004), tail beyond 7."""
    if not abs(z) <= 38.0:
        return 0.0 if z < 0.0 else 1.0 if z > 0.0 else z  # NaN stays
    density = exp64(-0.5 * z * z) * _INV_SQRT_2PI
    if abs(z) > 7.0:
        s = 1.0 / (z * z)
        tail = density / abs(z) * (1.0 - s * (1.0 - 3.0 * s * (1.0 - 5.0 * s * (1.0 - 7.0 * s))))
        return tail if z < 0.0 else 1.0 - tail
    term = z
    total = z
    i = 1.0
    while total + term != total:
        i += 2.0
        term *= z * z / i
        total += term
    return 0.5 + total * density
