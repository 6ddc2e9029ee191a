"""The plan as ``info`` shows it: the next actions, in a window of fixed size."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Actions = NDArray[np.float32]


@dataclass(frozen=True)
class Plan:
    """What is to be done at each step, and how much of it is shown ahead.

    Attributes:
        actions: (distance px, turn rad), (T, 2) float32; action t is that of step t + 1.
        horizon: h, actions shown ahead.
    """

    actions: Actions
    horizon: int

    def __len__(self) -> int:
        """T, the number of steps."""
        return len(self.actions)

    def after(self, step: int) -> tuple[Actions, int]:
        """Return the next h actions after ``step``, zero-padded, and how many they are.

        The array (h, 2) is a fresh one.
        """
        end = step + self.horizon
        return self._padded[step:end].copy(), min(self.horizon, len(self.actions) - step)

    def replaced(self, step: int, actions: Actions) -> "Plan":
        """Return the plan in which ``actions`` (k, 2) follow ``step`` steps of this one."""
        return Plan(np.vstack([self.actions[:step], actions]), self.horizon)

    @cached_property
    def _padded(self) -> Actions:
        return np.vstack([self.actions, np.zeros((self.horizon, 2), np.float32)])
