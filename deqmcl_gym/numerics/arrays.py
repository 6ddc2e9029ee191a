"""Elementary functions of arrays, with the same bits on every processor.

NumPy's own differ in their last bits between instruction sets. Each function returns a fresh
float64 array of its first argument's shape.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.numerics import elementary
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Floats


def _of_arrays(loop: Callable[..., None]) -> Callable[..., Floats]:
    """Make a function of arrays from a loop over flat arrays that fills in the last one."""
    kernel = compiled(loop)

    def function(*arguments: ArrayLike) -> Floats:
        given = [np.ascontiguousarray(values, dtype=np.float64) for values in arguments]
        out = np.empty(np.shape(arguments[0]))
        kernel(*(values.reshape(-1) for values in given), out.reshape(-1))
        return out

    function.__name__, function.__doc__ = loop.__name__, loop.__doc__
    return function


@_of_arrays
def sin(x: Any, out: Any) -> None:
    """Sin of angles, |angle| ≤ 1e9 rad; NaN beyond."""
    for i in range(x.size):
        out[i] = elementary.sin64(x[i])


@_of_arrays
def cos(x: Any, out: Any) -> None:
    """Cos of angles, |angle| ≤ 1e9 rad; NaN beyond."""
    for i in range(x.size):
        out[i] = elementary.cos64(x[i])


@_of_arrays
def arctan2(y: Any, x: Any, out: Any) -> None:
    """Angle of (x, y) in [-π, π]; arguments of one shape."""
    for i in range(x.size):
        out[i] = elementary.atan2_64(y[i], x[i])


@_of_arrays
def wrapped(x: Any, out: Any) -> None:
    """The same directions in [-π, π]; angles already in it keep their bits."""
    for i in range(x.size):
        out[i] = elementary.wrapped64(x[i])


@_of_arrays
def exp(x: Any, out: Any) -> None:
    """Exp of x ≤ 0."""
    for i in range(x.size):
        out[i] = elementary.exp64(x[i])


@_of_arrays
def log(x: Any, out: Any) -> None:
    """Natural logarithm; -inf at 0."""
    for i in range(x.size):
        out[i] = elementary.log64(x[i])


@_of_arrays
def normal_cdf(x: Any, out: Any) -> None:
    """Φ(x)."""
    for i in range(x.size):
        out[i] = elementary.normal_cdf64(x[i])
