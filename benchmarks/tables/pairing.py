"""Which trials belong together: the setting they share, the method they differ in."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from typing import Any

Record = dict[str, Any]

BASELINE = "mcl"  # localizer that others are compared with, unless a sweep says otherwise


@dataclass(frozen=True)
class Setting:
    """What trials share that may be compared; nested values as JSON, so that it can be a key.

    Attributes:
        scenario: name of the world and of what the filters assume.
        world, assumed: changes to both, by dotted name.
        disturbance: wrappers around the world.
        lag: L.
        seed: root of all randomness.
    """

    scenario: str
    world: str
    assumed: str
    disturbance: str
    lag: int
    seed: int


@dataclass(frozen=True)
class Method:
    """A localizer with its parameters, as JSON."""

    localizer: str
    params: str

    def agrees(self, other: "Method") -> bool:
        """Whether the parameters that both have are the same."""
        ours, theirs = json.loads(self.params), json.loads(other.params)
        return all(ours[name] == theirs[name] for name in ours.keys() & theirs.keys())


SETTING_COLUMNS = tuple(Setting.__annotations__)
METHOD_COLUMNS = ("method", "params")


def setting_of(trial: dict[str, Any]) -> Setting:
    """Return the setting of a canonical trial."""
    return Setting(
        trial.get("scenario", ""),
        _json(trial.get("world") or {}),
        _json(trial.get("assumed") or {}),
        _json(trial.get("disturbance") or []),
        trial.get("lag", 0),
        trial.get("seed", 0),
    )


def method_of(trial: dict[str, Any]) -> Method:
    """Return the method of a canonical trial."""
    return Method(trial["localizer"], _json(trial.get("params") or {}))


def per_world(values: Mapping[tuple[int, int], float | None]) -> dict[int, float]:
    """Means over the filter seeds of each world; NaN where one is not available."""
    worlds: dict[int, list[float]] = {}
    for (world, _), value in sorted(values.items()):
        worlds.setdefault(world, []).append(math.nan if value is None else value)
    return {world: sum(seeds) / len(seeds) for world, seeds in worlds.items()}


def world_scores(records: Sequence[Record], name: str, offset: int = 0) -> dict[int, float]:
    """A score at an offset by world."""
    return per_world(
        {
            (record["trial"]["trial"], record["trial"]["filter_seed"]): score.get(name)
            for record in records
            for score in record["scores"]
            if score["offset"] == offset
        }
    )


def identity(trial: dict[str, Any]) -> tuple[Any, ...]:
    """Values of ``SETTING_COLUMNS`` and ``METHOD_COLUMNS``."""
    return (*astuple(setting_of(trial)), *astuple(method_of(trial)))


def _json(value: Any) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
