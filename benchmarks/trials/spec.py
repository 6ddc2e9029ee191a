"""Trial: what is run, named by everything its numbers depend on."""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.setup.world_files import files_of

Params = tuple[tuple[str, Any], ...]

_WORLD, _FILTER = 0, 1  # children of a trial's seed


Run = tuple[int, int]  # world, filter seed


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
    world: Params
    assumed: Params
    disturbance: tuple[Params, ...]
    lag: int
    seed: int


@dataclass(frozen=True)
class Method:
    """A localizer by name, with its parameters."""

    name: str
    params: Params = ()


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One localizer on one lap of one world.

    Attributes:
        scenario: name of the world and of what the filters assume of it.
        world: changes to the scenario's world, by dotted name: ("lidar.beams", 9).
        assumed: changes to what the filters assume, by dotted name: ("scan.sigma", 50.0).
        disturbance: wrappers around the world, innermost first: (("kind", "kidnap"), …).
        localizer: name of the localizer.
        params: its parameters, sorted by name.
        lag: L, the offsets scored are -L, 0 and L.
        seed: root of all randomness.
        trial: number of the world; trials of the same number are paired.
        filter_seed: which of several runs of the localizer on that world.
    """

    scenario: str
    world: Params = ()
    assumed: Params = ()
    disturbance: tuple[Params, ...] = ()
    localizer: str
    params: Params
    lag: int
    seed: int
    trial: int
    filter_seed: int = 0

    @property
    def setting(self) -> Setting:
        """What it shares with the trials that it is compared with."""
        wrappers = tuple(frozen(dict(wrapper)) for wrapper in self.disturbance)
        return Setting(self.scenario, self.world, self.assumed, wrappers, self.lag, self.seed)

    @property
    def method(self) -> Method:
        """What is compared."""
        return Method(self.localizer, self.params)

    @property
    def run(self) -> Run:
        """The world and the filter seed."""
        return self.trial, self.filter_seed

    @property
    def offsets(self) -> tuple[int, ...]:
        """Offsets scored, in steps."""
        return (0,) if self.lag == 0 else (0, -self.lag, self.lag)

    @property
    def world_seed(self) -> int:
        """The seed for ``env.reset``: a function of (seed, trial), below 2**53."""
        sequence = np.random.SeedSequence(self.seed, spawn_key=(self.trial, _WORLD))
        return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(11))

    @property
    def files(self) -> list[str]:
        """Paths of what its world is read from, besides those that its scenario names."""
        return files_of(dict(self.world))

    def filter_rng(self) -> np.random.Generator:
        """Return the localizer's stream: a function of (seed, trial, filter_seed).

        The same for every localizer, so that filters start from the same cloud.
        """
        key = (self.trial, _FILTER, self.filter_seed)
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=key))

    def canonical(self) -> dict[str, Any]:
        """Return the trial as JSON-able values in a fixed order."""
        return {
            "scenario": self.scenario,
            "world": thawed(self.world),
            "assumed": thawed(self.assumed),
            "disturbance": [thawed(wrapper) for wrapper in self.disturbance],
            "localizer": self.localizer,
            "params": thawed(self.params),
            "lag": self.lag,
            "seed": self.seed,
            "trial": self.trial,
            "filter_seed": self.filter_seed,
        }

    def cell(self) -> str:
        """Return its setting and method in words: what trials are counted by."""
        parts = [self.scenario, *(f"{name}={value}" for name, value in self.world)]
        parts += [f"assumed {name}={value}" for name, value in self.assumed]
        parts += [str(dict(wrapper).get("kind")) for wrapper in self.disturbance]
        parts += [f"L={self.lag}", self.localizer]
        return " ".join([*parts, *(f"{name}={value}" for name, value in self.params)])

    def key(self, provenance: str) -> str:
        """Name of its result: a hash of the canonical configuration and of what computes it."""
        words = json.dumps([self.canonical(), provenance], sort_keys=True, allow_nan=False)
        return hashlib.sha256(words.encode()).hexdigest()[:32]


def frozen(values: Mapping[str, Any]) -> Params:
    """Return a mapping as pairs sorted by name, its lists as tuples."""
    return tuple(sorted((name, tuples(value)) for name, value in values.items()))


def thawed(params: Params) -> dict[str, Any]:
    """Return pairs as JSON-able values; JSON has no infinity: it is the word "inf"."""
    return {name: _jsonable(value) for name, value in sorted(params)}


def unworded(value: Any) -> Any:
    """Return a value read from JSON with "inf" as the number again."""
    if isinstance(value, dict):
        return {name: unworded(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [unworded(inner) for inner in value]
    return float(value) if value in ("inf", "-inf") else value


def tuples(value: Any) -> Any:
    """Return a value with its lists as tuples."""
    return tuple(tuples(item) for item in value) if isinstance(value, list | tuple) else value


def _jsonable(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_jsonable(item) for item in value]
    if isinstance(value, float) and math.isinf(value):
        return str(value)
    return value
