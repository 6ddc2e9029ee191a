"""Which trials belong together: the setting they share, the method they differ in, the worlds."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.setup.changes import NOTHING, Changes
from deqmcl_gym.numerics.types import Floats

Record = dict[str, Any]
Run = tuple[int, int]  # world, filter seed
Runs = dict[Run, float]

BASELINE = "mcl"  # localizer that others are compared with, unless a sweep says otherwise


@dataclass(frozen=True)
class Setting:
    """What trials share that may be compared.

    Attributes:
        scenario: name of the world and of what the filters assume.
        world, assumed: changes to both, by dotted name.
        disturbance: wrappers around the world, innermost first.
        lag: L.
        seed: root of all randomness.
    """

    scenario: str
    world: Changes
    assumed: Changes
    disturbance: tuple[Changes, ...]
    lag: int
    seed: int


@dataclass(frozen=True)
class Method:
    """A localizer with its parameters."""

    localizer: str
    params: Changes = NOTHING


def setting_of(record: Record) -> Setting:
    """Return the setting of a finished trial."""
    trial = record["trial"]
    return Setting(
        scenario=trial["scenario"],
        world=Changes(trial["world"]),
        assumed=Changes(trial["assumed"]),
        disturbance=tuple(map(Changes, trial["disturbance"])),
        lag=trial["lag"],
        seed=trial["seed"],
    )


def method_of(record: Record) -> Method:
    """Return the method of a finished trial."""
    trial = record["trial"]
    return Method(trial["localizer"], Changes(trial["params"]))


def run_of(record: Record) -> Run:
    """Return the world and the filter seed of a finished trial."""
    return record["trial"]["trial"], record["trial"]["filter_seed"]


def agree(some: Changes, others: Changes) -> bool:
    """Whether the parameters that both have are the same."""
    return all(some[name] == others[name] for name in some.keys() & others.keys())


def runs_of(records: Iterable[Record], name: str, offset: int = 0) -> Runs:
    """Return a score at an offset by run; NaN where it is not available."""
    return {
        run_of(record): _number(score.get(name))
        for record in records
        for score in record["scores"]
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
