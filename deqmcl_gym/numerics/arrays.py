"""Functions of arrays, with the same bits on every processor: elementary ones, fits of a Gaussian.

NumPy's own differ in their last bits between instruction sets. Each elementary function returns a
fresh float64 array of its first argument's shape.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.numerics import Floats, elementary
from deqmcl_gym.numerics.compiling import compiled


def _of_arrays(loop: Callable[..., None]) -> Callable[..., Floats]:
    """Make a function of arrays from a loop over flat arrays that fills in the last one."""
    kernel = compiled(loop)

    def function(*arguments: ArrayLike) -> Floats:
        inputs = [np.ascontiguousarray(values, dtype=np.float64) for values in arguments]
        out = np.empty(np.shape(arguments[0]))
        kernel(*(values.reshape(-1) for values in inputs), out.reshape(-1))
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


_LOG_TURN = math.log(2 * math.pi)


@compiled
def cholesky(covariance: Floats, least: float = 0.0) -> Floats:
    """Return the lower L with L Lᵀ = covariance, (d, d); a direction without variance gets 0.

    ``least`` is known of the variance of each component given those before it: against rounding.
    """
    d, out = covariance.shape[0], np.zeros(covariance.shape)
    for j in range(d):
        for i in range(j, d):
            rest = covariance[i, j]
            for k in range(j):
                rest -= out[i, k] * out[j, k]
            if i == j:
                out[j, j] = np.sqrt(max(rest, least))
            elif out[j, j] > 0.0:
                out[i, j] = rest / out[j, j]
    return out


@compiled
def fit(root: Floats, off: Floats) -> tuple[float, float, float]:
    """Return how an offset (3,) from the mean fits N(0, P), P = root rootᵀ.

    Its squared Mahalanobis distance in (x, y); in (x, y, θ), which is the NEES dᵀ P⁻¹ d; and the
    log score -log N(d; 0, P) = ½ (NEES + log det 2πP), nats.
    """
    u0 = off[0] / root[0, 0]
    u1 = (off[1] - root[1, 0] * u0) / root[1, 1]
    u2 = (off[2] - root[2, 0] * u0 - root[2, 1] * u1) / root[2, 2]
    distance = u0 * u0 + u1 * u1
    nees = distance + u2 * u2
    size = elementary.log64(root[0, 0] * root[1, 1] * root[2, 2])
    return distance, nees, 0.5 * (nees + 3 * _LOG_TURN) + size


@compiled
def fits(offsets: Floats, covariances: Floats, out: Floats) -> None:
    """Fill in the ``fit`` of each offset (n, 3) to N(0, P) of its own covariance, (n, 3)."""
    for i in range(len(offsets)):
        out[i, 0], out[i, 1], out[i, 2] = fit(cholesky(covariances[i]), offsets[i])


def compass_search(
    cost: Callable[[Any], Floats],
    begun: Any,
    steps: tuple[float, ...],
    *,
    halvings: int,
    most: int = 10_000,
    least: float = 0.0,
    moved: Callable[[Any, Floats], Any] = np.add,
) -> tuple[Any, Floats]:
    """Return places (n, d), each climbed down a cost by itself, and their costs, (n,).

    At each of at most ``most`` turns a place takes the best of 2 d steps along the axes, or halves
    its steps, so often, if none is better by ``least``. ``moved`` makes places of places and steps.
    """
    around = np.vstack([np.eye(len(steps)), -np.eye(len(steps))]) * np.array(steps)
    places, costs, size = begun.copy(), cost(begun), np.ones(len(begun))
    for _ in range(most):
        going = np.flatnonzero(size >= 0.5**halvings)
        if going.size == 0:
            break
        offsets = (around * size[going][:, None, None]).reshape(-1, len(steps))
        tried = moved(places[going].repeat(len(around), axis=0), offsets)
        new_costs = cost(tried).reshape(going.size, -1)
        chosen = new_costs.argmin(axis=1) + np.arange(0, new_costs.size, len(around))
        better = new_costs.reshape(-1)[chosen] < costs[going] - least
        into = going[better]
        places[into], costs[into] = tried[chosen[better]], new_costs.reshape(-1)[chosen[better]]
        size[going[~better]] /= 2
    return places, costs
