"""The plan as ``info`` shows it: the next actions, in a window of fixed size."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from deqmcl_gym.numerics.types import Indices, Singles
from deqmcl_gym.world.path import Pose

Actions = Singles


class Underway(Protocol):
    """What a plan may ask of an episode."""

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
        """From the arc length at reset to there, the shorter way round if it was carried."""
        ...


class Plan(Protocol):
    """What is to be done next, at any moment of an episode."""

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
        """The whole way from the expected start, (T, 2) float32: distance, turn."""
        ...

    def after(self, underway: Underway) -> tuple[Actions, int]:
        """Return the next h actions, zero-padded, and how many they are; none ends the episode.

        The array (h, 2) is a fresh one.
        """
        ...


@dataclass(frozen=True)
class FixedPlan:
    """What is to be done at each step as planned beforehand, whatever happens.

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
        """Return what :meth:`after` says after each of ``steps`` (n,): (n, h, 2) and (n,)."""
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
        """Row t shows what follows step t, (T + 1, h, 2); a view."""
        windows = np.lib.stride_tricks.sliding_window_view(self._padded, self.horizon, axis=0)
        return windows.transpose(0, 2, 1)

    @cached_property
    def _counts(self) -> Indices:
        """How many actions row t of the windows shows, (T + 1,)."""
        return np.minimum(self.horizon, np.arange(len(self.actions), -1, -1))
