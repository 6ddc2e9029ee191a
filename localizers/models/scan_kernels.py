"""The compiled checks of scans: which beams are usable, and whether a step is one."""

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Floats, Singles


@compiled
def count_usable(ranges: Floats, max_range: float) -> int:
    """How many ranges (B,) are usable."""
    count = 0
    for i in range(ranges.size):
        count += (ranges[i] >= 0.0) & (ranges[i] <= max_range)  # both are false for NaN
    return count


@compiled
def fill_where_nan(marks: Singles, value: float, out: Floats) -> None:
    """Overwrite ``out`` by ``value`` where ``marks`` is NaN, (n,)."""
    for i in range(out.size):
        out[i] = value if np.isnan(marks[i]) else out[i]
