"""Runs on the same worlds: scores, differences, errors over the lap and along the queue."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.setup.changes import Changes, spelt
from benchmarks.tables.stats import Estimate, estimate
from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Run
from deqmcl_gym.numerics.types import Floats, Indices

Runs = dict[Run, float]

BASELINE = "mcl"  # localizer that others are compared with, unless a sweep says otherwise


def agree(some: Changes, others: Changes) -> bool:
    """Whether the parameters that both have are the same."""
    return all(spelt(some[name]) == spelt(others[name]) for name in some.keys() & others.keys())


def worlds_of(records: Iterable[Finished]) -> list[list[Finished]]:
    """Return the records of each world, in the order of the worlds."""
    worlds: dict[int, list[Finished]] = {}
    for record in records:
        worlds.setdefault(record.trial.trial, []).append(record)
    return [own for _, own in sorted(worlds.items())]


def runs_of(records: Iterable[Finished], name: str, offset: int = 0) -> Runs:
    """Return a score at an offset by run; NaN where it is not available."""
    return {
        record.trial.run: _number(score.get(name))
        for record in records
        for score in record.scores
        if score["offset"] == offset
    }


def grouped(runs: Runs) -> dict[int, list[float]]:
    """Return the values of each world's runs, in the order of the worlds."""
    worlds: dict[int, list[float]] = {}
    for (world, _), value in sorted(runs.items()):
        worlds.setdefault(world, []).append(value)
    return worlds


def by_world(runs: Runs) -> dict[int, float]:
    """Return means over the filter seeds of each world, in the order of the worlds."""
    return {world: sum(seeds) / len(seeds) for world, seeds in grouped(runs).items()}


def over_worlds(runs: Runs) -> Floats:
    """Return one value per world, (W,)."""
    return np.array(list(by_world(runs).values()))


def differences(ours: Runs, theirs: Runs) -> Floats:
    """Return ours - theirs over the runs in both, one value per world, (W,)."""
    return over_worlds({run: ours[run] - theirs[run] for run in ours if run in theirs})


def shared(ours: Runs, theirs: Runs) -> Floats:
    """Return theirs over the runs in both, one value per world, (W,)."""
    return over_worlds({run: theirs[run] for run in ours if run in theirs})


def _number(value: float | None) -> float:
    return math.nan if value is None else value


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


def lap_errors(records: Sequence[Finished], offset: int = 0) -> LapErrors | None:
    """Return the error over the lap of the belief about x_{t+k}; None if it is not held."""
    curves = [c for record in records if (c := record.curves.get(offset))]
    if not curves:
        return None
    first = curves[0].first_state
    length = min(len(curve.error) for curve in curves)
    errors = np.array([curve.error[:length] for curve in curves], np.float64)
    low, high = np.quantile(errors, [0.1, 0.9], axis=0)
    states = np.arange(first, first + length)
    return LapErrors(states=states, mean=errors.mean(axis=0), low=low, high=high)


def profile(records: Sequence[Finished]) -> dict[int, Estimate]:
    """Return the error by offset, each over the same states, in the order of the offsets."""
    offsets: dict[int, Runs] = {}
    for record in records:
        for offset, error in record.profile.items():
            offsets.setdefault(offset, {})[record.trial.run] = _number(error)
    return {offset: estimate(over_worlds(offsets[offset])) for offset in sorted(offsets)}


def milliseconds_per_step(records: Sequence[Finished]) -> float:
    """Median over runs of the localizer's time per step, ms; NaN if none was timed."""
    times = [
        1000 * record.seconds / record.steps_done
        for record in records
        if record.seconds and record.steps_done
    ]
    return float(np.median(times)) if times else math.nan
