"""The stateful wrapper that turns a filter into a localizer."""

from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.numerics.types import Floats
from localizers.api import Prior, RobotModel, checked_plan, checked_rng, checked_step, require_reset
from localizers.inference.belief import Events
from localizers.models.prior import GaussianPrior


class Counted(Protocol):
    """A named tuple with a field ``events``."""

    @property
    def events(self) -> Events:
        """Counts of irregular events since reset."""
        ...

    def _replace(self, *, events: Any) -> Any: ...


B = TypeVar("B", bound=Counted)


class Filter(Protocol[B]):
    """The two steps of a recursive Bayes filter. It is stateless: the belief is the state."""

    def initial(self, prior: Prior, plan: Floats, rng: np.random.Generator) -> B:
        """Return the belief at t = 0."""
        ...

    def step(
        self, belief: B, ranges: Floats, action: Floats, plan: Floats, rng: np.random.Generator
    ) -> B:
        """Return the belief after one action and one scan."""
        ...


class FilterLocalizer(Generic[B]):
    """A ``Localizer`` that runs a filter, checks its input and counts bad beams."""

    def __init__(self, robot: RobotModel, bayes_filter: Filter[B]) -> None:
        """Make a localizer for ``robot`` from a filter made for it."""
        self.robot = robot
        self.filter = bayes_filter
        self._running: tuple[B, np.random.Generator] | None = None

    def reset(self, prior: Prior, plan: ArrayLike, rng: np.random.Generator) -> B:
        """Start a new run; see ``Localizer.reset``."""
        if isinstance(prior, GaussianPrior):
            prior.check_unit(self.robot.floor_plan.unit)
        belief = self.filter.initial(prior, checked_plan(plan), checked_rng(rng))
        self._running = (belief, rng)
        return belief

    def update(self, ranges: ArrayLike, action: ArrayLike, plan: ArrayLike) -> B:
        """Advance one step; see ``Localizer.update``."""
        belief, rng = require_reset(self._running)
        scan, command, ahead, usable = checked_step(ranges, action, plan, self.robot.lidar)
        belief = self.filter.step(belief, scan, command, ahead, rng)
        if usable < scan.size:
            belief = belief._replace(events=belief.events.of_scan(scan.size, usable))
        self._running = (belief, rng)
        return belief
