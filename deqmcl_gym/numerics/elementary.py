"""Sin, cos, exp, log and the normal distribution from + - * / alone, for use in kernels.

IEEE 754 fixes what those operations give, so every processor gives the same bits; the system's and
NumPy's own functions differ between instruction sets. They are free of branches where a kernel's
inner loop needs that to become SIMD code. Coefficients: Moshier's Cephes library.
"""

import numpy as np

from deqmcl_gym.numerics import Scalar
from deqmcl_gym.numerics.compiling import compiled

_F = np.float32
ARRAY_LANES = 512  # of an array worked on in one go: what they need fits the fastest cache
TURN = 2 * np.pi
# Adding and subtracting it rounds to the nearest integer: 1.5 * 2**23, 1.5 * 2**52.
ROUNDER32, ROUNDER64 = _F(12582912.0), 6755399441055744.0

# float32 sin and cos on [-π/4, π/4], after reduction by multiples of π/2 (Cody & Waite 1980)
_TURN32, _PER_TURN32 = _F(TURN), _F(1 / TURN)
_TWO_OVER_PI = _F(2 / np.pi)
_PIO2_HIGH = _F(1.5703125)
_PIO2_MIDDLE = _F(4.837512969970703125e-4)
_PIO2_LOW = _F(7.54978995489188216e-8)
_S1, _S2, _S3 = _F(-1.6666654611e-1), _F(8.3321608736e-3), _F(-1.9515295891e-4)
_C1, _C2, _C3 = _F(4.166664568298827e-2), _F(-1.388731625493765e-3), _F(2.443315711809948e-5)
_HALF, _ONE = _F(0.5), _F(1.0)

# float64 sin, cos on [-π/4, π/4] and atan on [-0.21, 0.66]
FARTHEST = 1e9  # rad: the reduction of an angle beyond it loses digits
_PER_TURN64 = 1 / TURN
_TWO_OVER_PI64 = 2 / np.pi
_PIO2_HIGH64 = 2 * 7.85398125648498535156e-1
_PIO2_MIDDLE64 = 2 * 3.77489470793079817668e-8
_PIO2_LOW64 = 2 * 2.69515142907905952645e-15
_SINE = (
    1.58962301576546568060e-10, -2.50507477628578072866e-8, 2.75573136213857245213e-6,
    -1.98412698295895385996e-4, 8.33333333332211858878e-3, -1.66666666666666307295e-1,
)  # fmt: skip
_COSINE = (
    -1.13585365213876817300e-11, 2.08757008419747316778e-9, -2.75573141792967388112e-7,
    2.48015872888517045348e-5, -1.38888888888730564116e-3, 4.16666666666665929218e-2,
)  # fmt: skip
_ATAN_P = (
    -8.750608600031904122785e-1, -1.615753718733365076637e1, -7.500855792314704667340e1,
    -1.228866684490136173410e2, -6.485021904942025371773e1,
)  # fmt: skip
_ATAN_Q = (
    2.485846490142306297962e1, 1.650270098316988542046e2, 4.328810604912902668951e2,
    4.853903996359136964868e2, 1.945506571482613964425e2,
)  # fmt: skip
_MORE = 6.123233995736765886130e-17  # of π/2 beyond its float64


@compiled
def _reduced(angle: Scalar) -> Scalar:
    """Return r in [-π/4, π/4] and whole quarters of a turn, modulo 4, that make up an angle."""
    rounded = angle * _TWO_OVER_PI + ROUNDER32  # its lowest bits are the integer quarters
    quarters = rounded - ROUNDER32
    r = ((angle - quarters * _PIO2_HIGH) - quarters * _PIO2_MIDDLE) - quarters * _PIO2_LOW
    return r, np.float32(rounded).view(np.int32)


@compiled
def _sine(r: Scalar) -> Scalar:
    z = r * r
    return ((_S3 * z + _S2) * z + _S1) * z * r + r


@compiled
def _cosine(r: Scalar) -> Scalar:
    z = r * r
    return ((_C3 * z + _C2) * z + _C1) * z * z - _HALF * z + _ONE


@compiled
def _turned(sine: Scalar, cosine: Scalar, quarters: Scalar) -> Scalar:
    """Return sin(r + quarters π/2)."""
    value = cosine if (quarters & np.int32(1)) != 0 else sine
    return -value if (quarters & np.int32(2)) != 0 else value


@compiled
def sin32(angle: Scalar) -> Scalar:
    """Sin of a float32 angle, |angle| < 1000 rad, to about 1e-7."""
    r, quarters = _reduced(angle)
    return _turned(_sine(r), _cosine(r), quarters)


@compiled
def cos32(angle: Scalar) -> Scalar:
    """Cos of a float32 angle, |angle| < 1000 rad, to about 1e-7."""
    r, quarters = _reduced(angle)
    return _turned(_sine(r), _cosine(r), quarters + np.int32(1))


@compiled
def sincos32(angles: Scalar, sines: Scalar, cosines: Scalar) -> None:
    """Fill in sin32 and cos32 of angles (n,); the three arrays share no memory.

    In loops so short that the compiler keeps their constants in registers: quicker than one loop.
    """
    quarters = np.empty(ARRAY_LANES, np.int32)
    r = np.empty(ARRAY_LANES, np.float32)
    for start in range(0, angles.size, ARRAY_LANES):
        count = min(ARRAY_LANES, angles.size - start)
        angle = angles[start : start + count]
        sine, cosine = sines[start : start + count], cosines[start : start + count]
        for i in range(count):
            r[i], quarters[i] = _reduced(angle[i])
        for i in range(count):
            sine[i] = _sine(r[i])
        for i in range(count):
            cosine[i] = _cosine(r[i])
        for i in range(count):
            s, c = sine[i], cosine[i]
            sine[i] = _turned(s, c, quarters[i])
            cosine[i] = _turned(s, c, quarters[i] + np.int32(1))


@compiled
def _wave64(angle: Scalar, quarters: Scalar) -> Scalar:
    """Sin(angle + quarters π/2)."""
    rounded = angle * _TWO_OVER_PI64 + ROUNDER64  # its lowest bits are the integer turns
    turns = rounded - ROUNDER64
    r = ((angle - turns * _PIO2_HIGH64) - turns * _PIO2_MIDDLE64) - turns * _PIO2_LOW64
    z = r * r
    sine: Scalar = 0.0
    for coefficient in _SINE:
        sine = sine * z + coefficient
    cosine: Scalar = 0.0
    for coefficient in _COSINE:
        cosine = cosine * z + coefficient
    sine = r + r * z * sine
    cosine = 1.0 - 0.5 * z + z * z * cosine
    quadrant = np.float64(rounded).view(np.int64) + quarters
    value = cosine if (quadrant & 1) != 0 else sine
    value = -value if (quadrant & 2) != 0 else value
    return value if abs(angle) <= FARTHEST else np.nan


@compiled
def sin64(angle: Scalar) -> Scalar:
    """Sin of a float64 angle, |angle| ≤ 1e9 rad, to about 2e-16; NaN beyond."""
    return _wave64(angle, 0)


@compiled
def cos64(angle: Scalar) -> Scalar:
    """Cos of a float64 angle, |angle| ≤ 1e9 rad, to about 2e-16; NaN beyond."""
    return _wave64(angle, 1)


@compiled
def wrapped32(angle: Scalar) -> Scalar:
    """Return the same direction in [-π, π], of a float32 angle; one that lies there as it is."""
    return angle - _TURN32 * ((angle * _PER_TURN32 + ROUNDER32) - ROUNDER32)


@compiled
def wrapped64(angle: Scalar) -> Scalar:
    """Return the same direction in [-π, π], of a float64 angle; one that lies there as it is."""
    return angle - TURN * ((angle * _PER_TURN64 + ROUNDER64) - ROUNDER64)


@compiled
def centred64(value: Scalar, period: Scalar) -> Scalar:
    """Return (value + period / 2) % period - period / 2: [-period / 2, period / 2), rounded.

    For the way along a closed path and headings of the world, which never reach π.
    """
    ahead: Scalar = value + period / 2
    if not 0.0 <= ahead < period:  # seldom, and remainders take long
        ahead %= period
    return ahead - period / 2


@compiled
def atan2_64(y: Scalar, x: Scalar) -> Scalar:
    """Angle of (x, y) in [-π, π], to about 2e-16; 0 at the origin, NaN if either is."""
    up, right = abs(y), abs(x)
    if not up + right > 0.0:
        return up + right  # 0 or NaN
    low, high = min(up, right), max(up, right)
    ratio = low / high  # in [0, 1]
    steep = ratio > 0.66
    r = (ratio - 1.0) / (ratio + 1.0) if steep else ratio
    z = r * r
    p: Scalar = 0.0
    for coefficient in _ATAN_P:
        p = p * z + coefficient
    q: Scalar = 1.0
    for coefficient in _ATAN_Q:
        q = q * z + coefficient
    angle = r + r * z * p / q
    angle = np.pi / 4 + (angle + 0.5 * _MORE) if steep else angle
    angle = np.pi / 2 - angle if up > right else angle
    angle = np.pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


# float32: ln 2 in two parts; log as 2 artanh by its series
_LN2_HIGH, _LN2_LOW = _F(0.693359375), _F(-2.12194440e-4)
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
    e = np.empty(ARRAY_LANES, np.float64)
    s = np.empty(ARRAY_LANES, np.float64)
    for start in range(0, x.size, ARRAY_LANES):
        count = min(ARRAY_LANES, x.size - start)
        values, log = x[start : start + count], out[start : start + count]
        for i in range(count):
            e[i], s[i] = _log_reduced(values[i])
        for i in range(count):
            log[i] = _log_series_high(s[i] * s[i])
        for i in range(count):
            log[i] = _log_series(s[i] * s[i], log[i])
        for i in range(count):
            log[i] = _log_of(values[i], e[i], s[i], log[i])


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
