"""Which trials belong together: runs on the same worlds."""

import math
from collections.abc import Iterable, Mapping

import numpy as np

from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Params, Run
from deqmcl_gym.numerics.types import Floats

Runs = dict[Run, float]

BASELINE = "mcl"  # localizer that others are compared with, unless a sweep says otherwise


def agree(some: Params, others: Params) -> bool:
    """Whether the parameters that both have are the same."""
    ours, theirs = dict(some), dict(others)
    return all(ours[name] == theirs[name] for name in ours.keys() & theirs.keys())


def runs_of(records: Iterable[Finished], name: str, offset: int = 0) -> Runs:
    """Return a score at an offset by run; NaN where it is not available."""
    return {
        record.trial.run: _number(score.get(name))
        for record in records
        for score in record.scores
        if score["offset"] == offset
    }


def by_world(runs: Mapping[Run, float | None]) -> dict[int, float]:
    """Return means over the filter seeds of each world, in the order of the worlds."""
    worlds: dict[int, list[float]] = {}
    for (world, _), value in sorted(runs.items()):
        worlds.setdefault(world, []).append(_number(value))
    return {world: sum(seeds) / len(seeds) for world, seeds in worlds.items()}


def over_worlds(runs: Mapping[Run, float | None]) -> Floats:
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
