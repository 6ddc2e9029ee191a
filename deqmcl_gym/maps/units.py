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
LENGTH: Mapping[str, int] = MappingProxyType({"length": 1})
PER_LENGTH: Mapping[str, int] = MappingProxyType({"length": -1})


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
            changes[field.name] = value * factor if power == 1 else value / factor
    return dataclasses.replace(part, **changes)  # type: ignore[type-var]
