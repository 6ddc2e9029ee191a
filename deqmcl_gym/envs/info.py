"""What ``reset`` and ``step`` tell beside the observation."""

from typing import NotRequired, TypedDict

from deqmcl_gym.numerics.types import Floats, Singles


class RoomInfo(TypedDict):
    """The ``info`` channel. Arrays are fresh copies of fixed shape.

    Attributes:
        planned_actions: the actions planned after this step, zero-padded, (h, 2) float32:
            distance, turn.
        planned_count: how many rows of ``planned_actions`` are actions.
        action: the command carried out in this step, before motion noise and contact, (2,)
            float32; zeros at reset.
        collided: whether the step was stopped by a wall.
        truth: the true pose (x, y, θ), (3,) float64. For scoring: an estimator that
            reads it has been told the answer.
        goal: of a world with a route: where it ends (x, y), (2,) float64.
        route: of a world with a route: its corners as planned, from where the robot was expected to
            the goal, (k, 2) float64. For whoever drives: its beginning is the answer at reset.
    """

    planned_actions: Singles
    planned_count: int
    action: Singles
    collided: bool
    truth: Floats
    goal: NotRequired[Floats]
    route: NotRequired[Floats]
