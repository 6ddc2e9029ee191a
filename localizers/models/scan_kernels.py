"""The compiled checks of scans: which beams are usable, and whether a step is one."""

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import FARTHEST
from deqmcl_gym.numerics.types import Floats, Singles

LARGEST_ACTION = FARTHEST  # distance or turn: the sine of a larger angle is NaN


@compiled
def count_usable(ranges: Floats, max_range: float) -> int:
    """How many ranges (B,) are usable."""
    count = 0
    for i in range(ranges.size):
        count += (ranges[i] >= 0.0) & (ranges[i] <= max_range)  # both are false for NaN
    return count


@compiled
def usable_if_sound(
    ranges: Floats, action: Floats, plan: Floats, beams: int, max_range: float
) -> int:
    """``count_usable`` of a step; -1 if it is not one.

    That is, unless there are as many ranges as ``beams``, and the action (2,) and those of the plan
    (h, 2) are pairs of numbers of at most ``LARGEST_ACTION``.
    """
    if ranges.size != beams or action.size != 2 or plan.shape[1] != 2:
        return -1
    amiss = 0
    for i in range(action.size):
        amiss += not abs(action[i]) <= LARGEST_ACTION
    planned = plan.ravel()
    for i in range(planned.size):
        amiss += not abs(planned[i]) <= LARGEST_ACTION
    return count_usable(ranges, max_range) if amiss == 0 else -1


@compiled
def fill_where_nan(marks: Singles, value: float, out: Floats) -> None:
    """Overwrite ``out`` by ``value`` where ``marks`` is NaN, (n,)."""
    for i in range(out.size):
        out[i] = value if np.isnan(marks[i]) else out[i]
