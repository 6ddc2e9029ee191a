"""The ``info`` that ``reset`` and ``step`` return."""

from collections.abc import Mapping
from typing import NotRequired, TypedDict

from deqmcl_gym.numerics.types import Floats, Singles
from deqmcl_gym.validation import InputError, one_of


class RoomInfo(TypedDict):
    """The ``info`` channel. Arrays are fresh copies of fixed shape.

    Attributes:
        planned_actions: the actions planned after this step, zero-padded, (h, 2) float32:
            distance, turn.
        planned_count: number of rows of ``planned_actions`` that are actions.
        action: the command carried out in this step, before motion noise and contact, (2,)
            float32; zeros at reset.
        collided: whether the step was stopped by a wall.
        truth: the true pose (x, y, θ), (3,) float64. For scoring only: estimators must not read
            it.
        goal: the end of the route (x, y), (2,) float64; only in a world with a route.
        route: corners (x, y) of the planned route, from the expected start to the goal; only in a
            world with a route. Routes differ in length, so it is a tuple, not an array: Gymnasium's
            vector envs keep one per env. For whoever drives: its beginning is the answer at reset.
    """

    planned_actions: Singles
    planned_count: int
    action: Singles
    collided: bool
    truth: Floats
    goal: NotRequired[Floats]
    route: NotRequired[tuple[tuple[float, ...], ...]]


def check_no_options(options: object) -> None:
    """Refuse options of a ``reset`` that takes none."""
    if options is not None and not isinstance(options, Mapping):
        raise InputError(f"options is {options!r}, but must be None: reset takes no options.")
    for key in options or ():
        one_of("reset option", key, ())
