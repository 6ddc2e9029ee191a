"""What a sweep is: a factorial design of settings and methods over paired worlds, as data."""

import itertools
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from benchmarks.plugins import takes
from benchmarks.presets import ASSUMED
from benchmarks.spec import Params, Trial, frozen, thawed
from deqmcl_gym.validation import InputError, integer, one_of

_GROUPS = ("world", "assumed", "params")  # of dotted names
_SCALARS = ("preset", "lag", "disturbance")


@dataclass(frozen=True, kw_only=True)
class Method:
    """A localizer by name, with parameters that are its own; shared ones stand in the sweep."""

    name: str
    params: Params = ()


@dataclass(frozen=True, kw_only=True)
class Axis:
    """What is varied together: k values for each of one or more names.

    Attributes:
        values: by name: "preset", "lag", "disturbance", "world.…", "assumed.…" or "params.…".
    """

    values: Mapping[str, tuple[Any, ...]]

    def __post_init__(self) -> None:
        lengths = {name: len(values) for name, values in self.values.items()}
        for name, length in lengths.items():
            group, _, rest = name.partition(".")
            if not (group in _GROUPS and rest):
                one_of("name in [[vary]]", name, (*_SCALARS, *(f"{g}.…" for g in _GROUPS)))
            if length == 0:
                raise InputError(f"[[vary]] {name} is empty: give one value or more.")
        if len(set(lengths.values())) > 1:
            raise InputError(
                f"one [[vary]] has lists of different lengths ({_counted(lengths)}): they are "
                "walked together; write a [[vary]] for each to have all combinations."
            )
        if not lengths:
            raise InputError("a [[vary]] is empty: give a name and its values.")

    def __len__(self) -> int:
        """Points on the axis."""
        return len(next(iter(self.values.values())))

    def points(self) -> list[dict[str, Any]]:
        """Return the values of each point by name."""
        rows = zip(*self.values.values(), strict=True)
        return [dict(zip(self.values, row, strict=True)) for row in rows]


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """A base, varied along axes; every combination is run by every localizer on the same worlds.

    Attributes:
        title: one line, for the report.
        localizers: the methods compared.
        preset: name of the world and of what the filters assume of it.
        lag: L; also a parameter of each localizer that has a use for it.
        world: changes to the world, by dotted name.
        assumed: changes to what the filters assume, by dotted name.
        disturbance: wrappers around the world, innermost first.
        params: parameters of each localizer that has a use for them.
        seed: root of all randomness.
        trials: worlds per setting.
        filter_seeds: runs of each method on each world.
        vary: axes; the last one turns fastest.
    """

    title: str
    localizers: tuple[Method, ...]
    preset: str = "paper"
    lag: int = 20
    world: Params = ()
    assumed: Params = ()
    disturbance: tuple[Params, ...] = ()
    params: Params = ()
    seed: int = 0
    trials: int = 10
    filter_seeds: int = 1
    vary: tuple[Axis, ...] = field(default=())

    def __post_init__(self) -> None:
        one_of("preset", self.preset, ASSUMED)
        integer("lag", self.lag)
        integer("seed", self.seed)
        integer("trials", self.trials, low=1, high=100_000)
        integer("filter_seeds", self.filter_seeds, low=1, high=100_000)
        if not self.localizers:
            raise InputError("the sweep names no localizer, so there are no combinations to run.")
        varied = [name for axis in self.vary for name in axis.values]
        for name in varied:
            if varied.count(name) > 1:
                raise InputError(f"{name} is varied twice: name it in one [[vary]].")
        for axis in self.vary:
            for value in axis.values.get("preset", ()):
                one_of("preset", value, ASSUMED)
            for value in axis.values.get("lag", ()):
                integer("lag", value)
        for method in self.localizers:
            takes(method.name)

    @property
    def combinations(self) -> int:
        """How many trials are asked for, counted without listing them; equal ones count twice."""
        points = math.prod(len(axis) for axis in self.vary)
        return points * len(self.localizers) * self.trials * self.filter_seeds

    def listed(self) -> Iterator[Trial]:
        """Yield all combinations: by setting, then method, world, filter seed."""
        for point in itertools.product(*(axis.points() for axis in self.vary)):
            base = self._at(dict(itertools.chain.from_iterable(part.items() for part in point)))
            for method in self.localizers:
                params = self._params_of(method, base)
                for number in range(self.trials):
                    for filter_seed in range(self.filter_seeds):
                        yield Trial(
                            preset=base["preset"],
                            world=frozen(base["world"]),
                            assumed=frozen(base["assumed"]),
                            disturbance=base["disturbance"],
                            localizer=method.name,
                            params=params,
                            lag=base["lag"],
                            seed=self.seed,
                            trial=number,
                            filter_seed=filter_seed,
                        )

    def cells(self) -> Iterator[Trial]:
        """Yield the first trial of each setting and method."""
        return replace(self, trials=1, filter_seeds=1).listed()

    def distinct(self) -> list[Trial]:
        """Return the distinct trials, in the order of ``listed``."""
        # by what names a result: 1, 1.0 and True are equal to Python
        return list({json.dumps(trial.canonical()): trial for trial in self.listed()}.values())

    def canonical(self) -> dict[str, Any]:
        """Return the sweep as JSON-able values: what a folder of results is checked against."""
        return {
            "title": self.title,
            "localizers": [
                {"name": method.name, "params": thawed(method.params)} for method in self.localizers
            ],
            "preset": self.preset,
            "lag": self.lag,
            "world": thawed(self.world),
            "assumed": thawed(self.assumed),
            "disturbance": [thawed(wrapper) for wrapper in self.disturbance],
            "params": thawed(self.params),
            "seed": self.seed,
            "trials": self.trials,
            "filter_seeds": self.filter_seeds,
            "vary": [
                {name: _jsonable_values(name, values) for name, values in axis.values.items()}
                for axis in self.vary
            ],
        }

    def _at(self, point: dict[str, Any]) -> dict[str, Any]:
        """Return the base with the values of one point of the design."""
        base: dict[str, Any] = {name: getattr(self, name) for name in _SCALARS}
        base |= {group: dict(getattr(self, group)) for group in _GROUPS}
        for name, value in point.items():
            group, _, rest = name.partition(".")
            if rest:
                base[group][rest] = value
            else:
                base[name] = value
        return base

    def _params_of(self, method: Method, base: dict[str, Any]) -> Params:
        known = takes(method.name)
        shared = {"lag": base["lag"]} | base["params"]
        useful = {k: v for k, v in shared.items() if known is None or k in known}
        return frozen(useful | dict(method.params))


def _jsonable_values(name: str, values: tuple[Any, ...]) -> list[Any]:
    if name == "disturbance":
        return [[thawed(wrapper) for wrapper in stack] for stack in values]
    return [thawed((("value", value),))["value"] for value in values]


def _counted(lengths: Mapping[str, int]) -> str:
    return ", ".join(f"{name}: {length}" for name, length in lengths.items())
