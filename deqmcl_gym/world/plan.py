"""Plans: the next actions, in a window of fixed size, as ``info`` shows them."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from deqmcl_gym.numerics.types import Indices, Singles
from deqmcl_gym.world.path import Pose

Actions = Singles


class Underway(Protocol):
    """The state of an episode that a plan depends on."""

    @property
    def step(self) -> int:
        """Steps carried out."""
        ...

    @property
    def pose(self) -> Pose:
        """The true pose (x, y, θ)."""
        ...

    @property
    def arc(self) -> float:
        """Arc length at which the robot is on the path."""
        ...

    @property
    def way(self) -> float:
        """Distance along the path since reset; the shorter way round if the robot was carried."""
        ...


class Plan(Protocol):
    """The interface of plans: the next actions at any step of an episode."""

    @property
    def horizon(self) -> int:
        """h, actions shown ahead."""
        ...

    @property
    def limit(self) -> int:
        """The most steps of an episode."""
        ...

    @property
    def actions(self) -> Actions:
        """All actions from the expected start, (T, 2) float32: distance, turn."""
        ...

    def after(self, underway: Underway) -> tuple[Actions, int]:
        """Return the next h actions, zero-padded, and their number; 0 ends the episode.

        The array (h, 2) is fresh.
        """
        ...


@dataclass(frozen=True)
class FixedPlan:
    """A plan made beforehand, which does not depend on what happens.

    Attributes:
        actions: (distance, turn), (T, 2) float32; action t is that of step t + 1 after ``begun``.
        horizon: h, actions shown ahead.
        begun: step of the episode after which it begins.
    """

    actions: Actions
    horizon: int
    begun: int = 0

    @property
    def limit(self) -> int:
        """The last step."""
        return self.begun + len(self.actions)

    def after(self, underway: Underway) -> tuple[Actions, int]:
        """Return the next h actions, wherever the robot is; see ``Plan.after``."""
        step = underway.step - self.begun
        end = step + self.horizon
        return self._padded[step:end].copy(), min(self.horizon, len(self.actions) - step)

    def after_each(self, steps: Indices) -> tuple[Actions, Indices]:
        """Return the results of :meth:`after` for each of ``steps`` (n,): (n, h, 2) and (n,)."""
        return self._windows[steps], self._counts[steps]

    def replaced(self, step: int, actions: Actions) -> "FixedPlan":
        """Return the plan in which ``actions`` (k, 2) follow ``step`` steps of this one."""
        kept = self.actions[: step - self.begun]
        return FixedPlan(np.vstack([kept, actions]), self.horizon, self.begun)

    @cached_property
    def _padded(self) -> Actions:
        return np.vstack([self.actions, np.zeros((self.horizon, 2), np.float32)])

    @cached_property
    def _windows(self) -> Actions:
        """Row t has the actions after step t, (T + 1, h, 2); a view."""
        windows = np.lib.stride_tricks.sliding_window_view(self._padded, self.horizon, axis=0)
        return windows.transpose(0, 2, 1)

    @cached_property
    def _counts(self) -> Indices:
        """Number of actions in row t of the windows, (T + 1,)."""
        return np.minimum(self.horizon, np.arange(len(self.actions), -1, -1))
