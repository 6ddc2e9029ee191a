"""What charts show of a method's trials: error over the lap, along the queue, time per step."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.tables.pairing import Record, Run, over_worlds, run_of
from benchmarks.tables.stats import Estimate, estimate
from deqmcl_gym.numerics.types import Floats, Indices


@dataclass(frozen=True, kw_only=True)
class LapErrors:
    """Error by state, over the runs of a method, as far as every run goes.

    Attributes:
        states: (S,).
        mean: of e, (S,).
        low, high: the middle 80 % of runs, (S,).
    """

    states: Indices
    mean: Floats
    low: Floats
    high: Floats


def lap_errors(records: Sequence[Record], offset: int = 0) -> LapErrors | None:
    """Return the error over the lap of the belief about x_{t+k}; None if it is not held."""
    curves = [c for record in records if (c := record["curves"].get(str(offset)))]
    if not curves:
        return None
    first = curves[0]["first_state"]
    length = min(len(curve["error"]) for curve in curves)
    errors = np.array([curve["error"][:length] for curve in curves], np.float64)
    low, high = np.quantile(errors, [0.1, 0.9], axis=0)
    states = np.arange(first, first + length)
    return LapErrors(states=states, mean=errors.mean(axis=0), low=low, high=high)


def profile(records: Sequence[Record]) -> dict[int, Estimate]:
    """Return the error by offset, each over the same states, in the order of the offsets."""
    offsets: dict[int, dict[Run, float | None]] = {}
    for record in records:
        for offset, error in record.get("profile", {}).items():
            offsets.setdefault(int(offset), {})[run_of(record)] = error
    return {offset: estimate(over_worlds(offsets[offset])) for offset in sorted(offsets)}


def milliseconds_per_step(records: Sequence[Record]) -> float:
    """Median over runs of the localizer's time per step, ms; NaN if none was timed."""
    times = [
        1000 * record["seconds"] / record["steps_done"]
        for record in records
        if record.get("seconds") and record["steps_done"]
    ]
    return float(np.median(times)) if times else math.nan
