"""Localizers by name."""

import inspect
from collections.abc import Callable
from typing import Any

from deqmcl_gym.validation import InputError, one_of
from localizers.api import Localizer, RobotModel
from localizers.methods.dead_reckoning import dead_reckoning
from localizers.methods.deq_mcl import deq_mcl
from localizers.methods.map_motion import mcl_map
from localizers.methods.mcl import mcl
from localizers.methods.smoother import mcl_map_smoother, mcl_smoother

Factory = Callable[..., Localizer]

_FACTORIES: dict[str, Factory] = {
    "mcl": mcl,
    "mcl-smoother": mcl_smoother,
    "mcl-map": mcl_map,
    "mcl-map-smoother": mcl_map_smoother,
    "deq-mcl": deq_mcl,
    "dead-reckoning": dead_reckoning,
}


def names() -> tuple[str, ...]:
    """Names that ``make`` knows, the built-in ones first."""
    return tuple(_FACTORIES)


def register(name: str, factory: Factory) -> None:
    """Make ``factory(robot, **params) -> Localizer`` known as ``name``.

    Raises:
        InputError: the name is taken.
    """
    if name in _FACTORIES:
        raise InputError(f"the localizer name {name!r} is taken: choose another one.")
    _FACTORIES[name] = factory


def make(name: str, robot: RobotModel, **params: Any) -> Localizer:
    """Make a localizer.

    Args:
        name: one of ``names()``.
        robot: the map, the sensor and the noise it is made for.
        params: parameters of the method, see ``parameters(name)``.

    Raises:
        InputError: unknown name or parameter (the nearest valid one is named), or a bad value.
    """
    valid = parameters(name)
    for param in params:
        if valid is not None:
            one_of(f"parameter of localizer {name!r}", param, valid)
    return _FACTORIES[name](robot, **params)


def parameters(name: str) -> tuple[str, ...] | None:
    """Names of a localizer's parameters; None if its factory takes any."""
    factory = _FACTORIES[one_of("localizer", name, _FACTORIES)]
    given = list(inspect.signature(factory).parameters.values())[1:]
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in given):
        return None
    return tuple(parameter.name for parameter in given)
