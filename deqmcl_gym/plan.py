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

    def after_each(self, steps: NDArray[np.intp]) -> tuple[Actions, NDArray[np.intp]]:
        """Return what :meth:`after` says for each of ``steps`` (n,): (n, h, 2) and (n,)."""
        return self._windows[steps], np.minimum(self.horizon, len(self.actions) - steps)

    def replaced(self, step: int, actions: Actions) -> "Plan":
        """Return the plan in which ``actions`` (k, 2) follow ``step`` steps of this one."""
        return Plan(np.vstack([self.actions[:step], actions]), self.horizon)

    @cached_property
    def _padded(self) -> Actions:
        return np.vstack([self.actions, np.zeros((self.horizon, 2), np.float32)])

    @cached_property
    def _windows(self) -> Actions:
        """Row t shows what follows step t, (T + 1, h, 2); a view."""
        windows = np.lib.stride_tricks.sliding_window_view(self._padded, self.horizon, axis=0)
        return windows.transpose(0, 2, 1)
