"""Sin, cos and atan from + - * / alone, for use in kernels; exp and log: ``exponential_kernels``.

IEEE 754 fixes what those operations give, so every processor gives the same bits; the system's and
NumPy's own functions differ between instruction sets. They are free of branches where a kernel's
inner loop needs that to become SIMD code. Coefficients: Moshier's Cephes library.
"""

from typing import Any

import numpy as np

from deqmcl_gym.numerics.compiling import compiled

Scalar = Any  # a float32 or float64 inside a kernel
_F = np.float32
LANES = 512  # of an array worked on in one go: what they need fits the fastest cache
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
_PI, _PI_2, _PI_4 = np.pi, np.pi / 2, np.pi / 4
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
    quarters = np.empty(LANES, np.int32)
    r = np.empty(LANES, np.float32)
    for start in range(0, angles.size, LANES):
        count = min(LANES, angles.size - start)
        angle = angles[start : start + count]
        sine, cosine = sines[start : start + count], cosines[start : start + count]
        for i in range(count):
            r[i], quarters[i] = _reduced(angle[i])
        for i in range(count):
            sine[i] = _sine(r[i])
        for i in range(count):
            cosine[i] = _cosine(r[i])
        for i in range(count):
            here, ahead = sine[i], cosine[i]
            sine[i] = _turned(here, ahead, quarters[i])
            cosine[i] = _turned(here, ahead, quarters[i] + np.int32(1))


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
    angle = _PI_4 + (angle + 0.5 * _MORE) if steep else angle
    angle = _PI_2 - angle if up > right else angle
    angle = _PI - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle
