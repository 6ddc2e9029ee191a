"""Short forms for writing suites."""

import math
from collections.abc import Sequence
from typing import Any

from benchmarks.setup.changes import Changes
from benchmarks.sweeps.design import Axis, Method


def methods(*names: str) -> tuple[Method, ...]:
    """Localizers with the shared parameters."""
    return tuple(Method(name=name) for name in names)


def method(name: str, **params: Any) -> Method:
    """A localizer with parameters of its own."""
    return Method(name=name, params=Changes(params))


# AMCL with the assumptions of all other filters, updated at every step; "amcl" alone is Nav2's
AMCL_ON_ROBOT = method(
    "amcl",
    laser_model_type="robot",
    robot_model_type="robot",
    update_min_d=0.0,
    update_min_a=0.0,
)


def axis(**values: Sequence[Any]) -> Axis:
    """An axis whose names are written with __ for a dot."""
    return Axis(values=Changes({n.replace("__", "."): tuple(v) for n, v in values.items()}))


def wrapper(kind: str, **arguments: Any) -> Changes:
    """A disturbance of the world."""
    return Changes({"kind": kind} | arguments)


def home_again() -> tuple[tuple[float, float], ...]:
    """Actions from step 100 of the paper room's lap: turn round and drive back to the start."""
    drive, left, right = (5.0, 0.0), (0.0, math.pi / 12), (0.0, -math.pi / 12)
    legs = ((left, 12), (drive, 23), (right, 6), (drive, 40), (right, 6), (drive, 25))
    return tuple(action for action, steps in legs for _ in range(steps))


def noises(part: str, levels: tuple[float, ...], by: int) -> dict[str, tuple[float, ...]]:
    """Levels of the noise of drive and turn, for an axis; that of the drift per px is 1/by."""
    drift = tuple(level / by for level in levels)
    return {f"{part}__drive": levels, f"{part}__turn": levels, f"{part}__drift": drift}
