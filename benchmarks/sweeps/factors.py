"""The parts of a sweep: methods, axes along which settings vary, limits."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from benchmarks.setup.changes import NOTHING, Changes
from deqmcl_gym.validation import InputError, integer, one_of

GROUPS = ("world", "assumed", "params")  # of dotted names
SCALARS = ("scenario", "lag", "disturbance")


@dataclass(frozen=True, kw_only=True)
class Method:
    """A localizer by name, with parameters that are its own; shared ones stand in the sweep."""

    name: str
    params: Changes = NOTHING

    def __post_init__(self) -> None:
        object.__setattr__(self, "params", Changes(self.params))


@dataclass(frozen=True, kw_only=True)
class Limit:
    """What more and more particles converge to: a method with very many, on the first worlds.

    Attributes:
        method: with its particles, which no axis changes.
        of: localizers with its target, which are held against it; (): all that no other limit
            names.
        trials: worlds of each setting, the first ones.
        filter_seeds: runs on each; from two on they tell how near it is to its own limit.
    """

    method: Method
    of: tuple[str, ...] = ()
    trials: int = 20
    filter_seeds: int = 2

    def __post_init__(self) -> None:
        integer("trials of the limit", self.trials, low=1, high=100_000)
        integer("filter_seeds of the limit", self.filter_seeds, low=1, high=100_000)


@dataclass(frozen=True, kw_only=True)
class Axis:
    """What is varied together: k values for each of one or more names.

    Attributes:
        values: by name: "scenario", "lag", "disturbance", "world.…", "assumed.…" or "params.…".
    """

    values: Changes

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", Changes(self.values))
        lengths = {name: len(values) for name, values in self.values.items()}
        for name, length in lengths.items():
            group, _, rest = name.partition(".")
            if not (group in GROUPS and rest):
                one_of("name in [[vary]]", name, (*SCALARS, *(f"{g}.…" for g in GROUPS)))
            if length == 0:
                raise InputError(f"[[vary]] {name} is empty: give one value or more.")
        if len(set(lengths.values())) > 1:
            raise InputError(
                f"one [[vary]] has lists of different lengths ({_counted(lengths)}): they advance "
                "together; write a [[vary]] for each to get all combinations."
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


def _counted(lengths: Mapping[str, int]) -> str:
    return ", ".join(f"{name}: {length}" for name, length in lengths.items())
