"""Units of length: what a constant length is in a map's own unit.

Lengths that are constants of the code are stated in pixels of the paper's room, in which the robot
has a radius of 8, and multiplied by ``pixel(unit)`` where they are used. A room in metres is as
large as that one if a pixel is 2 cm: the robot is then 16 cm in radius.
"""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, TypeVar

from deqmcl_gym.validation import one_of

T = TypeVar("T")

PIXELS: Mapping[str, float] = MappingProxyType({"px": 1.0, "m": 0.02})

# metadata of the fields of a part that are lengths, or numbers per length
LENGTH: Mapping[str, int] = MappingProxyType({"length": 1})  # also of all numbers of a tuple
PER_LENGTH: Mapping[str, int] = MappingProxyType({"length": -1})
POSE: Mapping[str, tuple[int, ...]] = MappingProxyType({"length": (1, 1, 0)})


def pixel(unit: str) -> float:
    """Return what a pixel of the paper's room is in a unit.

    Raises:
        InputError: there is no such unit.
    """
    return PIXELS[one_of("unit of length", unit, PIXELS)]


def scaled(part: T, factor: float) -> T:
    """Return a frozen dataclass with its lengths times ``factor``, those within its parts too."""
    changes: dict[str, Any] = {}
    for field in dataclasses.fields(part):  # type: ignore[arg-type]
        value = getattr(part, field.name)
        if dataclasses.is_dataclass(value):
            changes[field.name] = scaled(value, factor)
        elif value is not None and (power := field.metadata.get("length")):
            changes[field.name] = _times(value, power, factor)
    return dataclasses.replace(part, **changes)  # type: ignore[type-var]


def _times(value: Any, power: Any, factor: float) -> Any:
    if isinstance(value, tuple):
        powers = power if isinstance(power, tuple) else (power,) * len(value)
        return tuple(_times(one, p, factor) for one, p in zip(value, powers, strict=True))
    return value * factor if power > 0 else value / factor if power < 0 else value
