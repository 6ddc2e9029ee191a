"""Compiled crossings of a single ray with a single obstacle.

A ray starts at (x, y) and goes along (dx, dy); per_dx = 1 / dx. All but ``leave`` return the
smaller of ``best`` and the distance to one obstacle. They have no branches, which a loop over SIMD
lanes cannot have.
"""

from typing import Any

import numpy as np

from deqmcl_gym.numerics.compiling import compiled

Single = Any  # a float32
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TINY = np.float32(1e-12)


@compiled
def _less(a: Single, b: Single) -> Single:
    return a if a < b else b


@compiled
def _more(a: Single, b: Single) -> Single:
    return a if a > b else b


@compiled
def inverse(slope: Single) -> Single:
    """1 / slope; a beam along an axis gets a tiny slope, so that 0 · inf cannot occur."""
    return _ONE / (slope if abs(slope) > _TINY else _TINY)


@compiled
def leave(
    left: Single, low: Single, right: Single, high: Single, per_dx: Single, per_dy: Single
) -> Single:
    """Where a ray leaves the rectangle that it starts in; sides are relative to its start."""
    leave_x = _more(left * per_dx, right * per_dx)
    leave_y = _more(low * per_dy, high * per_dy)
    return _less(leave_x, leave_y)


@compiled
def enter(
    left: Single,
    low: Single,
    right: Single,
    high: Single,
    per_dx: Single,
    per_dy: Single,
    best: Single,
) -> Single:
    """Where a ray enters a rectangle, or leaves it: the slab method of Kay & Kajiya (1986)."""
    to_left, to_right = left * per_dx, right * per_dx
    to_low, to_high = low * per_dy, high * per_dy
    enter = _more(_less(to_left, to_right), _less(to_low, to_high))
    leave = _less(_more(to_left, to_right), _more(to_low, to_high))
    t = enter if enter >= _ZERO else leave
    return t if (t >= _ZERO) & (leave >= enter) & (t < best) else best


@compiled
def crosses(
    at: Single,
    low: Single,
    high: Single,
    across: Single,
    along: Single,
    per: Single,
    slope: Single,
    best: Single,
) -> Single:
    """Where a ray crosses a wall that is parallel to an axis."""
    t = (at - across) * per
    u = along + t * slope
    return t if (t >= _ZERO) & (u >= low) & (u <= high) & (t < best) else best


@compiled
def meet(
    ax: Single,
    ay: Single,
    ex: Single,
    ey: Single,
    low: Single,
    high: Single,
    x: Single,
    y: Single,
    dx: Single,
    dy: Single,
    best: Single,
) -> Single:
    """Where a ray meets a wall of any direction (ex, ey)."""
    rx, ry = ax - x, ay - y
    t = (rx * ey - ry * ex) / (dx * ey - dy * ex)
    u = (t * dx - rx) * ex + (t * dy - ry) * ey
    return t if (t >= _ZERO) & (u >= low) & (u <= high) & (t < best) else best
