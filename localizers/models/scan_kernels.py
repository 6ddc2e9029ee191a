"""The compiled checks of scans: which beams are usable, and whether a step is valid."""

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import FARTHEST
from deqmcl_gym.numerics.types import Floats, Singles

LARGEST_ACTION = FARTHEST  # length or turn: the sine of a larger angle is NaN


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
    """``count_usable`` of a valid step, else -1.

    A step is valid if it has ``beams`` ranges, and if the action (k,) and the plan (h, k') have two
    or three numbers a row, of size ``LARGEST_ACTION`` at most.
    """
    if ranges.size != beams or not 2 <= action.size <= 3 or not 2 <= plan.shape[1] <= 3:
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
