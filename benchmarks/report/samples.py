"""Numbers of trials, gathered for charts."""

import math
from collections.abc import Sequence

import numpy as np

from benchmarks.tables.pairing import Record
from deqmcl_gym.numerics.types import Floats, Indices


def milliseconds_per_step(records: Sequence[Record]) -> float:
    """Median over runs of the localizer's time per step, ms; NaN if none was timed."""
    times = [
        1000 * record["seconds"] / record["steps_done"]
        for record in records
        if record.get("seconds") and record["steps_done"]
    ]
    return float(np.median(times)) if times else math.nan


def curves(records: Sequence[Record], offset: int) -> tuple[Indices, Floats]:
    """States and errors (runs, states), as far as every run goes."""
    curves = [c for record in records if (c := record["curves"].get(str(offset)))]
    if not curves:
        return np.empty(0, np.intp), np.empty((0, 0))
    first = curves[0]["first_state"]
    length = min(len(curve["error"]) for curve in curves)
    states = np.arange(first, first + length)
    return states, np.array([curve["error"][:length] for curve in curves])
