"""Commands to the robot: a distance to drive after an angle to turn."""

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym import validation
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Bools, Singles
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.config import Robot

Actions = Singles
_FLOAT32 = np.dtype(np.float32)


class Commands:
    """The actions (distance, turn) that a robot can carry out.

    Attributes:
        space: the Box of all commands, float32.
    """

    def __init__(self, robot: Robot, unit: str) -> None:
        """Allow distances in [0, max_distance] and turns in [-max_turn, max_turn]."""
        self._unit = unit
        self.space = gym.spaces.Box(
            np.array([0.0, -robot.max_turn], np.float32),
            np.array([robot.max_distance, robot.max_turn], np.float32),
        )
        # Comparing numbers takes a tenth of the time of Box.contains.
        (self._least, self._right), (self._most, self._left) = (
            bound.tolist() for bound in (self.space.low, self.space.high)
        )

    def checked(self, action: Any) -> Actions:
        """Return an action as a fresh array, (2,) float32.

        Raises:
            InputError: anything but two real numbers in the space.
        """
        command = _as_float32(action)
        if command is not None and command.shape == (2,):
            distance, turn = command.tolist()
            if self._least <= distance <= self._most and self._right <= turn <= self._left:
                return command
        raise InputError(
            f"the action is {action!r}, but must be two numbers: a distance from {self._least:g} "
            f"to {self._most:g} {self._unit} and a turn from {self._right:.4g} to {self._left:.4g} "
            "rad."
        )

    def checked_each(self, actions: Any, resting: Bools) -> Actions:
        """Return one action for each room as a fresh array, (n, 2) float32.

        Actions of rooms that are ``resting`` (n,) are ignored, but must be numbers.

        Raises:
            InputError: the shape is wrong, or an action is outside the space.
        """
        commands = _as_float32(actions)
        if commands is None or commands.shape != (resting.size, 2):
            given = repr(actions) if commands is None else f"of shape {commands.shape}"
            raise InputError(
                f"the actions are {given}, but must be numbers of shape ({resting.size}, 2): a "
                "distance and a turn for each room."
            )
        room = _first_outside(commands, self.space.low, self.space.high, resting)
        if room >= 0:
            try:
                self.checked(commands[room])
            except InputError as refused:
                raise InputError(f"in room {room}, {refused}") from None
        return commands

    def checked_plan(self, what: str, actions: ArrayLike) -> Actions:
        """Return actions as a fresh array, (k, 2) float32; [] has none.

        Raises:
            InputError: wrong shape, NaN, or an action outside the space.
        """
        plan = validation.actions(what, actions)
        for row in plan:
            self.checked(row)
        return plan.astype(np.float32)


def _as_float32(action: Any) -> Actions | None:
    """Return a fresh array, or None for words, truth values, complex numbers and ragged lists."""
    if type(action) is np.ndarray and action.dtype is _FLOAT32:  # what the space asks for
        return action.copy()
    try:
        given = np.asarray(action)
    except ValueError:
        return None
    with np.errstate(over="ignore"):
        return given.astype(np.float32) if given.dtype.kind in "fiu" else None


@compiled
def _first_outside(commands: Actions, low: Actions, high: Actions, resting: Bools) -> int:
    """Return the first row, of those not ``resting``, outside [low, high]; -1 if there is none."""
    for room in range(resting.size):
        if not resting[room]:
            for i in range(2):
                if not low[i] <= commands[room, i] <= high[i]:
                    return room
    return -1
