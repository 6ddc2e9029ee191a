"""Units of length, and how constant lengths are converted to a map's unit.

Constant lengths in the code are in pixels of the paper's room, where the robot has a radius of 8,
and are multiplied by ``pixel(unit)`` where they are used. In metres, a pixel is 2 cm: the same
robot has a radius of 16 cm.
"""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, TypeVar

from deqmcl_gym.validation import one_of

T = TypeVar("T")

PIXELS: Mapping[str, float] = MappingProxyType({"px": 1.0, "m": 0.02})

# metadata of dataclass fields that are lengths, or numbers per length
LENGTH: Mapping[str, int] = MappingProxyType({"length": 1})  # also for all numbers in a tuple
PER_LENGTH: Mapping[str, int] = MappingProxyType({"length": -1})
SQUARE: Mapping[str, int] = MappingProxyType({"length": 2})
PER_SQUARE: Mapping[str, int] = MappingProxyType({"length": -2})
POSE: Mapping[str, tuple[int, ...]] = MappingProxyType({"length": (1, 1, 0)})


def pixel(unit: str) -> float:
    """Return the length of a pixel of the paper's room in a unit.

    Raises:
        InputError: the unit is unknown.
    """
    return PIXELS[one_of("unit of length", unit, PIXELS)]


def scaled(part: T, factor: float) -> T:
    """Return a frozen dataclass with its lengths, nested ones too, multiplied by ``factor``."""
    changes: dict[str, Any] = {}
    for own in dataclasses.fields(part):  # type: ignore[arg-type]
        value = getattr(part, own.name)
        if dataclasses.is_dataclass(value):
            changes[own.name] = scaled(value, factor)
        elif value is not None and (power := field.metadata.get("length")):
            changes[own.name] = _times(value, power, factor)
    return dataclasses.replace(part, **changes)  # type: ignore[type-var]


def _times(value: Any, power: Any, factor: float) -> Any:
    if isinstance(value, tuple):
        powers = power if isinstance(power, tuple) else (power,) * len(value)
        return tuple(_times(one, p, factor) for one, p in zip(value, powers, strict=True))
    for _ in range(abs(power)):
        value = value * factor if power > 0 else value / factor
    return value
