"""Elementary functions of whole arrays, the same bits on every processor.

NumPy's own differ in their last bits between instruction sets. For results that are compared
across machines; each function returns a fresh array of the argument's shape.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.numerics import elementary
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Floats, Singles


def sincos(angles: Singles) -> tuple[Singles, Singles]:
    """Sin and cos of float32 angles, |angle| < 1000 rad."""
    sines, cosines = np.empty_like(angles), np.empty_like(angles)
    elementary.sincos32(angles.reshape(-1), sines.reshape(-1), cosines.reshape(-1))
    return sines, cosines


def sin(angles: ArrayLike) -> Floats:
    """Sin of angles, |angle| < 1e6 rad."""
    return _each(_sin, angles)


def cos(angles: ArrayLike) -> Floats:
    """Cos of angles, |angle| < 1e6 rad."""
    return _each(_cos, angles)


def arctan2(y: ArrayLike, x: ArrayLike) -> Floats:
    """Angle of (x, y) in [-π, π]; arguments of one shape."""
    return _each(_arctan2, y, x)


def exp(x: ArrayLike) -> Floats:
    """Exp of x ≤ 0."""
    return _each(_exp, x)


def log(x: ArrayLike) -> Floats:
    """Natural logarithm; -inf at 0."""
    return _each(_log, x)


def normal_cdf(z: ArrayLike) -> Floats:
    """Φ(z)."""
    return _each(_normal_cdf, z)


def _each(kernel: Callable[..., None], *arguments: ArrayLike) -> Floats:
    given = [np.ascontiguousarray(values, dtype=np.float64) for values in arguments]
    out = np.empty(np.shape(arguments[0]))
    kernel(*(values.reshape(-1) for values in given), out.reshape(-1))
    return out


@compiled
def _sin(x: Any, out: Any) -> None:
    for i in range(x.size):
        out[i] = elementary.sin64(x[i])


@compiled
def _cos(x: Any, out: Any) -> None:
    for i in range(x.size):
        out[i] = elementary.cos64(x[i])


@compiled
def _arctan2(y: Any, x: Any, out: Any) -> None:
    for i in range(x.size):
        out[i] = elementary.atan2_64(y[i], x[i])


@compiled
def _exp(x: Any, out: Any) -> None:
    for i in range(x.size):
        out[i] = elementary.exp64(x[i])


@compiled
def _log(x: Any, out: Any) -> None:
    for i in range(x.size):
        out[i] = elementary.log64(x[i])


@compiled
def _normal_cdf(z: Any, out: Any) -> None:
    for i in range(z.size):
        out[i] = elementary.normal_cdf64(z[i])
